#include "hostgen/util/common.h"

#include <openssl/sha.h>
#include <sched.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <mutex>
#include <system_error>
#include <thread>
#include <vector>

#include "firmware/input_error.h"

namespace finsight::host {

namespace {
std::atomic<bool> ctrl_c{false};
}

bool interrupted() { return ctrl_c.load(std::memory_order_relaxed); }
const std::atomic<bool>& interrupt_flag() { return ctrl_c; }

void catch_interrupts() {
  const auto handler = [](int) { ctrl_c.store(true, std::memory_order_relaxed); };
  std::signal(SIGINT, handler);
  std::signal(SIGTERM, handler);
}

struct Progress::State {
  std::string label;
  std::size_t total;
  std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
  std::chrono::steady_clock::time_point shown = start;
  std::size_t done = 0;
  bool visible = false;
  bool terminal = isatty(STDERR_FILENO) != 0;
  std::mutex mutex;
};

Progress::Progress(std::string label, std::size_t total)
    : state_(new State{.label = std::move(label), .total = total, .mutex = {}}) {}

Progress::~Progress() {
  if (state_->visible) {
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - state_->start;
    std::fprintf(stderr, "%s%s: %zu of %zu in %.1f s\n", state_->terminal ? "\r\033[K" : "", state_->label.c_str(),
                 state_->done, state_->total, elapsed.count());
  }
  delete state_;
}

void Progress::advance(std::size_t done) {
  const std::lock_guard lock(state_->mutex);
  state_->done += done;
  const auto now = std::chrono::steady_clock::now();
  // A terminal is redrawn five times a second, a log gets a line every ten seconds.
  const auto pause =
      state_->visible ? std::chrono::milliseconds(state_->terminal ? 200 : 10000) : std::chrono::milliseconds(2000);
  if (now - state_->shown < pause) return;
  state_->shown = now;
  state_->visible = true;
  const double elapsed_s = std::chrono::duration<double>(now - state_->start).count();
  const double left_s = elapsed_s * static_cast<double>(state_->total - std::min(state_->done, state_->total)) /
                        static_cast<double>(std::max<std::size_t>(state_->done, 1));
  std::fprintf(stderr, "%s%s: %zu of %zu, about %.0f s left%s", state_->terminal ? "\r\033[K" : "",
               state_->label.c_str(), state_->done, state_->total, left_s, state_->terminal ? "" : "\n");
  std::fflush(stderr);
}

std::size_t usable_cores() {
  cpu_set_t allowed;
  CPU_ZERO(&allowed);
  std::size_t cores = std::thread::hardware_concurrency();
  if (sched_getaffinity(0, sizeof allowed, &allowed) == 0) cores = static_cast<std::size_t>(CPU_COUNT(&allowed));
  if (const char* given = std::getenv("SLURM_CPUS_PER_TASK")) {
    const long count = std::strtol(given, nullptr, 10);
    if (count > 0) cores = std::min(cores, static_cast<std::size_t>(count));
  }
  return std::max<std::size_t>(1, cores);
}

void parallel_for(std::size_t count, const std::function<void(std::size_t)>& work) {
  std::atomic<std::size_t> next{0};
  std::exception_ptr failure;
  std::mutex failure_mutex;
  const auto worker = [&] {
    for (std::size_t index = next++; index < count; index = next++) {
      try {
        if (interrupted()) throw Interrupted();
        work(index);
      } catch (...) {
        const std::lock_guard lock(failure_mutex);
        if (!failure) failure = std::current_exception();
        next = count;
      }
    }
  };
  std::vector<std::jthread> threads;
  for (std::size_t i = 1; i < std::min(usable_cores(), count); ++i) threads.emplace_back(worker);
  worker();
  threads.clear();  // joins
  if (failure) std::rethrow_exception(failure);
}

void check_writable(const std::filesystem::path& file, const std::vector<std::filesystem::path>& used) {
  for (const std::filesystem::path& input : used) {
    std::error_code none;  // of a file that is not there, or a pipe that a shell gave
    const std::filesystem::path here = weakly_canonical(file, none);
    if (std::filesystem::equivalent(file, input, none) || (!here.empty() && here == weakly_canonical(input, none))) {
      throw InputError(file.string(), "would replace a file that this command also uses, expected another name");
    }
  }
  if (!file.has_filename() || std::filesystem::is_directory(file)) {
    throw InputError(file.string(), "is a folder, expected a file to write");
  }
  std::error_code none;
  if (std::filesystem::exists(file, none) && !std::filesystem::is_regular_file(file, none)) {
    throw InputError(file.string(), "is a device or a pipe, expected a file to write");
  }
  const std::filesystem::path probe = file.parent_path() / (".probe" + std::to_string(getpid()));
  try {
    write_file_atomically(probe, std::string());
  } catch (const std::system_error& error) {
    throw std::system_error(error.code(), file.string() + ": cannot be written");
  }
  std::filesystem::remove(probe);
}

std::string read_file(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  if (!in) throw InputError(file.string(), "cannot be opened");
  if (std::filesystem::is_directory(file)) throw InputError(file.string(), "is a folder, expected a file");
  return {std::istreambuf_iterator<char>(in), {}};
}

std::string sha256_hex(std::string_view bytes) {
  unsigned char digest[SHA256_DIGEST_LENGTH];
  SHA256(reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size(), digest);
  std::string hex;
  for (const unsigned char byte : digest) {
    constexpr char kDigits[] = "0123456789abcdef";
    hex += kDigits[byte >> 4];
    hex += kDigits[byte & 15];
  }
  return hex;
}

}  // namespace finsight::host
