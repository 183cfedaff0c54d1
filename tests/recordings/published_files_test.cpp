#include "hostgen/recordings/published_files.h"

#include <doctest/doctest.h>
#include <unistd.h>

#include <fstream>

#include "firmware/input_error.h"
#include "firmware/ports/session.h"

using namespace finsight;
using namespace finsight::host;
namespace fs = std::filesystem;

namespace {

struct Folder {
  fs::path path = fs::temp_directory_path() / ("finsight_published_" + std::to_string(getpid()));
  Folder() { fs::create_directories(path); }
  ~Folder() { fs::remove_all(path); }
  fs::path write(const std::string& name, const std::string& bytes) const {
    std::ofstream(path / name, std::ios::binary) << bytes;
    return path / name;
  }
};

// One point in the layout of the published files, lists broken over two lines.
std::string point(const std::string& touch_x, const std::string& third_marker_x) {
  const std::string rest =
      " 3.0956465005874634e-01,\n          7.8283995389938354e-01, 0., 0., 6.0000000000000000e-01, "
      "8.0000000000000000e-01 ]\n";
  return "   -\n      gt_point: [ " + touch_x +
         ", 1.0730104827880859e+02,\n          -4.6202850341796875e+00 ]\n"
         "      bc_top: [ 5.5617183446884155e-01," +
         rest + "      bc_bot1: [ 5.5617183446884155e-01," + rest + "      bc_bot2: [ " + third_marker_x + "," + rest +
         "      surface_node: 476\n";
}

const std::string kSame = "5.5617183446884155e-01";
std::string file_of(const std::string& points, int count) {
  return "%YAML:1.0\n---\nnumber_of_points: " + std::to_string(count) + "\npoints:\n" + points;
}

std::string with(std::string text, const std::string& old, const std::string& other) {
  return text.replace(text.find(old), old.size(), other);
}

std::string refusal(const fs::path& folder) {
  try {
    convert_published_files(folder);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("published files: points become rows, files become recordings in the order of their names") {
  const Folder folder;
  folder.write("16:20:00.yml", file_of(point("2.", kSame), 1));
  folder.write("16:19:22.yml", file_of(point("1.0627712249755859e+01", kSame) + point("-1.5", "9."), 2));
  folder.write("notes.txt", "not a recording");
  const PublishedFiles files = convert_published_files(folder.path);
  CHECK(files.files == 2);
  CHECK(files.rows == 3);
  CHECK(files.identical_markers == 2);
  const std::string marker = "0.55617,0.30956,0.78284,0.0000000,0.0000000,0.6000000,0.8000000,";
  const std::string expected =
      "recording,frame,marker_tx_mm,marker_ty_mm,marker_tz_mm,marker_qx,marker_qy,marker_qz,marker_qw,touch_x_mm,touch_"
      "y_mm,"
      "touch_z_mm,surface_node\n"
      "161922,0," +
      marker + "10.62771,107.30105,-4.62029,476\n161922,1," + marker + "-1.50000,107.30105,-4.62029,476\n162000,0," +
      marker + "2.00000,107.30105,-4.62029,476\n";
  CHECK(files.csv == expected);
  const RecordedMotion motion = read_recorded_motion(folder.write("all.csv", files.csv), "");
  CHECK(motion.recording == std::vector<std::string>{"161922", "161922", "162000"});
  CHECK(motion.surface_node == std::vector<int>{476, 476, 476});
  CHECK(motion.line == std::vector<int>{2, 3, 4});
}

TEST_CASE("published files: faults are reported with file, point and field") {
  struct Case {
    std::string bytes, said;
  };
  std::string short_list = point("1.", kSame), no_node = point("1.", kSame);
  short_list.replace(short_list.find("1., 1.073"), 3, "");
  no_node.erase(no_node.find("      surface_node"));
  const Case cases[] = {
      {"", "YAML"},
      {"words: [", "YAML"},
      {"%YAML:1.0\n---\nnumber_of_points: 1\n", "points: found none"},
      {"%YAML:1.0\n---\n- 1\n- 2\n", "no keys at the top level"},
      {"%YAML:1.0\n---\nnumber_of_points: 2\npoints: [ 1, 2 ]\n", "point 0, gt_point: found no list"},
      {"%YAML:1.0\n---\npoints: " + std::string(100000, '['), "lists in lists: found 101"},
      {file_of(point("1.", kSame), 2), "number_of_points: found 2, expected the number of points, 1"},
      {file_of(short_list, 1), "point 0, gt_point: found 2 entries, expected 3 numbers"},
      {file_of(point("one", kSame), 1), "point 0, gt_point: found an entry that is not a number"},
      {file_of(point(".Nan", kSame), 1), "nan, expected 3 numbers"},
      {file_of(point("1e300", kSame), 1), "point 0, gt_point: found 1e+300, expected 3 numbers"},
      {file_of(with(point("1.", kSame), "6.0000000000000000e-01", "600."), 1), "found a quaternion of length 600.001"},
      {file_of(with(point("1.", kSame), "476", "-7"), 1), "point 0, surface_node: found -7"},
      {file_of(point("1.", "-.Inf"), 1), "point 0, bc_bot2: found -inf, expected 7 numbers"},
      {file_of(point("1.", kSame) + no_node, 2), "point 1, surface_node: found none"},
  };
  for (const Case& one : cases) {
    const Folder folder;
    folder.write("a.yml", one.bytes);
    const std::string said = refusal(folder.path);
    CAPTURE(said);
    CHECK(said.find(one.said) != std::string::npos);
    CHECK(said.find("a.yml") != std::string::npos);
  }
  {
    const Folder odd;
    odd.write("a,b.yml", file_of(point("1.", kSame), 1));
    CHECK(refusal(odd.path).find("a,b.yml: file name: found a comma") != std::string::npos);
  }
  {
    const Folder long_name;
    long_name.write(std::string(240, 'n') + ".yml", file_of(point("1.", kSame), 1));
    const std::string csv = convert_published_files(long_name.path).csv;
    CHECK(csv.ends_with("-4.62029,476\n"));
  }
  {
    const Folder twice;
    twice.write("16:20.yml", file_of(point("1.", kSame), 1));
    twice.write("1620.yaml", file_of(point("1.", kSame), 1));
    CHECK(refusal(twice.path).find("a second recording \"1620\"") != std::string::npos);
  }
  const Folder empty;
  CHECK(refusal(empty.path).find("no .yml file") != std::string::npos);
  CHECK(refusal(empty.path / "none").find("is not a folder") != std::string::npos);
}
