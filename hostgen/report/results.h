// results.json: every figure that was measured, none typed in; what was not measured is null with its reason beside it.
// scripts/lib/report_page.py makes the page from it.
#pragma once

#include <filesystem>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace finsight::host {

/// The report's figures, kept between runs: an area that is not measured keeps its figures and their date.
class Results {
 public:
  /// Reads `file` if it exists (throws InputError if it is damaged) and adds every missing key as null.
  explicit Results(std::filesystem::path file);
  ~Results();
  Results(const Results&) = delete;
  Results& operator=(const Results&) = delete;

  /// Replaces figures by those of `figures`, key by key, and dates the area.
  void measured(const std::string& area, const nlohmann::json& figures, const std::string& profile);
  const nlohmann::json& all() const;
  void write() const;

 private:
  std::filesystem::path file_;
  std::unique_ptr<nlohmann::json> json_;
};

}  // namespace finsight::host
