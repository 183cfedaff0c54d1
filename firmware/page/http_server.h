// HTTP/1.1 by libmicrohttpd: bounded connections, memory and time; requests in, answers out; streams of events. The
// only folder that sees libmicrohttpd.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "firmware/page/request_guard.h"
#include "firmware/page/updates.h"
#include "firmware/settings/settings.h"

namespace finsight::page {

struct Answer {
  unsigned status = 200;
  std::string type = "application/json";
  std::string body = {};
  std::string file_name = "";                                    ///< to be saved under; empty: to be shown
  std::vector<std::pair<std::string, std::string>> fields = {};  ///< further header fields
  bool is_gzip = false;                                          ///< the body is compressed
  bool may_be_kept = false;                                      ///< by the browser, which still asks each time
  /// Instead of the body: gives the next bytes (at most `room`), 0 at the end, negative where it fails.
  std::function<std::int64_t(char* bytes, std::size_t room)> more = nullptr;
  bool is_event_stream = false;  ///< instead of the body
};

/// {"error": reason} with that status.
Answer refused(const Refusal& refusal);

class HttpServer {
 public:
  // An attacker of one address leaves room for the others.
  static constexpr unsigned kMostConnections = 96, kMostPerAddress = 24, kMostStreams = 12, kMostStreamsPerAddress = 6;
  static constexpr unsigned kSilence_s = 15;  ///< a connection without progress is closed after this
  /// A request must be complete within this time, however slowly it comes.
  static constexpr std::int64_t kRequestTime_ns = 20 * kNsPerS;
  static constexpr std::size_t kConnectionMemory = 24 * 1024;  ///< bounds the header, too
  static constexpr std::size_t kLongestBody = 256 * 1024;
  static constexpr const char* kUploadPath = "/api/update/file";

  /// Listens; throws std::system_error naming address and port. `handle` is called from one thread, with requests that
  /// check_request() let through. `begin_upload` says where the body of a POST to kUploadPath goes, which may be long;
  /// `handle` is called when all of it was taken.
  HttpServer(const PageSettings& settings, std::function<Answer(const Request&)> handle,
             std::function<Intake(const Request&, std::uint64_t bytes)> begin_upload);
  ~HttpServer();

  /// To every stream that has taken what was sent before; others get the newest once they have. Kind 0 and 1 are kept
  /// apart, so that neither hides the other.
  void send_event(int kind, const std::string& name, const std::string& data);
  int streams() const;
  /// Closes connections whose requests take too long. To be called about every second.
  void close_slow(std::int64_t now_ns);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace finsight::page
