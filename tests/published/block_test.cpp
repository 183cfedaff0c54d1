#include "firmware/published/block.h"

#include <doctest/doctest.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <thread>

#include "firmware/input_error.h"
#include "firmware/published/block_layout.h"

using namespace finsight;
namespace fs = std::filesystem;

namespace {

struct Folder {
  fs::path path = fs::temp_directory_path() / ("finsight_block_" + std::to_string(getpid()));
  Folder() { fs::remove_all(path); }
  ~Folder() { fs::remove_all(path); }
};

const BlockContents kContents{.shape_points = 100, .width_px = 64, .height_px = 48, .about = R"({"finger":"srm"})"};

PublishedFrame filled(std::uint16_t n) {
  PublishedFrame frame;
  frame.words.fill(n);
  frame.process.fill(n);
  for (auto& plate : frame.plate) plate.fill(n);
  return frame;
}

/// The message with which a block is refused.
std::string refusal(const fs::path& folder) {
  try {
    const BlockReader reader(folder);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

/// Writes bytes into the middle of the block's file.
void damage(const fs::path& folder, std::size_t at, std::uint32_t value) {
  std::fstream file(folder / kBlockName, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(static_cast<std::streamoff>(at));
  file.write(reinterpret_cast<const char*>(&value), sizeof value);
}

}  // namespace

TEST_CASE("block: what is published is read, with shape and picture") {
  const Folder folder;
  BlockWriter writer(folder.path, kContents);
  BlockReader reader(folder.path);
  CHECK(reader.contents().about == kContents.about);
  CHECK(reader.contents().shape_points == 100);
  CHECK_FALSE(reader.frame().has_value());
  PublishedPicture picture;
  CHECK_FALSE(reader.picture(picture));

  std::vector<std::uint8_t> grey(80 * 48);
  for (std::size_t i = 0; i < grey.size(); ++i) grey[i] = static_cast<std::uint8_t>(i % 80);
  const Frame image{.grey = grey.data(), .width_px = 64, .height_px = 48, .stride_bytes = 80};
  std::vector<std::int16_t> shape(300, -7), seen;
  PublishedFrame frame = filled(41);
  writer.publish(frame, shape, &image);
  const auto read = reader.frame(&seen);
  REQUIRE(read.has_value());
  CHECK(read->number == 1);
  CHECK(read->words[80] == 41);
  CHECK(read->plate[2][5] == 41);
  CHECK(seen == shape);
  REQUIRE(reader.picture(picture));
  CHECK(picture.number == 1);
  CHECK(picture.grey.size() == 64 * 48);
  CHECK(picture.grey[64 * 47 + 63] == 63);

  frame = filled(42);
  writer.publish(frame, {}, nullptr);
  CHECK(reader.frame(&seen)->words[0] == 42);
  CHECK(seen.empty());
  REQUIRE(reader.picture(picture));
  CHECK(picture.number == 1);
}

TEST_CASE("block: a reader never sees a torn value, however fast the writer is") {
  const Folder folder;
  BlockWriter writer(folder.path, kContents);
  std::atomic<bool> done{false};
  std::thread publisher([&] {
    std::vector<std::int16_t> shape(300);
    std::vector<std::uint8_t> grey(64 * 48);
    const Frame image{.grey = grey.data(), .width_px = 64, .height_px = 48, .stride_bytes = 64};
    for (std::uint16_t n = 1; n < 60'000; ++n) {
      PublishedFrame frame = filled(n);
      std::ranges::fill(shape, static_cast<std::int16_t>(n % 30'000));
      std::ranges::fill(grey, static_cast<std::uint8_t>(n));
      writer.publish(frame, shape, &image);
    }
    done = true;
  });
  BlockReader reader(folder.path);
  std::vector<std::int16_t> shape;
  PublishedPicture picture;
  std::uint64_t reads = 0, torn = 0, older = 0, last = 0;
  while (!done) {
    if (const auto frame = reader.frame(&shape)) {
      ++reads;
      older += frame->number < last;
      last = frame->number;
      const auto n = static_cast<std::uint16_t>(frame->number);
      for (const std::uint16_t word : frame->words) torn += word != n;
      for (const auto& plate : frame->plate) torn += plate[5] != static_cast<float>(n);
      for (const std::int16_t value : shape) torn += value != static_cast<std::int16_t>(n % 30'000);
    }
    if (reader.picture(picture)) {
      for (const std::uint8_t pixel : picture.grey) torn += pixel != static_cast<std::uint8_t>(picture.number);
    }
  }
  publisher.join();
  CHECK(reads > 0);
  CHECK(torn == 0);
  CHECK(older == 0);
}

TEST_CASE("block: another version, another layout, a cut file and another file are refused by name") {
  const Folder folder;
  {
    const BlockWriter writer(folder.path, kContents);
    damage(folder.path, offsetof(block::Header, version), kBlockVersion + 1);
    CHECK(refusal(folder.path) ==
          (folder.path / kBlockName).string() + ": version: found " + std::to_string(kBlockVersion + 1) +
              ", expected " + std::to_string(kBlockVersion) + ": finsightd and the page must be of the same release");
  }
  {
    const BlockWriter writer(folder.path, kContents);
    damage(folder.path, offsetof(block::Header, frame_bytes), 7);
    CHECK(refusal(folder.path).find("frame_bytes: found 7") != std::string::npos);
  }
  {
    const BlockWriter writer(folder.path, kContents);
    damage(folder.path, offsetof(block::Header, about_bytes), 0xFFFF'FFFF);
    CHECK(refusal(folder.path).find("sizes that no device has") != std::string::npos);
  }
  {
    const BlockWriter writer(folder.path, kContents);
    fs::resize_file(folder.path / kBlockName, 4096);
    CHECK(refusal(folder.path).find("size: found 4096 bytes") != std::string::npos);
  }
  std::ofstream(folder.path / kBlockName) << "short";
  CHECK(refusal(folder.path).find("not a published block") != std::string::npos);
  CHECK_THROWS_AS(BlockReader(folder.path / "nowhere"), std::system_error);
}

TEST_CASE("block: pictures are wanted only while somebody watches, and not too many") {
  const Folder folder;
  fs::create_directories(folder.path);
  watch_block(folder.path);  // a reader of an earlier run
  BlockWriter writer(folder.path, kContents);
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  CHECK_FALSE(writer.is_watched());
  watch_block(folder.path);
  for (int i = 0; i < 100 && !writer.is_watched(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  REQUIRE(writer.is_watched());
  CHECK(writer.wants_picture(kNsPerS));
  std::vector<std::uint8_t> grey(64 * 48);
  const Frame image{.grey = grey.data(), .width_px = 64, .height_px = 48, .stride_bytes = 64};
  PublishedFrame frame;
  frame.exposure_ns = kNsPerS;
  writer.publish(frame, {}, &image);
  CHECK_FALSE(writer.wants_picture(kNsPerS + BlockWriter::kPictureEvery_ns - 1));
  CHECK(writer.wants_picture(kNsPerS + BlockWriter::kPictureEvery_ns));
}

TEST_CASE("block: a reader notices that the writer has started again or gone") {
  const Folder folder;
  std::optional<BlockWriter> writer(std::in_place, folder.path, kContents);
  BlockReader reader(folder.path);
  CHECK(reader.is_current());
  PublishedFrame frame;
  writer->publish(frame, {}, nullptr);
  const BlockWriter second(folder.path, kContents);
  CHECK_FALSE(reader.is_current());
  CHECK(reader.frame().has_value());  // what it has mapped stays
}
