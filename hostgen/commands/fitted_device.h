// What `fit` and `verify` are told of a device, and the readings that it would publish for recordings.
#pragma once

#include <CLI/CLI.hpp>

#include "hostgen/finger/spec.h"
#include "hostgen/fit/session_touches.h"

namespace finsight::host {

struct FittedDevice {
  std::vector<std::filesystem::path> sessions;
  std::filesystem::path spec, pack, fit, mount;
  std::int64_t date = 0;
  int smoothing_ms = 0;

  void add_options(CLI::App& command);
  /// Throws InputError if the pack was made from another spec.
  FingerSpec read_spec(const Model& model) const;
  /// Nothing if none was named. Throws InputError if it was made with another pack.
  std::optional<FitValues> read_fit(const Model& model) const;
  /// Of the recordings, in days (see days_of). Throws InputError for a day that does not exist.
  std::uint16_t day() const;
  /// With the mount that was named and this fit: of every session in its order, on all cores, with
  /// progress. The first one's zero serves all, see session_touches. Throws InputError if one of the files cannot be
  /// used, if a recording is given twice, and as session_touches does.
  std::vector<SessionTouches> touches(const Model& model, const std::optional<FitValues>& of_device) const;
};

}  // namespace finsight::host
