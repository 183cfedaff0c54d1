// finsight-page: what finsightd sees and measures, in a browser. Reads what finsightd publishes in memory, and changes
// things only as a Modbus client does.
#include <arpa/inet.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <future>
#include <string>
#include <thread>
#include <vector>

#include "firmware/input_error.h"
#include "firmware/modbus/descriptor.h"
#include "firmware/page/api.h"
#include "firmware/page/device.h"
#include "firmware/page/http_server.h"
#include "firmware/page/setup.h"
#include "firmware/ports/supervisor.h"
#include "firmware/settings/settings.h"

namespace {

using namespace finsight;

constexpr const char* kUsage =
    "finsight-page: the commissioning page of each finger, for a browser.\n"
    "\n"
    "usage: finsight-page --settings FILE [--user FILE]\n"
    "  --settings FILE   finsightd's board file, whose [page] says where to listen; see boards/replay/board.toml.\n"
    "                    Of several fingers the first has that port, the others the next ones\n"
    "  --user FILE       its values replace the board file's\n"
    "  --help, --version\n"
    "\n"
    "Shows what finsightd publishes, and changes things as a Modbus client, once a browser has given the write_key.\n"
    "Stops on SIGINT and SIGTERM. exit codes: 0 done, 1 failed at work (port in use), 2 bad arguments or no [page]\n";

constexpr std::chrono::milliseconds kEvery(60);  // so many events a second that people see motion
constexpr std::int64_t kRegistersEvery_ns = kNsPerS / 2, kCloseEvery_ns = kNsPerS;

std::atomic<bool> stop_requested{false};

void log_line(const std::string& message) { std::fprintf(stderr, "finsight-page: %s\n", message.c_str()); }

struct Arguments {
  std::string settings, user;
};

Arguments parse(int argc, char** argv) {
  Arguments arguments;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word != "--settings" && word != "--user") throw InputError("\"" + word + "\"", "unknown option (try --help)");
    if (i + 1 >= argc || !*argv[i + 1]) throw InputError(word, "needs a value (try --help)");
    (word == "--settings" ? arguments.settings : arguments.user) = argv[++i];
  }
  if (arguments.settings.empty()) throw InputError("--settings", "is missing (try --help)");
  return arguments;
}

/// A device with wrong settings needs its page most.
std::vector<Settings> settings_of(const Arguments& arguments) {
  const SettingsFiles files(arguments.settings, arguments.user);
  std::vector<Settings> fingers;
  try {
    fingers = read_fingers(files, Measured::kIgnored);
  } catch (const InputError& error) {
    log_line(error.what());
    fingers = {read_usable_settings(files)};
  }
  if (!fingers[0].page) throw InputError(arguments.settings, "has no usable [page], so there is no page");
  return fingers;
}

/// The addresses by which this machine may be reached, for the console.
std::vector<std::string> own_addresses() {
  std::array<ifreq, 16> interfaces{};
  ifconf list{};
  list.ifc_len = static_cast<int>(sizeof interfaces);
  list.ifc_req = interfaces.data();
  const Descriptor socket(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  std::vector<std::string> addresses;
  if (ioctl(socket.get(), SIOCGIFCONF, &list) != 0) return addresses;
  for (std::size_t i = 0; i < static_cast<std::size_t>(list.ifc_len) / sizeof(ifreq); ++i) {
    sockaddr_in address{};
    std::memcpy(&address, &interfaces[i].ifr_addr, sizeof address);
    char text[INET_ADDRSTRLEN] = "";
    inet_ntop(AF_INET, &address.sin_addr, text, sizeof text);
    if (std::strncmp(text, "127.", 4) != 0) addresses.emplace_back(text);
  }
  return addresses;
}

/// Says where the page is, and again when that has changed.
class Signpost {
 public:
  explicit Signpost(const PageSettings& page) : page_(page) { look(); }
  void look() {
    const bool is_any = page_.address == "0.0.0.0";
    std::vector<std::string> found = is_any ? own_addresses() : std::vector{page_.address};
    if (found.empty()) found = {page_.address};
    if (found == said_) return;
    said_ = found;
    for (const std::string& address : said_) log_line("http://" + address + ":" + std::to_string(page_.port) + "/");
  }

 private:
  const PageSettings& page_;
  std::vector<std::string> said_;
};

/// The page of one finger, at a port of its own.
class FingerPage {
 public:
  FingerPage(const Settings& settings, const std::vector<Settings>& fingers)
      : device_(settings),
        setup_(settings, device_),
        api_(settings, device_, setup_, bad_pictures_, page::assets(), fingers),
        server_(
            *settings.page, [this](const page::Request& request) { return api_.handle(request); },
            [this](const page::Request& request, std::uint64_t bytes) { return api_.begin_update(request, bytes); }),
        signpost_(*settings.page) {}

  /// Once every kEvery.
  void look(std::int64_t now_ns) {
    if (now_ns - closed_ns_ >= kCloseEvery_ns) {
      server_.close_slow(now_ns);
      signpost_.look();
      closed_ns_ = now_ns;
    }
    bad_pictures_.look(device_, now_ns);
    if (server_.streams() == 0) return;
    if (const std::string event = device_.new_frame_event(); !event.empty()) server_.send_event(0, "frame", event);
    if (now_ns - registers_ns_ < kRegistersEvery_ns) return;
    registers_ns_ = now_ns;
    server_.send_event(1, "registers", device_.registers_event());
  }

 private:
  page::Device device_;
  page::Setup setup_;
  page::BadPictures bad_pictures_;
  page::Api api_;
  page::HttpServer server_;
  Signpost signpost_;
  std::int64_t registers_ns_ = 0, closed_ns_ = 0;
};

void serve_one(std::size_t finger, const std::vector<Settings>& fingers, Supervisor& supervisor) {
  try {
    FingerPage page(fingers[finger], fingers);
    while (!stop_requested) {
      std::this_thread::sleep_for(kEvery);
      page.look(steady_now_ns());
      supervisor.alive_without_sensor(steady_now_ns(), finger);
    }
  } catch (...) {
    stop_requested = true;  // of the others, too
    throw;
  }
}

/// Each page on a thread of its own: it may wait more than a second for its finger's answer.
void serve(const std::vector<Settings>& fingers) {
  Supervisor supervisor(fingers.size());
  std::vector<std::future<void>> pages;
  for (std::size_t finger = 0; finger < fingers.size(); ++finger) {
    pages.push_back(std::async(std::launch::async, [&, finger] { serve_one(finger, fingers, supervisor); }));
  }
  for (auto& page : pages) page.get();
}

}  // namespace

int main(int argc, char** argv) {
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--help") == 0) return std::fputs(kUsage, stdout) < 0;
    if (std::strcmp(argv[i], "--version") == 0) return std::puts("finsight-page " FINSIGHT_VERSION) < 0;
  }
  const auto request_stop = [](int) { stop_requested = true; };
  std::signal(SIGINT, request_stop);
  std::signal(SIGTERM, request_stop);
  std::signal(SIGPIPE, SIG_IGN);
  try {
    serve(settings_of(parse(argc, argv)));
    return 0;
  } catch (const InputError& error) {
    log_line(error.what());
    return 2;
  } catch (const std::exception& error) {
    log_line(error.what());
    return 1;
  }
}
