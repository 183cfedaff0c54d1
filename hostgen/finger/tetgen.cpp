#include "hostgen/finger/tetgen.h"

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <system_error>
#include <thread>

#include "hostgen/common.h"

namespace finsight::host {

namespace {

/// Deleted with all that is in it, also when an exception passes.
struct TemporaryFolder {
  std::filesystem::path path;
  TemporaryFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "finsight-mesh-XXXXXX").string();
    if (!mkdtemp(name.data())) throw std::system_error(errno, std::generic_category(), name);
    path = name;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
};

pid_t spawn(const std::string& program, const std::string& switches, const std::filesystem::path& folder) {
  const std::string log = (folder / "log").string(), input = (folder / "finger.poly").string();
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, log.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
  const std::string arguments[] = {program, switches, input};
  char* argv[] = {const_cast<char*>(arguments[0].c_str()), const_cast<char*>(arguments[1].c_str()),
                  const_cast<char*>(arguments[2].c_str()), nullptr};
  pid_t child = 0;
  const int error = posix_spawnp(&child, program.c_str(), &actions, nullptr, argv, environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error == ENOENT) {
    throw std::runtime_error("the program `" + program + "` was not found; on Debian: apt-get install tetgen");
  }
  if (error) throw std::system_error(error, std::generic_category(), "cannot start " + program);
  return child;
}

/// Waits for the end of the program; kills it after `limit` or on Ctrl-C. True if it ended by itself.
bool wait_or_kill(pid_t child, std::chrono::milliseconds limit, int& status) {
  const auto deadline = std::chrono::steady_clock::now() + limit;
  while (std::chrono::steady_clock::now() < deadline && !interrupted()) {
    if (waitpid(child, &status, WNOHANG) == child) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  kill(child, SIGKILL);
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return false;
}

/// Reads whitespace-separated numbers with line comments (#), checking every one.
class NumberReader {
 public:
  explicit NumberReader(const std::filesystem::path& file) : name_(file.filename()), text_(read_file(file)) {
    at_ = text_.c_str();
  }
  double number() {
    while (std::strchr(" \t\r\n#", *at_) && *at_) {
      at_ += *at_ == '#' ? std::strcspn(at_, "\n") : 1;
    }
    char* end = nullptr;
    const double value = std::strtod(at_, &end);
    if (end == at_) throw std::runtime_error("tetgen: " + name_ + " ends early or holds no number");
    at_ = end;
    return value;
  }
  int index(int limit) {
    const double value = number();
    if (!(value >= 0 && value < limit)) throw std::runtime_error("tetgen: number out of range in " + name_);
    return static_cast<int>(value);
  }

 private:
  std::string name_, text_;
  const char* at_;
};

constexpr int kLargestCount = 100'000'000;

TetgenOutput read_output(const std::filesystem::path& folder) {
  TetgenOutput out;
  NumberReader nodes(folder / "finger.1.node");
  out.nodes.resize(static_cast<std::size_t>(nodes.index(kLargestCount)));
  nodes.index(4);  // dimension
  const int attributes = nodes.index(100), markers = nodes.index(2);
  for (auto& node : out.nodes) {
    nodes.number();  // its own index
    for (double& coordinate : node) coordinate = nodes.number();
    for (int skipped = 0; skipped < attributes + markers; ++skipped) nodes.number();
  }
  NumberReader tets(folder / "finger.1.ele");
  const int count = tets.index(kLargestCount);
  if (tets.index(100) != 4 || tets.index(100) != 1) {
    throw std::runtime_error("tetgen: expected 4 nodes and one attribute per tetrahedron in finger.1.ele");
  }
  for (int i = 0; i < count; ++i) {
    tets.number();
    std::array<int, 4>& tet = out.tets.emplace_back();
    for (int& node : tet) node = tets.index(static_cast<int>(out.nodes.size()));
    out.region.push_back(tets.index(kLargestCount));
  }
  return out;
}

}  // namespace

TetgenOutput run_tetgen(const std::string& poly, const std::string& switches, std::chrono::milliseconds limit,
                        const std::string& program) {
  const TemporaryFolder folder;
  write_file_atomically(folder.path / "finger.poly", poly);
  const pid_t child = spawn(program, "-" + switches, folder.path);
  int status = 0;
  const bool ended = wait_or_kill(child, limit, status);
  if (interrupted()) throw Interrupted();
  const auto fail = [&](const std::string& what) {
    std::string log = read_file(folder.path / "log");
    if (log.size() > 500) log.erase(0, log.size() - 500);  // the reason stands at the end
    throw std::runtime_error(program + " -" + switches + " " + what + (log.empty() ? "" : ":\n" + log));
  };
  if (!ended) fail("took longer than " + std::to_string(limit.count()) + " ms and was stopped");
  if (WIFSIGNALED(status)) fail("was ended by signal " + std::to_string(WTERMSIG(status)));
  if (WEXITSTATUS(status) != 0) fail("failed with exit code " + std::to_string(WEXITSTATUS(status)));
  if (!std::filesystem::exists(folder.path / "finger.1.ele")) fail("wrote no mesh");
  return read_output(folder.path);
}

}  // namespace finsight::host
