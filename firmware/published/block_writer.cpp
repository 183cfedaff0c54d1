#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <condition_variable>
#include <memory>
#include <mutex>
#include <thread>

#include "firmware/published/block.h"
#include "firmware/published/block_layout.h"

namespace finsight {

namespace {

/// Closes on the way out of the constructor, whichever way that is.
struct Descriptor {
  int number;
  ~Descriptor() {
    if (number >= 0) close(number);
  }
};

}  // namespace

// Looks at the file's time in a thread of its own: the frame loop asks the kernel for nothing. The readers own the file
// and could cut it off, so it is not mapped.
struct BlockWriter::Watcher {
  explicit Watcher(std::filesystem::path watched) : file(std::move(watched)), thread([this] { run(); }) {}
  ~Watcher() {
    {
      const std::lock_guard lock(mutex);
      stopping = true;
    }
    wake.notify_one();
    thread.join();
  }
  void run() {
    constexpr std::chrono::milliseconds kEvery(200);
    constexpr std::int64_t kLasts_ns = 2 * kNsPerS;
    std::int64_t changed_ns = -kLasts_ns;
    timespec last{};
    std::unique_lock lock(mutex);
    for (bool first = true; !stopping; first = false) {
      struct stat found {};
      if (stat(file.c_str(), &found) == 0 &&
          (found.st_mtim.tv_sec != last.tv_sec || found.st_mtim.tv_nsec != last.tv_nsec)) {
        last = found.st_mtim;
        if (!first) changed_ns = steady_now_ns();  // what was there at the start is an earlier reader's
      }
      watched = steady_now_ns() - changed_ns < kLasts_ns;
      wake.wait_for(lock, kEvery);
    }
  }
  const std::filesystem::path file;
  std::atomic<bool> watched{false};
  std::mutex mutex;
  std::condition_variable wake;
  bool stopping = false;
  std::thread thread;
};

BlockWriter::BlockWriter(const std::filesystem::path& folder, const BlockContents& contents)
    : file_(folder / kBlockName) {
  std::filesystem::create_directories(folder);
  block::Header header{};
  std::memcpy(header.magic, block::kMagic, sizeof header.magic);
  header.version = kBlockVersion;
  header.frame_bytes = sizeof(PublishedFrame);
  header.shape_points = static_cast<std::uint32_t>(contents.shape_points);
  header.width_px = static_cast<std::uint32_t>(contents.width_px);
  header.height_px = static_cast<std::uint32_t>(contents.height_px);
  header.about_bytes = static_cast<std::uint32_t>(contents.about.size());
  const block::Layout layout(header);
  header.file_bytes = bytes_ = layout.end;

  const std::filesystem::path fresh = file_.string() + ".part";
  unlink(fresh.c_str());
  const Descriptor opened{open(fresh.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0640)};
  if (opened.number < 0) block::fail(fresh, "cannot be created");
  fchmod(opened.number, 0640);  // whatever the umask: the page's user is in the file's group
  // Room that is taken now cannot be missing later, when a write without room would end the program.
  if (const int error = posix_fallocate(opened.number, 0, static_cast<off_t>(bytes_))) {
    errno = error;
    block::fail(fresh, "has no room");
  }
  void* mapped = mmap(nullptr, bytes_, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, opened.number, 0);
  if (mapped == MAP_FAILED) block::fail(fresh, "cannot be mapped");
  memory_ = static_cast<std::byte*>(mapped);
  std::memcpy(memory_, &header, sizeof header);
  std::memcpy(memory_ + layout.about, contents.about.data(), contents.about.size());
  if (rename(fresh.c_str(), file_.c_str()) != 0) {
    const int error = errno;
    munmap(memory_, bytes_);
    errno = error;
    block::fail(file_, "cannot be replaced");
  }
  watcher_ = std::make_unique<Watcher>(folder / kWatchingName);
}

BlockWriter::~BlockWriter() {
  unlink(file_.c_str());
  munmap(memory_, bytes_);
}

bool BlockWriter::is_watched() const { return watcher_->watched.load(std::memory_order_relaxed); }

void BlockWriter::publish(PublishedFrame& frame, std::span<const std::int16_t> shape, const Frame* picture) {
  block::Header& header = *reinterpret_cast<block::Header*>(memory_);
  const block::Layout layout(header);
  const std::uint64_t points = shape.size() == std::size_t{3} * header.shape_points ? header.shape_points : 0;
  frame.number = ++frames_;
  block::write_slot(memory_ + layout.frames, layout.frame_slot, block::kFrameSlots, frames_,
                    [&](block::Slot& slot, std::byte* bytes) {
                      slot.number = frames_;
                      std::memcpy(bytes, &frame, sizeof frame);
                      std::memcpy(bytes + sizeof frame, &points, sizeof points);
                      // An empty shape has no address, which memcpy() must not be given.
                      if (points > 0) std::memcpy(bytes + sizeof frame + sizeof points, shape.data(), points * 6);
                    });
  block::word(header.newest_frame).store(frames_, std::memory_order_release);

  if (!picture || picture->width_px != static_cast<int>(header.width_px) ||
      picture->height_px != static_cast<int>(header.height_px)) {
    return;
  }
  ++pictures_;
  last_picture_ns_ = frame.exposure_ns;
  block::write_slot(memory_ + layout.pictures, layout.picture_slot, block::kPictureSlots, pictures_,
                    [&](block::Slot& slot, std::byte* bytes) {
                      slot.number = frames_;
                      const std::size_t width = header.width_px;
                      if (picture->stride_bytes == picture->width_px) {
                        std::memcpy(bytes, picture->grey, width * header.height_px);
                        return;
                      }
                      for (std::size_t y = 0; y < header.height_px; ++y) {
                        std::memcpy(bytes + y * width,
                                    picture->grey + y * static_cast<std::size_t>(picture->stride_bytes), width);
                      }
                    });
  block::word(header.newest_picture).store(pictures_, std::memory_order_release);
}

}  // namespace finsight
