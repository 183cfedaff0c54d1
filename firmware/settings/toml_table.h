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

/// A table of a TOML file, or of several merged ones, that knows where its values stand. All readers throw InputError
/// naming file:line, the key, what was found and what was expected. Call finish() on every table when all keys have
/// been read.
class TomlTable {
 public:
  /// Of at most 1 MiB.
  static TomlTable parse_file(const std::filesystem::path& file);
  /// `name` stands for the file in messages.
  static TomlTable parse_text(const std::string& text, const std::string& name);

  /// Both as one table: the values of `changes`, and those of `base` for keys that `changes` does not have. Tables of
  /// the same name are merged likewise, except that one with a key "kind" or "from", which say what sort of thing it
  /// describes, replaces the other as a whole. Neither is altered. Messages name the file that a value came from.
  /// Either may be an inner table or a merged one.
  static TomlTable merged(const TomlTable& changes, const TomlTable& base);

  bool has(const std::string& key) const;
  double number(const std::string& key, double lowest, double highest, std::optional<double> fallback = std::nullopt);
  std::int64_t integer(const std::string& key, std::int64_t lowest, std::int64_t highest,
                       std::optional<std::int64_t> fallback = std::nullopt);
  bool flag(const std::string& key, std::optional<bool> fallback = std::nullopt);
  std::string text(const std::string& key, std::optional<std::string> fallback = std::nullopt);
  /// A text, one of `choices`.
  std::string choice(const std::string& key, const std::vector<std::string>& choices,
                     std::optional<std::string> fallback = std::nullopt);
  /// An array of exactly `count` numbers (any number of them if `count` is 0).
  std::vector<double> numbers(const std::string& key, std::size_t count, double lowest, double highest);
  /// An array of texts.
  std::vector<std::string> texts(const std::string& key);
  /// A path; a relative one starts at the folder of the file that it stands in.
  std::filesystem::path path(const std::string& key);

  TomlTable table(const std::string& key);
  /// Of a key that holds a table, or the path of a TOML file with that table: the path; nothing if it holds no text.
  std::optional<std::filesystem::path> file_instead_of_table(const std::string& key);
  std::vector<TomlTable> tables(const std::string& key);  ///< [[key]], in file order; at least one

  /// Of keys that another reader has taken.
  void has_been_read(const std::vector<std::string>& keys) { asked_.insert(asked_.end(), keys.begin(), keys.end()); }
  /// Throws for every key that nobody asked for. Inner tables have a finish() of their own.
  void finish() const;
  /// "file:line" of a key, or of the table itself; for messages of the caller's own checks. Of merged tables it is the
  /// first that is not a whole file, such as a [[finger]].
  std::string where(const std::string& key = "") const;

 private:
  struct Document;
  struct Place {
    std::shared_ptr<Document> document;
    const void* node;  ///< toml::table inside the document
  };
  TomlTable(std::vector<Place> layers, std::string name);
  const void* lookup(const std::string& key) const;
  const void* find(const std::string& key, const char* expected, bool required);

  std::vector<Place> layers_;  ///< one per merged table, of which the first that has a key gives its value
  std::string name_;           ///< dotted path of this table
  std::vector<std::string> asked_;
};

}  // namespace finsight
