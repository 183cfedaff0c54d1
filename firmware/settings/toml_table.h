// Strict TOML: every key is asked for once with its range; whatever was not asked for is an error.
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace finsight {

/// A table of a TOML file that knows its place in it. All readers throw InputError naming file:line, the key, what was
/// found and what was expected. Call finish() on every table when all keys have been read.
class TomlTable {
 public:
  static TomlTable parse_file(const std::filesystem::path& file);
  /// `name` stands for the file in messages.
  static TomlTable parse_text(const std::string& text, const std::string& name);

  /// For a table of a whole file: what `file` says takes the place of what stands here, key by key; a table that says
  /// its kind as a whole. Messages name the file that a value came from.
  void override_with(const std::filesystem::path& file);

  bool has(const std::string& key) const;
  double number(const std::string& key, double lowest, double highest, std::optional<double> fallback = std::nullopt);
  std::int64_t integer(const std::string& key, std::int64_t lowest, std::int64_t highest,
                       std::optional<std::int64_t> fallback = std::nullopt);
  bool flag(const std::string& key, std::optional<bool> fallback = std::nullopt);
  std::string text(const std::string& key, std::optional<std::string> fallback = std::nullopt);
  /// A text that must be one of `choices`.
  std::string choice(const std::string& key, const std::vector<std::string>& choices,
                     std::optional<std::string> fallback = std::nullopt);
  /// An array of exactly `count` numbers (any number of them if `count` is 0).
  std::vector<double> numbers(const std::string& key, std::size_t count, double lowest, double highest);
  /// An array of texts.
  std::vector<std::string> texts(const std::string& key);
  /// A path; a relative one is taken from the folder of the file.
  std::filesystem::path path(const std::string& key);

  TomlTable table(const std::string& key);
  /// A table, or the path of a TOML file that is one; a relative path is taken from the folder of the file.
  TomlTable table_or_file(const std::string& key);
  std::vector<TomlTable> tables(const std::string& key);  ///< [[key]], in file order; at least one

  /// Throws for every key that nobody asked for. Sub-tables finish themselves.
  void finish() const;
  /// "file:line" of a key, or of the table itself; for messages of the caller's own checks.
  std::string where(const std::string& key = "") const;

 private:
  struct Document;
  TomlTable(std::shared_ptr<Document> document, const void* node, std::string name);
  const void* find(const std::string& key, const char* expected, bool required);

  std::shared_ptr<Document> document_;
  const void* node_;  // toml::table inside document_
  std::string name_;  // dotted path of this table
  std::vector<std::string> asked_;
};

}  // namespace finsight
