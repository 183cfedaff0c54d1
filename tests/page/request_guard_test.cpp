#include "firmware/page/request_guard.h"

#include <doctest/doctest.h>

using namespace finsight;
using namespace finsight::page;

namespace {

constexpr std::uint32_t kHere = 0xC0A80007, kThere = 0xC0A80008;
constexpr std::uint16_t kKey = 4711;

Request get(const std::string& host) { return {.method = "GET", .path = "/", .host = host}; }

unsigned status(const std::optional<Refusal>& refusal) { return refusal ? refusal->status : 200; }

}  // namespace

TEST_CASE("request guard: an address, localhost, a .local name and the board file's names are this device's") {
  const std::vector<std::string> names = {"Finger.lan"};
  for (const char* host :
       {"192.168.0.7", "192.168.0.7:8080", "localhost", "LOCALHOST:80", "finsight-42.local", "finger.LAN:80"}) {
    CAPTURE(host);
    CHECK(is_own_host(host, names));
  }
  for (const char* host : {"", "evil.com", "evil.com:80", "192.168.0.7.evil.com", "192.168.0.7:", "192.168.0.7:80:80",
                           "192.168.0.7:8o", "192.168.0.7/", "a.b.local", ".local", "finger.lan.", "localhost.evil.com",
                           "1.2.3", "999.1.1.1", "192.168.0.7:123456"}) {
    CAPTURE(host);
    CHECK_FALSE(is_own_host(host, names));
  }
}

TEST_CASE("request guard: what a page of another site makes a browser send is refused") {
  const PageSettings settings;
  Request request = get("192.168.0.7:8080");
  CHECK(status(check_request(request, settings)) == 200);
  CHECK(status(check_request(get("evil.com"), settings)) == 421);
  request.method = "POST";
  CHECK(status(check_request(request, settings)) == 200);
  request.origin = "http://192.168.0.7:8080";
  CHECK(status(check_request(request, settings)) == 200);
  request.fetch_site = "same-origin";
  CHECK(status(check_request(request, settings)) == 200);
  request.fetch_site = "cross-site";
  CHECK(status(check_request(request, settings)) == 403);
  request.fetch_site = "";
  for (const char* origin : {"http://evil.com", "null", "http://192.168.0.7", "http://192.168.0.7:8080.evil.com"}) {
    request.origin = origin;
    CHECK(status(check_request(request, settings)) == 403);
  }
  request.method = "GET";
  CHECK(status(check_request(request, settings)) == 403);
  request.method = "DELETE";
  CHECK(status(check_request(request, settings)) == 405);
}

TEST_CASE("request guard: from another site only a link leads here") {
  const PageSettings settings;
  Request request = get("192.168.0.7");
  for (const char* site : {"cross-site", "same-site"}) {
    request.fetch_site = site;
    for (const char* mode : {"", "cors", "no-cors", "websocket"}) {
      request.fetch_mode = mode;
      CHECK(status(check_request(request, settings)) == 403);
    }
    request.fetch_mode = "navigate";
    CHECK(status(check_request(request, settings)) == 200);
    request.method = "POST";
    CHECK(status(check_request(request, settings)) == 403);
    request.method = "GET";
  }
}

TEST_CASE("request guard: a token is good for its address while it is used, and no other is") {
  const PageSettings settings;
  Sessions sessions(kKey, settings);
  const Sessions::Unlock first = sessions.unlock(kKey, kHere, 0);
  REQUIRE(first.token.size() == 32);
  CHECK(sessions.unlock(kKey, kHere, 0).token != first.token);
  Request request{.method = "POST", .token = first.token, .client = kHere};
  CHECK(status(sessions.check_token(request, kUnlocked_ns - 1)) == 200);
  CHECK(status(sessions.check_token(request, 2 * kUnlocked_ns - 2)) == 200);  // used in between
  request.client = kThere;
  CHECK(status(sessions.check_token(request, 2 * kUnlocked_ns)) == 401);
  request.client = kHere;
  for (const std::string& token : {std::string(), std::string(32, '0'), first.token + "0", first.token.substr(1)}) {
    request.token = token;
    CHECK(status(sessions.check_token(request, 2 * kUnlocked_ns)) == 401);
  }
  request.token = first.token;
  CHECK(status(sessions.check_token(request, 4 * kUnlocked_ns)) == 401);
  CHECK(status(sessions.check_token(request, 4 * kUnlocked_ns)) == 401);
}

TEST_CASE("request guard: ending a session ends its token") {
  const PageSettings settings;
  Sessions sessions(kKey, settings);
  const std::string token = sessions.unlock(kKey, kHere, 0).token;
  sessions.end(token);
  CHECK(status(sessions.check_token({.token = token, .client = kHere}, 1)) == 401);
}

TEST_CASE("request guard: wrong keys cost their address time, and nobody else any") {
  const PageSettings settings;
  Sessions sessions(kKey, settings);
  unsigned last = 0;
  for (int i = 0; i < 5; ++i) last = sessions.unlock(1, kThere, 0).refusal.status;
  CHECK(last == 429);
  CHECK(sessions.unlock(kKey, kThere, 0).token.empty());
  CHECK(!sessions.unlock(kKey, kHere, 0).token.empty());
  CHECK(!sessions.unlock(kKey, kThere, 100 * kNsPerS).token.empty());
}

TEST_CASE("request guard: only listed addresses may change things") {
  PageSettings settings;
  settings.allow_writes = {*Network::parse("192.168.0.7")};
  Sessions sessions(kKey, settings);
  CHECK(!sessions.unlock(kKey, kHere, 0).token.empty());
  CHECK(sessions.unlock(kKey, kThere, 0).refusal.status == 403);
}
