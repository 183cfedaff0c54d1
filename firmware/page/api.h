// Paths and what is behind them. README.md beside this file documents them.
#pragma once

#include <cstdint>
#include <functional>
#include <mutex>
#include <span>
#include <string>

#include "firmware/page/bad_pictures.h"
#include "firmware/page/device.h"
#include "firmware/page/http_server.h"
#include "firmware/page/recordings.h"
#include "firmware/page/request_guard.h"
#include "firmware/page/setup.h"
#include "firmware/page/updates.h"

namespace finsight::page {

/// A file of the page, compressed at build time.
struct Asset {
  const char *path, *type;
  std::span<const unsigned char> gzip;
};
std::span<const Asset> assets();  ///< made by embed.py

class Api {
 public:
  /// `settings`: of the finger that this page is of. `fingers`: of all, for the chooser; empty: it is the only one.
  Api(const Settings& settings, Device& device, Setup& setup, BadPictures& bad_pictures, std::span<const Asset> assets,
      std::span<const Settings> fingers = {});
  /// Any request whatever; never throws.
  Answer handle(const Request& request);
  /// Where the bytes of an update go.
  Intake begin_update(const Request& request, std::uint64_t bytes);

 private:
  Answer get(const Request& request);
  Answer post(const Request& request);
  Answer set_up(const std::string& path, const nlohmann::json& body);
  Answer stored(const std::function<std::optional<Refusal>(const Restart&)>& store);
  Answer change(const Request& request, const nlohmann::json& body);
  Answer unlock(const Request& request, const nlohmann::json& body);
  Answer picture();
  Answer shape();
  Answer of_values(Answer (*answer)(const nlohmann::json& values));
  Answer export_all();
  Answer import_all(const nlohmann::json& file);
  nlohmann::json diagnostics();
  Answer everything();
  std::string log() const;

  const Settings& settings_;
  Device& device_;
  Setup& setup_;
  BadPictures& bad_pictures_;
  Sessions sessions_;
  Updates updates_;
  const std::span<const Asset> assets_;
  const Recordings recordings_;
  const std::string fingers_;  ///< names and ports of all fingers' pages, as JSON
  const std::string table_;    ///< the register table as JSON
  // The newest picture, compressed once for all browsers.
  std::uint64_t jpeg_number_ = 0;
  Answer jpeg_;
};

}  // namespace finsight::page
