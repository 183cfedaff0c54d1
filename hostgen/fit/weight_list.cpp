#include "hostgen/fit/weight_list.h"

#include <algorithm>
#include <charconv>

#include "firmware/input_error.h"
#include "hostgen/fit/session_touches.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

namespace fs = std::filesystem;

constexpr double kHeaviest_g = 5000;

std::vector<std::string> split(const std::string& text, char separator) {
  std::vector<std::string> parts(1);
  for (const char c : text) {
    if (c == '\r') continue;
    if (c == separator)
      parts.emplace_back();
    else
      parts.back() += c;
  }
  return parts;
}

template <class Number>
Number number_in(const std::string& text, Number lowest, Number highest, const std::string& where, const char* column) {
  Number number{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc() || end != text.data() + text.size() || !(number >= lowest && number <= highest)) {
    throw InputError(where, column, "\"" + text + "\"",
                     "a number from " + std::to_string(lowest) + " to " + std::to_string(highest));
  }
  return number;
}

}  // namespace

std::vector<ListedWeight> read_weights(const fs::path& file, int holes) {
  const std::vector<std::string> lines = split(read_file(file), '\n');
  std::vector<ListedWeight> weights;
  const auto where = [&](std::size_t line) { return file.string() + ":" + std::to_string(line + 1); };
  if (lines[0] != "session,hole,mass_g") {
    throw InputError(where(0), "header", "\"" + lines[0] + "\"", "\"session,hole,mass_g\"");
  }
  for (std::size_t i = 1; i < lines.size(); ++i) {
    if (lines[i].empty()) continue;
    const std::vector<std::string> cells = split(lines[i], ',');
    if (cells.size() != 3) throw InputError(where(i), "row", std::to_string(cells.size()) + " cells", "3");
    const ListedWeight row{.session = cells[0],
                           .hole = number_in(cells[1], 1, holes, where(i), "hole"),
                           .mass_g = number_in(cells[2], 1.0, kHeaviest_g, where(i), "mass_g")};
    if (std::ranges::find(weights, row.session, &ListedWeight::session) != weights.end()) {
      throw InputError(where(i), "session", "\"" + row.session + "\"", "each session once");
    }
    weights.push_back(row);
  }
  if (weights.empty()) throw InputError(file.string(), "rows", "none", "one per recording");
  return weights;
}

const ListedWeight& listed(const std::vector<ListedWeight>& weights, const fs::path& session, const fs::path& file) {
  const std::string name = session_name(session);
  const auto row = std::ranges::find(weights, name, &ListedWeight::session);
  if (row == weights.end()) throw InputError(file.string(), "session", "no row", "one for \"" + name + "\"");
  return *row;
}

}  // namespace finsight::host
