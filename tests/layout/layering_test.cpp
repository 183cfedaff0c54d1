// The dependency rules of the layout, checked on the #include lines of every source file.
#include <doctest/doctest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

struct Include {
  std::string file;    // "firmware/shape/newton.cpp"
  std::string folder;  // "firmware/shape"; "firmware" for files directly in it
  std::string target;  // "firmware/model/model.h" or "opencv2/core.hpp"
};

std::vector<Include> all_includes() {
  const fs::path root = FINSIGHT_SOURCE_DIR;
  const std::regex include_line(R"(^\s*#\s*include\s*[<"]([^>"]+)[>"])");
  std::vector<Include> includes;
  for (const char* top : {"firmware", "hostgen"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root / top)) {
      const fs::path& path = entry.path();
      if (path.extension() != ".h" && path.extension() != ".cpp") continue;
      const fs::path relative = fs::relative(path, root);
      std::ifstream in(path);
      for (std::string line; std::getline(in, line);) {
        std::smatch match;
        if (std::regex_search(line, match, include_line)) {
          includes.push_back({relative.string(), relative.parent_path().string(), match[1]});
        }
      }
    }
  }
  return includes;
}

std::string folder_of(const std::string& target) { return fs::path(target).parent_path().string(); }

/// The include lines that break a rule, as text; empty is good.
template <class Rule>
std::string broken(Rule allowed) {
  std::string text;
  for (const Include& include : all_includes()) {
    if (!allowed(include)) text += include.file + " includes " + include.target + "\n";
  }
  return text;
}

std::set<std::string> joined(std::set<std::string> set, const std::set<std::string>& more) {
  set.insert(more.begin(), more.end());
  return set;
}

}  // namespace

TEST_CASE("layering: the rules are checked on a real tree") { CHECK(all_includes().size() > 100); }

TEST_CASE("layering: the firmware never includes hostgen") {
  CHECK(broken([](const Include& i) {
          return !i.folder.starts_with("firmware") || !i.target.starts_with("hostgen/");
        }) == "");
}

TEST_CASE("layering: types.h sees only the standard library and Eigen") {
  CHECK(broken([](const Include& i) {
          return i.file != "firmware/types.h" || i.target.find('/') == std::string::npos ||
                 i.target.starts_with("Eigen/");
        }) == "");
}

// Lowest first. A folder may include itself, what it lists, and the headers at the top (types.h, input_error.h).
// The reader of TOML and the writer of whole files know nothing of the others; everybody may use them.
TEST_CASE("layering: every folder of the firmware includes only those below it") {
  const std::set<std::string> stages = {"firmware/geometry", "firmware/model"};
  const std::set<std::string> loop = {"firmware/geometry", "firmware/model", "firmware/vision",
                                      "firmware/shape",    "firmware/touch", "firmware/modbus"};
  const std::set<std::string> settings = joined(loop, {"firmware/loop", "firmware/ports"});
  const std::map<std::string, std::set<std::string>> below = {
      {"firmware/geometry", {}},
      {"firmware/model", {"firmware/geometry"}},
      {"firmware/vision", stages},
      {"firmware/shape", stages},
      {"firmware/touch", stages},
      {"firmware/modbus", stages},
      {"firmware/ports", {"firmware/geometry"}},
      {"firmware/loop", loop},
      {"firmware/settings", settings},
      {"firmware/published", {}},
      {"firmware/calibrate", joined(settings, {"firmware/settings"})},
      {"firmware/device", joined(settings, {"firmware/settings", "firmware/published"})},
      {"firmware/page",
       {"firmware/calibrate", "firmware/geometry", "firmware/model", "firmware/vision", "firmware/modbus",
        "firmware/published", "firmware/settings"}},
      {"firmware", joined(settings, {"firmware/settings", "firmware/device"})},
  };
  CHECK(broken([&](const Include& i) {
          if (!i.folder.starts_with("firmware") || !i.target.starts_with("firmware/")) return true;
          if (i.target == "firmware/types.h" || i.target == "firmware/input_error.h") return true;
          if (i.target == "firmware/settings/toml_table.h" || i.target == "firmware/settings/atomic_file.h")
            return true;
          // The page reads what finsightd starts with and has a watchdog, too; no other port.
          if (i.folder == "firmware/page" &&
              (i.target == "firmware/ports/session.h" || i.target == "firmware/ports/supervisor.h")) {
            return true;
          }
          const std::string target = folder_of(i.target);
          return below.contains(i.folder) && (target == i.folder || below.at(i.folder).contains(target));
        }) == "");
}

TEST_CASE("layering: only main.cpp, types.h and input_error.h lie directly in firmware/") {
  std::string others;
  for (const auto& entry : fs::directory_iterator(fs::path(FINSIGHT_SOURCE_DIR) / "firmware")) {
    const std::string name = entry.path().filename();
    if (entry.is_directory() || name == "main.cpp" || name == "types.h" || name == "input_error.h") continue;
    if (name != "CMakeLists.txt") others += name + "\n";
  }
  CHECK(others == "");
}

TEST_CASE("layering: an outside library is seen by the folders that it was chosen for") {
  const std::map<std::string, std::set<std::string>> homes = {
      {"opencv2/",
       {"firmware/calibrate", "firmware/vision", "hostgen/accuracy", "hostgen/learn", "hostgen/recordings",
        "hostgen/render"}},
      {"modbus/", {"firmware/modbus"}},
      {"modbus.h", {"firmware/modbus"}},
      {"libcamera/", {"firmware/ports"}},
      {"gpiod.h", {"firmware/ports"}},
      {"toml++/", {"firmware/settings"}},
      {"microhttpd.h", {"firmware/page"}},
      {"turbojpeg.h", {"firmware/page", "firmware/ports", "hostgen/render"}},
      {"nlohmann/",
       {"firmware/device", "firmware/model", "firmware/page", "hostgen/accuracy", "hostgen/bench", "hostgen/commands",
        "hostgen/fit", "hostgen/pack", "hostgen/report"}},
      {"openssl/", {"hostgen/util"}},
      {"metis.h", {"hostgen/fem"}},
      {"png.h", {"hostgen/calibrate"}},
      {"assimp/", {"hostgen/finger"}},
      {"CLI/", {"hostgen", "hostgen/commands", "hostgen/bench"}},
      {"Eigen/CholmodSupport", {"hostgen/bench"}},
  };
  CHECK(broken([&](const Include& i) {
          for (const auto& [prefix, folders] : homes) {
            if (!i.target.starts_with(prefix)) continue;
            if (!folders.contains(i.folder)) return false;
          }
          return true;
        }) == "");
}
