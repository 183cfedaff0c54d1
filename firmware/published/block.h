// What finsightd publishes for programs beside it: a file in shared memory with the newest frame's values and, while
// somebody watches, its shape and picture. One writer, which never waits for a reader; readers map it read-only.
//
// FOLDER/published is the block. FOLDER/watching belongs to the readers: who touches it watches for another two
// seconds.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <vector>

#include "firmware/types.h"

namespace finsight {

inline constexpr const char* kBlockName = "published";
inline constexpr const char* kWatchingName = "watching";
/// Of the block's layout. Readers refuse any other.
inline constexpr std::uint32_t kBlockVersion = 2;

/// Times of a stage of the frame loop since the start, microseconds.
struct PublishedTimes {
  float p50_us = 0, p99_us = 0, worst_us = 0;
};
inline constexpr std::array<const char*, 5> kPublishedStages = {"poses", "shape", "touch", "registers", "frame"};

/// The values of one frame.
struct PublishedFrame {
  std::uint64_t number = 0;                        ///< counts what was published, from 1
  std::int64_t exposure_ns = 0, published_ns = 0;  ///< steady clock, the same in all processes of a machine
  std::array<std::uint16_t, kMeasurementRegisters> words{};
  std::array<std::uint16_t, kProcessRegisters> process{};
  std::array<std::array<std::array<float, 2>, 4>, kPlates> corners_px{};  ///< as MarkerCorners
  std::array<std::uint8_t, kPlates> marker_found{};                       ///< its corners are in the picture
  std::array<std::uint8_t, kPlates> plate_seen{};                         ///< and its pose is believed
  std::array<float, kPlates> reprojection_px{};
  std::array<std::array<float, 6>, kPlates> plate{};  ///< displacement (mm), rotation vector (rad)
  std::uint8_t has_image = 0;                         ///< a camera or session, not recorded poses
  std::array<PublishedTimes, kPublishedStages.size()> times{};
  std::uint8_t has_zero = 0, has_zero_g = 0;
  std::array<std::array<float, 6>, kPlates> zero{};  ///< the zero in use, as `plate`
  std::array<float, 3> zero_g{};                     ///< acceleration of things that fell when it was measured
  float work_us = 0;                                 ///< this frame, from its arrival until everything was published
};
static_assert(std::is_trivially_copyable_v<PublishedFrame>);

struct PublishedPicture {
  std::uint64_t number = 0;  ///< of the frame that it is
  int width_px = 0, height_px = 0;
  std::vector<std::uint8_t> grey;  ///< [height, width]
};

/// What does not change while the firmware runs.
struct BlockContents {
  int shape_points = 0;             ///< points of the finger's surface
  int width_px = 0, height_px = 0;  ///< of the pictures; 0: there are none
  std::string about;                ///< a JSON text about device and finger, see device/page_publisher.h
};

/// For the frame loop's thread. After construction nothing allocates, locks or waits.
class BlockWriter {
 public:
  /// At most so many pictures per second.
  static constexpr std::int64_t kPictureEvery_ns = 66'000'000;

  /// Creates FOLDER/published; another one of that name is replaced and stays with those who have mapped it. Throws
  /// std::system_error naming the file.
  BlockWriter(const std::filesystem::path& folder, const BlockContents& contents);
  ~BlockWriter();  ///< removes the file
  BlockWriter(const BlockWriter&) = delete;
  BlockWriter& operator=(const BlockWriter&) = delete;

  /// Whether somebody has asked for shapes and pictures lately.
  bool is_watched() const;
  /// Whether a picture taken at this moment would be shown.
  bool wants_picture(std::int64_t exposure_ns) const {
    return is_watched() && exposure_ns - last_picture_ns_ >= kPictureEvery_ns;
  }
  /// `frame.number` is set here. shape: displacements x y z of the surface's points in 0.01 mm, or empty. The picture,
  /// if there is one, has the block's size.
  void publish(PublishedFrame& frame, std::span<const std::int16_t> shape, const Frame* picture);

 private:
  struct Watcher;
  std::filesystem::path file_;
  std::byte* memory_ = nullptr;
  std::size_t bytes_ = 0;
  std::uint64_t frames_ = 0, pictures_ = 0;
  std::int64_t last_picture_ns_ = 0;
  std::unique_ptr<Watcher> watcher_;
};

/// For other processes. Not thread-safe.
class BlockReader {
 public:
  /// Throws InputError naming what is wrong with the block (another version, cut off, not a block), and
  /// std::system_error if it cannot be opened.
  explicit BlockReader(const std::filesystem::path& folder);
  ~BlockReader();
  BlockReader(const BlockReader&) = delete;
  BlockReader& operator=(const BlockReader&) = delete;

  const BlockContents& contents() const { return contents_; }
  /// The newest frame with its shape (empty if it came without), each from one moment: never a torn one. Nothing before
  /// the first frame, or if the writer overtook the reader several times in a row.
  std::optional<PublishedFrame> frame(std::vector<std::int16_t>* shape = nullptr);
  bool picture(PublishedPicture& picture);
  /// Whether the file is still the one that bears the block's name.
  bool is_current() const;

 private:
  std::filesystem::path file_;
  std::byte* memory_ = nullptr;
  std::size_t bytes_ = 0;
  std::uint64_t inode_ = 0;
  BlockContents contents_;
};

/// Asks for shapes and pictures for the next two seconds. Throws std::system_error.
void watch_block(const std::filesystem::path& folder);

}  // namespace finsight
