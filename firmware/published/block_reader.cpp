#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/input_error.h"
#include "firmware/published/block.h"
#include "firmware/published/block_layout.h"

namespace finsight {

namespace {

constexpr std::uint32_t kMostSide_px = 8192, kMostPoints = 100'000, kMostAbout = 16U << 20;
/// How often a reader that was overtaken tries again: the writer would have to be as fast as a copy for more.
constexpr int kTries = 4;

void check(const std::string& file, const block::Header& header, std::uint64_t bytes) {
  if (std::memcmp(header.magic, block::kMagic, sizeof header.magic) != 0)
    throw InputError(file, "not a published block");
  if (header.version != kBlockVersion) {
    throw InputError(file, "version", std::to_string(header.version),
                     std::to_string(kBlockVersion) + ": finsightd and the page must be of the same release");
  }
  if (header.frame_bytes != sizeof(PublishedFrame)) {
    throw InputError(file, "frame_bytes", std::to_string(header.frame_bytes), std::to_string(sizeof(PublishedFrame)));
  }
  if (header.width_px > kMostSide_px || header.height_px > kMostSide_px || header.shape_points > kMostPoints ||
      header.about_bytes > kMostAbout) {
    throw InputError(file, "sizes that no device has");
  }
  const std::uint64_t expected = block::Layout(header).end;
  if (header.file_bytes != expected || bytes != expected) {
    throw InputError(file, "size", std::to_string(bytes) + " bytes", std::to_string(expected));
  }
}

}  // namespace

BlockReader::BlockReader(const std::filesystem::path& folder) : file_(folder / kBlockName) {
  const int descriptor = open(file_.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) block::fail(file_, "cannot be opened");
  struct Closed {
    int number;
    ~Closed() { close(number); }
  } const closed{descriptor};
  struct stat found {};
  if (fstat(descriptor, &found) != 0) block::fail(file_, "cannot be read");
  inode_ = found.st_ino;
  block::Header header{};
  if (read(descriptor, &header, sizeof header) != static_cast<ssize_t>(sizeof header)) {
    throw InputError(file_.string(), "not a published block");
  }
  check(file_.string(), header, static_cast<std::uint64_t>(found.st_size));
  bytes_ = header.file_bytes;
  void* mapped = mmap(nullptr, bytes_, PROT_READ, MAP_SHARED, descriptor, 0);
  if (mapped == MAP_FAILED) block::fail(file_, "cannot be mapped");
  memory_ = static_cast<std::byte*>(mapped);
  contents_ = {static_cast<int>(header.shape_points), static_cast<int>(header.width_px),
               static_cast<int>(header.height_px),
               std::string(reinterpret_cast<const char*>(memory_) + block::Layout(header).about, header.about_bytes)};
}

BlockReader::~BlockReader() { munmap(memory_, bytes_); }

bool BlockReader::is_current() const {
  struct stat found {};
  return stat(file_.c_str(), &found) == 0 && found.st_ino == inode_;
}

std::optional<PublishedFrame> BlockReader::frame(std::vector<std::int16_t>* shape) {
  block::Header& header = *reinterpret_cast<block::Header*>(memory_);
  const block::Layout layout(header);
  for (int i = 0; i < kTries; ++i) {
    const std::uint64_t n = block::word(header.newest_frame).load(std::memory_order_acquire);
    if (n == 0) return std::nullopt;
    PublishedFrame frame;
    const bool whole = block::read_slot(memory_ + layout.frames, layout.frame_slot, block::kFrameSlots, n,
                                        [&](const block::Slot&, const std::byte* at) {
                                          std::memcpy(&frame, at, sizeof frame);
                                          if (!shape) return;
                                          std::uint64_t points = 0;
                                          std::memcpy(&points, at + sizeof frame, sizeof points);
                                          if (points != header.shape_points) points = 0;
                                          shape->resize(3 * points);
                                          if (points > 0)
                                            std::memcpy(shape->data(), at + sizeof frame + sizeof points, points * 6);
                                        });
    if (whole) return frame;
  }
  return std::nullopt;
}

bool BlockReader::picture(PublishedPicture& picture) {
  block::Header& header = *reinterpret_cast<block::Header*>(memory_);
  const block::Layout layout(header);
  for (int i = 0; i < kTries; ++i) {
    const std::uint64_t n = block::word(header.newest_picture).load(std::memory_order_acquire);
    if (n == 0) return false;
    const bool whole = block::read_slot(memory_ + layout.pictures, layout.picture_slot, block::kPictureSlots, n,
                                        [&](const block::Slot& slot, const std::byte* at) {
                                          picture.number = slot.number;
                                          picture.width_px = static_cast<int>(header.width_px);
                                          picture.height_px = static_cast<int>(header.height_px);
                                          picture.grey.resize(std::size_t{header.width_px} * header.height_px);
                                          std::memcpy(picture.grey.data(), at, picture.grey.size());
                                        });
    if (whole) return true;
  }
  return false;
}

void watch_block(const std::filesystem::path& folder) {
  const std::filesystem::path file = folder / kWatchingName;
  const int descriptor = open(file.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0640);
  if (descriptor < 0) block::fail(file, "cannot be created");
  const int result = futimens(descriptor, nullptr);
  close(descriptor);
  if (result != 0) block::fail(file, "cannot be touched");
}

}  // namespace finsight
