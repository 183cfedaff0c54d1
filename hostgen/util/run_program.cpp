#include "hostgen/util/run_program.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <ctime>
#include <stdexcept>
#include <system_error>
#include <thread>

#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

pid_t spawn(const std::vector<std::string>& command, const std::filesystem::path& folder, const std::string& package) {
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addchdir_np(&actions, folder.c_str());
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "log", O_WRONLY | O_CREAT | O_TRUNC, 0600);
  posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  std::vector<char*> argv;
  for (const std::string& argument : command) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  pid_t child = 0;
  const int error = posix_spawnp(&child, argv[0], &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error == ENOENT) {
    throw std::runtime_error("the program `" + command[0] + "` was not found; on Debian: apt-get install " + package);
  }
  if (error) throw std::system_error(error, std::generic_category(), "cannot start " + command[0]);
  return child;
}

/// Processor time of a running program; it counts what it used, so that a busy machine does not shorten its limit.
std::chrono::nanoseconds used_by(pid_t child) {
  clockid_t clock{};
  timespec time{};
  if (clock_getcpuclockid(child, &clock) != 0 || clock_gettime(clock, &time) != 0) return {};
  return std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
}

/// Waits for the end of the program; kills it after `limit` of processor time, if it does nothing after five times
/// that, or on Ctrl-C. True if it ended on its own.
bool wait_or_kill(pid_t child, std::chrono::milliseconds limit, int& status) {
  constexpr int kIdle = 5;
  const auto start = std::chrono::steady_clock::now();
  const auto idle = [&] {
    const auto since = std::chrono::steady_clock::now() - start;
    return since > kIdle * limit && used_by(child) * kIdle * kIdle < since;
  };
  while (used_by(child) < limit && !idle() && !interrupted()) {
    if (waitpid(child, &status, WNOHANG) == child) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  kill(child, SIGKILL);
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return false;
}

}  // namespace

TemporaryFolder::TemporaryFolder() {
  std::string name = (std::filesystem::temp_directory_path() / "finsight-XXXXXX").string();
  if (!mkdtemp(name.data())) throw std::system_error(errno, std::generic_category(), name);
  path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

void run_program(const std::vector<std::string>& command, const std::filesystem::path& folder,
                 std::chrono::milliseconds limit, const std::string& debian_package) {
  const pid_t child = spawn(command, folder, debian_package);
  int status = 0;
  const bool ended = wait_or_kill(child, limit, status);
  if (interrupted()) throw Interrupted();
  const auto fail = [&](const std::string& what) {
    std::string log = read_file(folder / "log"), line;
    if (log.size() > 500) log.erase(0, log.size() - 500);  // the reason is at the end
    for (const std::string& argument : command) line += argument + " ";
    throw std::runtime_error(line + what + (log.empty() ? "" : ":\n" + log));
  };
  if (!ended) fail("took longer than " + std::to_string(limit.count()) + " ms of processor time and was stopped");
  if (WIFSIGNALED(status)) fail("was ended by signal " + std::to_string(WTERMSIG(status)));
  if (WEXITSTATUS(status) != 0) fail("failed with exit code " + std::to_string(WEXITSTATUS(status)));
}

}  // namespace finsight::host
