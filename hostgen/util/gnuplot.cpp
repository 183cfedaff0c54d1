#include "hostgen/util/gnuplot.h"

#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <stdexcept>

#include "firmware/settings/atomic_file.h"

namespace finsight::host {

Gnuplot::Gnuplot(const std::filesystem::path& svg)
    : target_(svg), temporary_(svg.string() + ".part" + std::to_string(getpid())), pipe_(popen("gnuplot", "w")) {
  std::signal(SIGPIPE, SIG_IGN);  // finish() reports that gnuplot ended
  if (!pipe_) throw std::runtime_error("gnuplot cannot be started");
  line("set terminal svg size 900,520 dynamic background '#ffffff' font 'sans-serif,13'");
  std::string quoted = "'";
  for (const char c : temporary_.string()) quoted += c == '\'' ? "''" : std::string(1, c);
  line("set output " + quoted + "'");
}

Gnuplot::~Gnuplot() {
  if (pipe_) pclose(pipe_);
  std::error_code ignored;
  std::filesystem::remove(temporary_, ignored);
}

void Gnuplot::line(const std::string& command) { std::fprintf(pipe_, "%s\n", command.c_str()); }

void Gnuplot::finish() {
  line("unset output");
  const int status = pclose(pipe_);
  pipe_ = nullptr;
  if (WIFEXITED(status) && WEXITSTATUS(status) == 127) throw std::runtime_error("gnuplot is not installed");
  if (status != 0) throw std::runtime_error("gnuplot failed on " + target_.string());
  replace_file(temporary_, target_);
}

}  // namespace finsight::host
