#include "firmware/ports/session.h"

#include <doctest/doctest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <csignal>
#include <fstream>
#include <iterator>
#include <numbers>
#include <system_error>

#include "firmware/geometry/so3.h"
#include "firmware/input_error.h"

using namespace finsight;
namespace fs = std::filesystem;

namespace {

/// A folder of its own for every test, removed afterwards.
struct Folder {
  fs::path path = fs::temp_directory_path() / ("finsight_session_" + std::to_string(getpid()));
  Folder() { fs::create_directories(path); }
  ~Folder() { fs::remove_all(path); }
  fs::path write(const std::string& name, const std::string& bytes) const {
    std::ofstream(path / name, std::ios::binary) << bytes;
    return path / name;
  }
};

std::string contents(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// The message of the InputError that `action` throws; empty if it throws none.
template <class Action>
std::string refusal(Action action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

const std::string kGoodHeader = "YUV4MPEG2 W3 H2 F60:1 Ip A1:1 Cmono\n";

/// Reads all of a file and returns how many frames there were.
int read_all(const fs::path& file) {
  Y4mReader reader(file);
  std::vector<std::uint8_t> grey;
  int frames = 0;
  while (reader.next(grey)) ++frames;
  return frames;
}

SessionInfo some_info() {
  return {.lens = {640, 480, 368.025, 367.95, 307.815, 1.0 / 3, -0.3956, 0.2259, 0, 1e-9, -0.0912},
          .frames_per_second = 59.94,
          .marker_dictionary = "DICT_4X4_50",
          .marker_id = {4, 0, 49},
          .marker_size_mm = 8,
          .description = "a \"quoted\" path C:\\x\nsecond line"};
}

}  // namespace

TEST_CASE("y4m: what was written is read back, frame by frame, again after rewind, and with skips") {
  const Folder folder;
  const fs::path file = folder.path / "frames.y4m";
  const auto image = [](int frame) {
    std::vector<std::uint8_t> grey(7 * 5);
    for (std::size_t i = 0; i < grey.size(); ++i) grey[i] = static_cast<std::uint8_t>(frame * 50 + 3 * i);
    return grey;
  };
  {
    Y4mWriter writer(file, 7, 5, 60);
    for (int frame = 0; frame < 4; ++frame) writer.write(image(frame).data());
    CHECK_FALSE(fs::exists(file));
    writer.finish();
  }
  CHECK(contents(file).starts_with("YUV4MPEG2 W7 H5 F60:1 Ip A1:1 Cmono\nFRAME\n"));
  Y4mReader reader(file);
  CHECK(reader.width_px() == 7);
  CHECK(reader.height_px() == 5);
  CHECK(reader.frames_per_second() == 60);
  std::vector<std::uint8_t> grey;
  for (int pass = 0; pass < 2; ++pass, reader.rewind()) {
    for (int frame = 0; frame < 4; ++frame) {
      if (pass == 1 && frame == 1) {
        REQUIRE(reader.skip());
        continue;
      }
      REQUIRE(reader.next(grey));
      CHECK(grey == image(frame));
    }
    CHECK_FALSE((pass == 0 ? reader.next(grey) : reader.skip()));
  }
}

TEST_CASE("y4m: a rate that is not a whole number is read back") {
  const Folder folder;
  const std::vector<std::uint8_t> grey(16);
  for (const double rate : {59.94, 60000.0 / 1001, 7.5}) {
    Y4mWriter writer(folder.path / "frames.y4m", 4, 4, rate);
    writer.write(grey.data());
    writer.finish();
    CHECK(Y4mReader(folder.path / "frames.y4m").frames_per_second() == doctest::Approx(rate).epsilon(1e-7));
  }
}

TEST_CASE("y4m: an unfinished recording leaves no file behind, a full disk is an error") {
  const Folder folder;
  const std::vector<std::uint8_t> grey(1000 * 1000);
  { Y4mWriter(folder.path / "frames.y4m", 1000, 1000, 60).write(grey.data()); }
  CHECK(fs::is_empty(folder.path));
  std::ofstream(folder.path / "taken") << "a file";
  CHECK_THROWS_AS(Y4mWriter(folder.path / "taken" / "frames.y4m", 8, 8, 60), std::system_error);
  fs::remove(folder.path / "taken");

  // A limit on the file's size stands for a full disk.
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit small{100'000, before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &small);
  {
    Y4mWriter writer(folder.path / "frames.y4m", 1000, 1000, 60);
    CHECK_THROWS_AS(writer.write(grey.data()), std::system_error);
  }
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  CHECK(fs::is_empty(folder.path));
}

TEST_CASE("y4m: headers of other programs are understood") {
  const Folder folder;
  const std::string frame = "FRAME Ip Xremark\nabcdef";
  const std::string header = "YUV4MPEG2 Cmono XCOLORRANGE=FULL F30000:1001 H2 A0:0 I? W3 XYSCSS=GREY\n";
  const fs::path file = folder.write("frames.y4m", header + frame + frame);
  CHECK(read_all(file) == 2);
  CHECK(Y4mReader(file).frames_per_second() == doctest::Approx(29.97).epsilon(1e-4));
}

TEST_CASE("y4m: a file without frames is valid") {
  const Folder folder;
  CHECK(read_all(folder.write("frames.y4m", kGoodHeader)) == 0);
}

TEST_CASE("y4m: malformed and truncated files are refused with the position of the error") {
  struct Case {
    const char* what;
    std::string bytes;
    const char* said;
  };
  const std::string frame = "FRAME\nabcdef";
  const std::vector<Case> cases = {
      {"empty file", "", "byte 0: found '', expected YUV4MPEG2"},
      {"another format", "RIFF....AVI LIST", "byte 0"},
      {"another signature", "YUV4MPEG1 W3 H2 F60:1 Cmono\n" + frame, "expected YUV4MPEG2"},
      {"signature run into", "YUV4MPEG2W3 H2 F60:1 Cmono\n" + frame, "byte 9: found 'W3"},
      {"header without end", "YUV4MPEG2 W3 H2 F60:1 Cmono", "a line that is complete"},
      {"endless header", "YUV4MPEG2 X" + std::string(5000, 'x'), "at most 1024 bytes"},
      {"zero bytes in the header", std::string("YUV4MPEG2 W3\0 H2\n", 17), "byte 10: found 'W3?'"},
      {"no width", "YUV4MPEG2 H2 F60:1 Cmono\n" + frame, "width (W), height (H), frame rate (F) and Cmono"},
      {"no rate", "YUV4MPEG2 W3 H2 Cmono\n" + frame, "width (W), height (H), frame rate (F) and Cmono"},
      {"no colour space, which means 4:2:0", "YUV4MPEG2 W3 H2 F60:1\n" + frame, "and Cmono"},
      {"colour", "YUV4MPEG2 W3 H2 F60:1 C420jpeg\n" + frame, "byte 22: found 'C420jpeg', expected Cmono"},
      {"16 bit grey", "YUV4MPEG2 W3 H2 F60:1 Cmono16\n" + frame, "found 'Cmono16'"},
      {"width 0", "YUV4MPEG2 W0 H2 F60:1 Cmono\n" + frame, "byte 10: found 'W0'"},
      {"negative width", "YUV4MPEG2 W-3 H2 F60:1 Cmono\n" + frame, "found 'W-3'"},
      {"gigantic height", "YUV4MPEG2 W3 H4097 F60:1 Cmono\n" + frame, "from 1 to 4096 pixels"},
      {"overflowing height", "YUV4MPEG2 W3 H99999999999999999999 F60:1 Cmono\n" + frame, "from 1 to 4096 pixels"},
      {"two widths", "YUV4MPEG2 W3 W4 H2 F60:1 Cmono\n" + frame, "byte 13: found 'W4'"},
      {"a number and more", "YUV4MPEG2 W3x H2 F60:1 Cmono\n" + frame, "found 'W3x'"},
      {"rate 0:0", "YUV4MPEG2 W3 H2 F0:0 Cmono\n" + frame, "byte 16: found 'F0:0'"},
      {"rate without ratio", "YUV4MPEG2 W3 H2 F60 Cmono\n" + frame, "found 'F60'"},
      {"rate of nothing", "YUV4MPEG2 W3 H2 F60:0 Cmono\n" + frame, "found 'F60:0'"},
      {"interlaced", "YUV4MPEG2 W3 H2 F60:1 It Cmono\n" + frame, "expected Ip"},
      {"bad aspect", "YUV4MPEG2 W3 H2 F60:1 A1 Cmono\n" + frame, "found 'A1'"},
      {"unknown parameter", "YUV4MPEG2 W3 H2 F60:1 Q7 Cmono\n" + frame, "found 'Q7'"},
      {"empty parameter", "YUV4MPEG2 W3  H2 F60:1 Cmono\n" + frame, "byte 13: found ''"},
      {"no FRAME", kGoodHeader + "abcdef", "byte 36: found 'abcdef', expected a line that is complete"},
      {"FRAME misspelt", kGoodHeader + frame + "FRAMES\nabcdef", "byte 48: found 'FRAMES', expected FRAME of frame 1"},
      {"FRAME without end", kGoodHeader + frame + "FRA", "a line that is complete"},
      {"endless FRAME", kGoodHeader + "FRAME " + std::string(5000, 'x'), "at most 256 bytes"},
      {"first frame cut", kGoodHeader + "FRAME\nabc",
       "frame 0 at byte 42: found the end of the file after 3 bytes, expected 6 bytes"},
      {"last frame cut", kGoodHeader + frame + frame + "FRAME\n", "frame 2 at byte 66"},
      {"one byte too many", kGoodHeader + frame + "g", "byte 48"},
  };
  const Folder folder;
  for (const Case& one : cases) {
    CAPTURE(one.what);
    const fs::path file = folder.write("frames.y4m", one.bytes);
    const std::string said = refusal([&] { read_all(file); });
    CAPTURE(said);
    CHECK(contains(said, file.string()));
    CHECK(contains(said, one.said));
  }
  CHECK(contains(refusal([&] { Y4mReader(folder.path / "none.y4m"); }), "no such file"));
  CHECK(contains(refusal([&] { Y4mReader reader(folder.path); }), "no such file"));
}

TEST_CASE("y4m: a cut frame is also detected when it is skipped") {
  const Folder folder;
  Y4mReader reader(folder.write("frames.y4m", kGoodHeader + "FRAME\nabcdefFRAME\nabcde"));
  CHECK(reader.skip());
  CHECK(contains(refusal([&] { reader.skip(); }), "frame 1 at byte 54: found the end of the file after 5 bytes"));
}

TEST_CASE("session.toml: what was written is read back to the last bit") {
  const Folder folder;
  SessionInfo info = some_info();
  info.readout_ms = 12.5;
  folder.write(kSessionInfo, session_info_toml(info));
  const SessionInfo back = read_session_info(folder.path);
  CHECK(back.lens == info.lens);
  CHECK(back.frames_per_second == info.frames_per_second);
  CHECK(back.readout_ms == info.readout_ms);
  CHECK(back.marker_dictionary == info.marker_dictionary);
  CHECK(back.marker_id == info.marker_id);
  CHECK(back.marker_size_mm == info.marker_size_mm);
  CHECK(back.description == "a \"quoted\" path C:\\x second line");
}

TEST_CASE("session.toml: impossible values are refused by name") {
  struct Change {
    const char* from;
    const char* to;
    const char* said;
  };
  const std::vector<Change> changes = {
      {"width_px = 640", "", "width_px"},
      {"width_px = 640", "width_px = 0", "width_px"},
      {"width_px = 640", "width_px = 640.5", "width_px"},
      {"height_px = 480", "height_px = 100000", "height_px"},
      {"frames_per_second = 59.94", "frames_per_second = nan", "frames_per_second"},
      {"frames_per_second = 59.94", "frames_per_second = \"fast\"", "frames_per_second"},
      {"[368.025,", "[-368.025,", "fx_fy_cx_cy"},
      {"[368.025,", "[inf,", "fx_fy_cx_cy"},
      {"[368.025,", "[", "4 numbers"},
      {"307.815", "640", "a point in the image"},
      {"DICT_4X4_50", "DICT_6X6_250", "DICT_4X4_50"},
      {"[4, 0, 49]", "[4, 0, 50]", "markers.id"},
      {"[4, 0, 49]", "[4, 0, 4]", "three different whole numbers"},
      {"[4, 0, 49]", "[4, 0.5, 49]", "three different whole numbers"},
      {"size_mm = 8", "size_mm = -8", "size_mm"},
      {"size_mm = 8", "size_mm = 8\ncolour = 1", "colour"},
      {"[markers]", "[markers", "session.toml:"},
  };
  const Folder folder;
  for (const Change& change : changes) {
    CAPTURE(change.to);
    std::string text = session_info_toml(some_info());
    const std::size_t at = text.find(change.from);
    REQUIRE(at != std::string::npos);
    text.replace(at, std::string(change.from).size(), change.to);
    folder.write(kSessionInfo, text);
    const std::string said = refusal([&] { read_session_info(folder.path); });
    CAPTURE(said);
    CHECK(contains(said, "session.toml"));
    CHECK(contains(said, change.said));
  }
  fs::remove(folder.path / kSessionInfo);
  CHECK(contains(refusal([&] { read_session_info(folder.path); }), "no such file"));
}

namespace {

const std::string kColumns =
    "recording,frame,marker_tx_mm,marker_ty_mm,marker_tz_mm,marker_qx,marker_qy,marker_qz,marker_qw,"
    "touch_x_mm,touch_y_mm,touch_z_mm,surface_node\n";

}  // namespace

TEST_CASE("recorded motion: marker axes become finger axes") {
  const Folder folder;
  // A quarter turn about the marker's y; 30 degrees about its x, once with the opposite sign of the quaternion.
  const double half = std::numbers::sqrt2 / 2;
  const std::string quarter = std::to_string(half) + ",0," + std::to_string(half);
  const fs::path file = folder.write("motion.csv", kColumns + "a,0,1,2,3,0," + quarter +
                                                       ",10,20,30,7\r\n"
                                                       "b,0,0,0,0,0.2588190451,0,0,0.9659258263,1,2,3,7\n"
                                                       "b,1,0,0,0,-0.2588190451,0,0,-0.9659258263,4,5,6,7");
  const RecordedMotion all = read_recorded_motion(file, "");
  REQUIRE(all.poses.size() == 3);
  const PlateMotion& first = all.poses[0].plates[kTopPlate];
  CHECK(first.displacement_mm.isApprox(Vec3f(-2, -3, 1)));  // marker x is finger +z, y is -x, z is -y
  CHECK(first.rotation_rad.isApprox(Vec3f(-static_cast<float>(std::numbers::pi / 2), 0, 0), 1e-5f));
  CHECK(all.pen_mm[0] == Vec3f(10, 20, 30));
  CHECK(all.poses[0].seen == std::array<bool, kPlates>{true, false, false});
  CHECK(all.poses[0].quality == Quality::kFresh);

  const RecordedMotion one = read_recorded_motion(file, "b");
  REQUIRE(one.poses.size() == 2);
  const Vec3f thirty_degrees(0, 0, static_cast<float>(std::numbers::pi / 6));
  CHECK(one.poses[0].plates[kTopPlate].rotation_rad.isApprox(thirty_degrees, 1e-5f));
  CHECK(one.poses[1].plates[kTopPlate].rotation_rad.isApprox(thirty_degrees, 1e-5f));
  CHECK(one.pen_mm[1] == Vec3f(4, 5, 6));
  CHECK(one.recording == std::vector<std::string>{"b", "b"});
  CHECK(one.surface_node == std::vector<int>{7, 7});
  CHECK(one.line == std::vector<int>{3, 4});
}

TEST_CASE("recorded motion: a rotation about any axis is the same rotation seen from the finger") {
  const Folder folder;
  Eigen::Matrix3d R_finger_marker;
  R_finger_marker << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  REQUIRE(R_finger_marker.determinant() == doctest::Approx(1));
  const Eigen::AngleAxisd in_marker(0.7, Eigen::Vector3d(1, -2, 0.5).normalized());
  const Eigen::Quaterniond q(in_marker);
  const auto text = [](double value) { return std::to_string(value) + ","; };
  const fs::path file = folder.write(
      "motion.csv", kColumns + "a,0,0,0,0," + text(q.x()) + text(q.y()) + text(q.z()) + text(q.w()) + "0,0,0,1\n");
  const Vec3f rotation = read_recorded_motion(file, "a").poses[0].plates[kTopPlate].rotation_rad;
  const Eigen::Matrix3d expected = R_finger_marker * in_marker.toRotationMatrix() * R_finger_marker.transpose();
  CHECK(so3_exp(rotation.cast<double>()).isApprox(expected, 1e-5));
}

TEST_CASE("recorded motion: damaged files are refused with line and column") {
  struct Case {
    const char* what;
    std::string bytes;
    const char* said;
  };
  const std::string good = "a,0,1,2,3,0,0,0,1,10,20,30,7\n";
  const std::vector<Case> cases = {
      {"empty file", "", "no row"},
      {"only the header", kColumns, "no row"},
      {"no header", good, ":1: column 1 (recording): found 'a'"},
      {"another column order", "frame,recording" + kColumns.substr(15) + good, ":1: column 1 (recording)"},
      {"renamed column", kColumns.substr(0, kColumns.size() - 2) + "\n" + good, ":1: column 13 (surface_node)"},
      {"missing column", kColumns + good + "a,1,1,2,3,0,0,0,1,10,20,30\n", ":3: row: found 12 columns, expected 13"},
      {"too many columns", kColumns + good + "a,1,1,2,3,0,0,0,1,10,20,30,7,\n", ":3: row: found 14 columns"},
      {"blank line", kColumns + good + "\n" + good, ":3: row: found 1 columns"},
      {"a word", kColumns + "a,0,one,2,3,0,0,0,1,10,20,30,7\n", ":2: column 3 (marker_tx_mm): found 'one'"},
      {"nothing", kColumns + "a,0,1,,3,0,0,0,1,10,20,30,7\n", ":2: column 4 (marker_ty_mm): found ''"},
      {"a unit", kColumns + "a,0,1,2,3mm,0,0,0,1,10,20,30,7\n", ":2: column 5 (marker_tz_mm): found '3mm'"},
      {"a space", kColumns + "a,0,1,2, 3,0,0,0,1,10,20,30,7\n", ":2: column 5 (marker_tz_mm)"},
      {"not a number", kColumns + "a,0,nan,2,3,0,0,0,1,10,20,30,7\n", ":2: column 3"},
      {"infinity", kColumns + "a,0,1,2,3,0,0,0,1,10,inf,30,7\n", ":2: column 11 (touch_y_mm): found 'inf'"},
      {"beyond float", kColumns + "a,0,1e200,2,3,0,0,0,1,10,20,30,7\n", ":2: column 3"},
      {"beyond double", kColumns + "a,0,1e999,2,3,0,0,0,1,10,20,30,7\n", ":2: column 3"},
      {"quaternion of zeros", kColumns + "a,0,1,2,3,0,0,0,0,10,20,30,7\n", ":2: column 6 (marker_qx)"},
      {"quaternion too long", kColumns + "a,0,1,2,3,0,0,0.2,1,10,20,30,7\n", "length 1 within 0.01"},
      {"fault in a recording not asked for", kColumns + good + "b,0,1,2,3,0,0,0,1,10,20,x,7\n", ":3: column 12"},
      {"half a contact point", kColumns + "a,0,1,2,3,0,0,0,1,10,20,30,7.5\n",
       ":2: column 13 (surface_node): found '7.5'"},
      {"no such recording", kColumns + "c,0,1,2,3,0,0,0,1,10,20,30,7\n", "none named 'a', expected one of 1"},
  };
  const Folder folder;
  for (const Case& one : cases) {
    CAPTURE(one.what);
    const fs::path file = folder.write("motion.csv", one.bytes);
    const std::string said = refusal([&] { read_recorded_motion(file, one.bytes == kColumns ? "" : "a"); });
    CAPTURE(said);
    CHECK(contains(said, file.string()));
    if (one.bytes.empty()) continue;
    CHECK(contains(said, one.said));
  }
  CHECK(contains(refusal([&] { read_recorded_motion(folder.path / "none.csv", ""); }), "no such file"));
}
