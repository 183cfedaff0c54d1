// A recorded session: a folder with frames.y4m, session.toml and optional truth.csv. And pose files: recorded plate
// motions instead of images.
#pragma once

#include <array>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/geometry/lens.h"
#include "firmware/settings/atomic_file.h"
#include "firmware/settings/toml_table.h"
#include "firmware/types.h"

namespace finsight {

/// Names of the files in a session's folder.
inline constexpr const char* kSessionFrames = "frames.y4m";
inline constexpr const char* kSessionInfo = "session.toml";
inline constexpr const char* kSessionTruth = "truth.csv";

/// session.toml: what is not in the images themselves.
struct SessionInfo {
  Lens lens;  ///< and the images' size
  double frames_per_second = 0;
  std::string marker_dictionary;         ///< "DICT_4X4_50"
  std::array<int, kPlates> marker_id{};  ///< top, middle, low
  double marker_size_mm = 0;             ///< side of the black square
  std::string description;               ///< what was recorded
  /// The acceleration of things that fall, in the finger frame and in g, if the finger did not turn meanwhile.
  std::optional<Vec3f> gravity_g = std::nullopt;
  Coding coding = Coding::kLinear;
  double readout_ms = 0;   ///< from the first row's exposure to the last's; 0: all at once
  bool from_rest = false;  ///< nothing differs at rest from the finger's pack: no zero is needed
  bool complete = true;    ///< false: the recording was cut off; its last frame may be half written
};
/// The lens of images of this size: keys fx_fy_cx_cy and k1_k2_p1_p2_k3 of a table, the same in session.toml, in a
/// board file, and in a file of its own. Strict; width_px and height_px may stand beside them if they are the images'.
Lens read_lens(TomlTable table, int width_px, int height_px);
/// Key coding of a table: "linear" (the default) or "srgb".
Coding read_coding(TomlTable& table);
/// Key readout_ms of a table: of a camera with a rolling shutter; 0 without.
double read_readout_ms(TomlTable& table);
/// The lines that read_lens() reads, without the size.
std::string lens_toml(const Lens& lens);
/// Strict: unknown keys, wrong types, numbers that cannot be a lens or repeated marker ids throw InputError.
SessionInfo read_session_info(const std::filesystem::path& folder);
/// Throws InputError unless the session shows the markers of this finger (`finger` is its name in the message).
void check_markers(const SessionInfo& info, const std::filesystem::path& folder,
                   const std::array<int, kPlates>& marker_id, double marker_size_mm, const std::string& finger);
/// The text of session.toml; read_session_info() gives the same numbers back, to the last bit.
std::string session_info_toml(const SessionInfo& info);

/// Reads frames.y4m (YUV4MPEG2 with Cmono, progressive, at most kMaxSide pixels wide and high) one frame at a time.
/// Throws InputError with the byte position for anything malformed, and with the number of the frame (from 0) if it is
/// cut, unless it may be.
class Y4mReader {
 public:
  static constexpr int kMaxSide = 4096;

  /// `may_be_cut`: a last frame that is not whole is the end, as of a recording that was cut off.
  explicit Y4mReader(const std::filesystem::path& file, bool may_be_cut = false);
  ~Y4mReader();
  Y4mReader(const Y4mReader&) = delete;
  Y4mReader& operator=(const Y4mReader&) = delete;
  int width_px() const { return width_px_; }
  int height_px() const { return height_px_; }
  double frames_per_second() const { return frames_per_second_; }
  /// Fills `grey` (width * height bytes); false at the end of the file.
  bool next(std::vector<std::uint8_t>& grey);
  /// Skips a frame without reading its pixels; false at the end of the file.
  bool skip();
  void rewind();
  std::int64_t whole_frames() const;  ///< how many the file's size has room for

 private:
  std::string read_line(std::size_t longest);
  void read_stream_header();
  void read_parameter(std::string_view parameter, std::int64_t at);
  bool read_frame_header();
  [[noreturn]] void refuse(std::int64_t at, std::string_view found, const std::string& expected) const;
  [[noreturn]] void refuse_cut_frame(std::int64_t bytes_found) const;

  std::FILE* file_ = nullptr;
  std::string name_;
  bool may_be_cut_ = false;
  std::int64_t position_ = 0, first_frame_ = 0;
  std::int64_t frame_ = 0;  // number of the frame at position_
  std::int64_t frame_bytes_ = 0;
  int width_px_ = 0, height_px_ = 0;
  double frames_per_second_ = 0;
};

/// The text that frames.y4m begins with, and that before each frame's pixels.
std::string y4m_header(int width_px, int height_px, double frames_per_second);
inline constexpr std::string_view kY4mFrame = "FRAME\n";

/// Writes frames.y4m; the file has its name only once finish() has put it on the disk, see AtomicFile. Throws
/// std::system_error.
class Y4mWriter {
 public:
  Y4mWriter(const std::filesystem::path& file, int width_px, int height_px, double frames_per_second);
  void write(const std::uint8_t* grey);  ///< width * height bytes
  void finish();

 private:
  AtomicFile file_;
  std::size_t frame_bytes_ = 0;
};

/// Plate motions recorded by one marker of a real finger: the CSV columns recording, frame, marker_tx_mm .. tz_mm,
/// marker_qx .. qw, touch_x_mm .. z_mm, surface_node. The marker's axes are x = finger +z, y = finger -x, z = finger
/// -y; motions come out in the finger frame. Only the top plate is seen.
struct RecordedMotion {
  std::vector<PlatePoses> poses;
  std::vector<Vec3f> pen_mm;  ///< where the pen's tip was
  // What a row belongs to, and where in the file it stands.
  std::vector<std::string> recording;
  std::vector<int> surface_node;  ///< label of the contact point
  std::vector<int> line;          ///< of the file, from 1
};
/// One recording of the file; all of them, in file order, when `recording` is empty. Throws InputError with the line
/// and column: wrong columns, what is not a finite number, quaternions that are not of length 1 within 1e-2, no such
/// recording.
RecordedMotion read_recorded_motion(const std::filesystem::path& csv, const std::string& recording);

}  // namespace finsight
