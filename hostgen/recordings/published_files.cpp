#include "hostgen/recordings/published_files.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <set>
#include <sstream>
#include <vector>

#include "firmware/input_error.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

constexpr const char* kHeader =
    "recording,frame,marker_tx_mm,marker_ty_mm,marker_tz_mm,marker_qx,marker_qy,marker_qz,marker_qw,touch_x_mm,"
    "touch_y_mm,touch_z_mm,surface_node\n";
constexpr int kMaxDepth = 100;      // of nested lists; OpenCV's parser recurses
constexpr double kMaxNumber = 1e4;  // mm; no part of a finger is that far away
constexpr std::array<const char*, 3> kMarkers = {"bc_top", "bc_bot1", "bc_bot2"};

std::vector<std::filesystem::path> files_of(const std::filesystem::path& folder) {
  if (!std::filesystem::is_directory(folder)) throw InputError(folder.string(), "is not a folder");
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string ending = entry.path().extension();
    if (ending == ".yml" || ending == ".yaml") files.push_back(entry.path());
  }
  if (files.empty()) throw InputError(folder.string(), "files", "no .yml file", "the published recordings");
  std::sort(files.begin(), files.end());
  return files;
}

std::string shown(double value) {
  std::ostringstream text;
  text << value;
  return text.str();
}

// One recording's points, each checked.
class Reader {
 public:
  explicit Reader(std::filesystem::path file) : file_(std::move(file)) {
    name_ = file_.stem().string();
    std::erase(name_, ':');
    if (name_.empty() || name_.find_first_of(",\"\r\n") != std::string::npos) {
      throw InputError(file_.string(), "file name", name_.empty() ? "none" : "a comma, quote or line break",
                       "a name that fits in a CSV");
    }
    const std::string text = read_file(file_);
    check_depth(text);
    try {
      storage_.open(text, cv::FileStorage::READ | cv::FileStorage::MEMORY | cv::FileStorage::FORMAT_YAML);
    } catch (const cv::Exception& error) {
      throw InputError(file_.string(), "is not OpenCV YAML: " + error.err);
    }
  }

  const std::string& name() const { return name_; }

  void append_to(PublishedFiles& result) {
    if (!storage_.root().isMap())
      throw InputError(file_.string(), "is not one of the published files: no keys at the top level");
    const cv::FileNode points = storage_["points"];
    if (!points.isSeq()) throw InputError(file_.string(), "points", "none", "a list");
    const cv::FileNode announced = storage_["number_of_points"];
    if (!announced.isInt() || static_cast<int>(announced) != static_cast<int>(points.size())) {
      throw InputError(file_.string(), "number_of_points",
                       announced.isInt() ? std::to_string(static_cast<int>(announced)) : "not an integer",
                       "the number of points, " + std::to_string(points.size()));
    }
    for (const cv::FileNode& point : points) append_point(point, result);
    ++result.files;
  }

 private:
  void check_depth(const std::string& text) const {
    int depth = 0;
    for (const char c : text) {
      depth += (c == '[' || c == '{') - (c == ']' || c == '}');
      if (depth > kMaxDepth) {
        throw InputError(file_.string(), "lists in lists", std::to_string(depth),
                         "at most " + std::to_string(kMaxDepth));
      }
    }
  }

  template <std::size_t kCount>
  std::array<double, kCount> numbers(const cv::FileNode& point, const char* key) const {
    const cv::FileNode list = point.isMap() ? point[key] : cv::FileNode();
    const auto refuse = [&](const std::string& found) {
      throw InputError(file_.string(), "point " + std::to_string(frame_) + ", " + key, found,
                       std::to_string(kCount) + " numbers");
    };
    if (!list.isSeq()) refuse("no list");
    if (list.size() != kCount) refuse(std::to_string(list.size()) + " entries");
    std::array<double, kCount> values{};
    for (std::size_t i = 0; i < kCount; ++i) {
      const cv::FileNode value = list[static_cast<int>(i)];
      if (!value.isReal() && !value.isInt()) refuse("an entry that is not a number");
      values[i] = static_cast<double>(value);
      if (!(std::abs(values[i]) < kMaxNumber)) refuse(shown(values[i]));
    }
    return values;
  }

  void append_point(const cv::FileNode& point, PublishedFiles& result) {
    const auto touch = numbers<3>(point, "gt_point");
    std::array<std::array<double, 7>, 3> markers;
    for (std::size_t m = 0; m < 3; ++m) markers[m] = numbers<7>(point, kMarkers[m]);
    const cv::FileNode node = point["surface_node"];
    if (!node.isInt() || static_cast<int>(node) < 0) {
      throw InputError(file_.string(), "point " + std::to_string(frame_) + ", surface_node",
                       node.isInt() ? std::to_string(static_cast<int>(node)) : "none", "a node's number");
    }
    const auto& m = markers[0];
    const double length = std::sqrt(m[3] * m[3] + m[4] * m[4] + m[5] * m[5] + m[6] * m[6]);
    if (!(std::abs(length - 1) < 0.01)) {
      throw InputError(file_.string(), "point " + std::to_string(frame_) + ", " + kMarkers[0],
                       "a quaternion of length " + shown(length), "one of length 1");
    }
    char line[320];
    std::snprintf(line, sizeof line, ",%d,%.5f,%.5f,%.5f,%.7f,%.7f,%.7f,%.7f,%.5f,%.5f,%.5f,%d\n", frame_, m[0], m[1],
                  m[2], m[3], m[4], m[5], m[6], touch[0], touch[1], touch[2], static_cast<int>(node));
    result.csv += name_ + line;
    result.identical_markers += markers[1] == m && markers[2] == m;
    ++result.rows;
    ++frame_;
  }

  std::filesystem::path file_;
  std::string name_;
  cv::FileStorage storage_;
  int frame_ = 0;
};

}  // namespace

PublishedFiles convert_published_files(const std::filesystem::path& folder) {
  const std::vector<std::filesystem::path> files = files_of(folder);
  PublishedFiles result;
  result.csv = kHeader;
  Progress progress("recordings", files.size());
  std::set<std::string> names;
  for (const std::filesystem::path& file : files) {
    if (interrupted()) throw Interrupted();
    Reader reader(file);
    if (!names.insert(reader.name()).second) {
      throw InputError(file.string(), "file name", "a second recording \"" + reader.name() + "\"", "a name of its own");
    }
    reader.append_to(result);
    progress.advance();
  }
  return result;
}

}  // namespace finsight::host
