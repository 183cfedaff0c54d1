#include "firmware/settings/toml_table.h"

#include <toml++/toml.h>
#include <algorithm>
#include <array>
#include <charconv>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string_view>

#include "firmware/input_error.h"

namespace finsight {

struct TomlTable::Document {
  std::string file;
  std::filesystem::path folder;
  toml::table root;
};

namespace {

const toml::table& as_table(const void* node) { return *static_cast<const toml::table*>(node); }
const toml::node& as_node(const void* node) { return *static_cast<const toml::node*>(node); }

/// The shortest decimal that reads back as this number; with a point, to tell it from a whole number.
std::string decimal(double value) {
  std::array<char, 32> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
  const std::string number(text.data(), end);
  return number.find_first_not_of("-0123456789") == std::string::npos ? number + ".0" : number;
}

/// A value for a message: always short and on one line.
std::string shown(const toml::node& node) {
  constexpr std::size_t kLongest = 80;
  std::ostringstream out;
  node.visit([&](const auto& value) {
    using T = std::remove_cvref_t<decltype(value)>;
    if constexpr (toml::is_table<T>) {
      out << "a table";
    } else if constexpr (toml::is_floating_point<T>) {
      out << decimal(value.get());
    } else {
      out << value;
    }
  });
  std::string text = out.str();
  if (text.size() > kLongest) text = text.substr(0, kLongest - 3) + "...";
  const auto is_control = [](char c) { return static_cast<unsigned char>(c) < ' ' || c == 127; };
  std::replace_if(text.begin(), text.end(), is_control, ' ');
  return text;
}

std::string range_text(const char* kind, double lowest, double highest) {
  std::ostringstream out;
  out << kind << " from " << lowest << " to " << highest;
  return out.str();
}

}  // namespace

TomlTable::TomlTable(std::vector<Place> layers, std::string name)
    : layers_(std::move(layers)), name_(std::move(name)) {}

namespace {

// toml++ recurses once per part of a dotted key, without a limit. A run of dots that nothing ends is a key.
void check_keys(const std::string& text, const std::string& file) {
  constexpr int kMaxParts = 64;
  constexpr std::string_view kEnds = "\n,={}[]";
  int line = 1, dots = 0;
  for (const char c : text) {
    if (kEnds.find(c) != std::string_view::npos) dots = 0;
    if (c == '\n') ++line;
    if (c == '.' && ++dots >= kMaxParts) {
      throw InputError(file + ":" + std::to_string(line), "a key of more than " + std::to_string(kMaxParts) + " parts");
    }
  }
}

toml::table parsed(const std::string& text, const std::string& file) {
  check_keys(text, file);
  try {
    return toml::parse(text, file);
  } catch (const toml::parse_error& error) {
    throw InputError(file + ":" + std::to_string(error.source().begin.line), std::string(error.description()));
  }
}

// Parsed, a text takes about twenty times its size: a file of tens of megabytes, put onto a card by mistake, would take
// all memory of a board.
constexpr std::uintmax_t kLargest_bytes = 1 << 20;

}  // namespace

TomlTable TomlTable::parse_file(const std::filesystem::path& file) {
  std::error_code ignored;
  if (!std::filesystem::exists(file, ignored)) throw InputError(file.string(), "no such file");
  if (!std::filesystem::is_regular_file(file, ignored)) throw InputError(file.string(), "is not a file");
  if (std::filesystem::file_size(file, ignored) > kLargest_bytes) {
    throw InputError(file.string(), "is larger than 1 MiB, which no such file is");
  }
  auto document = std::make_shared<Document>();
  document->file = file.string();
  document->folder = file.parent_path();
  std::ifstream in(file, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  if (!in) throw InputError(file.string(), "cannot be read");
  document->root = parsed(text, file.string());
  return TomlTable({{document, &document->root}}, "");
}

TomlTable TomlTable::parse_text(const std::string& text, const std::string& name) {
  auto document = std::make_shared<Document>();
  document->file = name;
  document->root = parsed(text, name);
  return TomlTable({{document, &document->root}}, "");
}

TomlTable TomlTable::merged(const TomlTable& changes, const TomlTable& base) {
  std::vector<Place> layers = changes.layers_;
  layers.insert(layers.end(), base.layers_.begin(), base.layers_.end());
  return TomlTable(std::move(layers), "");
}

/// The node of a key, from the first table that has it; null if none does.
const void* TomlTable::lookup(const std::string& key) const {
  for (const Place& place : layers_) {
    if (const toml::node* node = as_table(place.node).get(key)) return node;
  }
  return nullptr;
}

bool TomlTable::has(const std::string& key) const { return lookup(key) != nullptr; }

std::string TomlTable::where(const std::string& key) const {
  const auto inner = std::ranges::find_if(layers_, [](const Place& p) { return p.node != &p.document->root; });
  const Place& place = inner == layers_.end() ? layers_.back() : *inner;
  const void* node = key.empty() ? nullptr : lookup(key);
  const toml::source_region& source = node ? as_node(node).source() : as_table(place.node).source();
  const std::string& file = source.path ? *source.path : place.document->file;
  return source.begin.line > 0 ? file + ":" + std::to_string(source.begin.line) : file;
}

const void* TomlTable::find(const std::string& key, const char* expected, bool required) {
  asked_.push_back(key);
  const void* node = lookup(key);
  if (!node && required) throw InputError(where(), name_ + key, "nothing", expected);
  return node;
}

double TomlTable::number(const std::string& key, double lowest, double highest, std::optional<double> fallback) {
  const std::string expected = range_text("a number", lowest, highest);
  const void* node = find(key, expected.c_str(), !fallback);
  if (!node) return *fallback;
  const auto value = as_node(node).is_number() ? as_node(node).value<double>() : std::nullopt;
  if (!value || !(*value >= lowest && *value <= highest)) {
    throw InputError(where(key), name_ + key, shown(as_node(node)), expected);
  }
  return *value;
}

std::int64_t TomlTable::integer(const std::string& key, std::int64_t lowest, std::int64_t highest,
                                std::optional<std::int64_t> fallback) {
  const std::string expected = "a whole number from " + std::to_string(lowest) + " to " + std::to_string(highest);
  const void* node = find(key, expected.c_str(), !fallback);
  if (!node) return *fallback;
  const auto value = as_node(node).is_integer() ? as_node(node).value<std::int64_t>() : std::nullopt;
  if (!value || *value < lowest || *value > highest) {
    throw InputError(where(key), name_ + key, shown(as_node(node)), expected);
  }
  return *value;
}

bool TomlTable::flag(const std::string& key, std::optional<bool> fallback) {
  const void* node = find(key, "true or false", !fallback);
  if (!node) return *fallback;
  if (!as_node(node).is_boolean()) throw InputError(where(key), name_ + key, shown(as_node(node)), "true or false");
  return *as_node(node).value<bool>();
}

std::string TomlTable::text(const std::string& key, std::optional<std::string> fallback) {
  const void* node = find(key, "a text", !fallback);
  if (!node) return *fallback;
  if (!as_node(node).is_string()) throw InputError(where(key), name_ + key, shown(as_node(node)), "a text");
  return *as_node(node).value<std::string>();
}

std::string TomlTable::choice(const std::string& key, const std::vector<std::string>& choices,
                              std::optional<std::string> fallback) {
  const std::string value = text(key, std::move(fallback));
  if (std::find(choices.begin(), choices.end(), value) != choices.end()) return value;
  std::string expected = "one of";
  for (const std::string& one : choices) expected += " \"" + one + "\"";
  throw InputError(where(key), name_ + key, "\"" + value + "\"", expected);
}

std::vector<double> TomlTable::numbers(const std::string& key, std::size_t count, double lowest, double highest) {
  const std::string expected = (count ? std::to_string(count) + " numbers, each" : std::string("numbers, each")) +
                               range_text("", lowest, highest);
  const void* node = find(key, expected.c_str(), true);
  const auto refuse = [&] { throw InputError(where(key), name_ + key, shown(as_node(node)), expected); };
  const toml::array* array = as_node(node).as_array();
  if (!array || (count && array->size() != count)) refuse();
  std::vector<double> values;
  for (const toml::node& item : *array) {
    const auto value = item.is_number() ? item.value<double>() : std::nullopt;
    if (!value || !(*value >= lowest && *value <= highest)) refuse();
    values.push_back(*value);
  }
  return values;
}

std::vector<std::string> TomlTable::texts(const std::string& key) {
  const char* expected = "texts in brackets, such as [\"a\", \"b\"]";
  const void* node = find(key, expected, true);
  const auto refuse = [&] { throw InputError(where(key), name_ + key, shown(as_node(node)), expected); };
  const toml::array* array = as_node(node).as_array();
  if (!array) refuse();
  std::vector<std::string> values;
  for (const toml::node& item : *array) {
    if (!item.is_string()) refuse();
    values.push_back(*item.value<std::string>());
  }
  return values;
}

std::filesystem::path TomlTable::path(const std::string& key) {
  const std::filesystem::path given = text(key);
  if (given.empty()) throw InputError(where(key), name_ + key, "\"\"", "a path");
  const toml::source_path_ptr& file = as_node(lookup(key)).source().path;
  const auto folder = file ? std::filesystem::path(*file).parent_path() : layers_.back().document->folder;
  return given.is_absolute() ? given : folder / given;
}

TomlTable TomlTable::table(const std::string& key) {
  const void* node = find(key, "a table", true);
  if (!as_node(node).is_table()) throw InputError(where(key), name_ + key, shown(as_node(node)), "a table");
  std::vector<Place> inner;
  for (const Place& place : layers_) {
    const toml::node* found = as_table(place.node).get(key);
    const toml::table* table = found ? found->as_table() : nullptr;
    if (table) inner.push_back({place.document, table});
    if (table && (table->contains("kind") || table->contains("from"))) break;
  }
  return TomlTable(std::move(inner), name_ + key + ".");
}

std::optional<std::filesystem::path> TomlTable::file_instead_of_table(const std::string& key) {
  const void* node = find(key, "a table, or the path of a TOML file", true);
  return as_node(node).is_string() ? std::optional(path(key)) : std::nullopt;
}

std::vector<TomlTable> TomlTable::tables(const std::string& key) {
  const void* node = find(key, "an array of tables", true);
  const toml::array* array = as_node(node).as_array();
  if (!array || array->empty() || !array->is_homogeneous(toml::node_type::table)) {
    throw InputError(where(key), name_ + key, shown(as_node(node)), "an array of tables");
  }
  const auto has_key = [&](const Place& place) { return as_table(place.node).contains(key); };
  const std::shared_ptr<Document>& document = std::ranges::find_if(layers_, has_key)->document;
  std::vector<TomlTable> result;
  for (const toml::node& item : *array) {
    result.push_back(TomlTable({{document, item.as_table()}}, name_ + key + "."));
  }
  return result;
}

void TomlTable::finish() const {
  for (const Place& place : layers_) {
    for (const auto& [key, node] : as_table(place.node)) {
      const std::string name(key.str());
      if (std::find(asked_.begin(), asked_.end(), name) != asked_.end()) continue;
      throw InputError(where(name), name_ + name, "an unknown key", "known keys only");
    }
  }
}

}  // namespace finsight
