// What every subcommand needs: progress of long jobs, work on all cores, files that are never left half-written,
// checksums.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include "firmware/settings/atomic_file.h"

namespace finsight::host {

/// Ctrl-C was pressed. Long work asks for this between units of work and stops by throwing Interrupted.
bool interrupted();
const std::atomic<bool>& interrupt_flag();  ///< the same, for work that cannot call this
void catch_interrupts();
struct Interrupted : std::runtime_error {
  Interrupted() : std::runtime_error("interrupted; nothing was left half-written") {}
};

/// One line on stderr with the progress of a long job; silent for jobs under two seconds. Thread-safe.
class Progress {
 public:
  Progress(std::string label, std::size_t total);
  ~Progress();  ///< closes the line
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  void advance(std::size_t done = 1);

 private:
  struct State;
  State* state_;
};

/// How many threads may work: the processors that this process may run on (taskset, containers), and no more than
/// SLURM_CPUS_PER_TASK where a batch system set that.
std::size_t usable_cores();

/// Calls work(index) for 0 <= index < count on all usable cores, each index once. Results must go to slots of their
/// own, so that they do not depend on the number of cores. The first exception of any worker is thrown again here;
/// Ctrl-C throws Interrupted.
void parallel_for(std::size_t count, const std::function<void(std::size_t)>& work);

using finsight::write_file_atomically;
/// Before long work: that a file can be written there, its folders too, and that it is not one of those in `used`,
/// however it is spelt or linked. Throws std::exception if not.
void check_writable(const std::filesystem::path& file, const std::vector<std::filesystem::path>& used = {});
/// Throws InputError if the file cannot be read.
std::string read_file(const std::filesystem::path& file);

/// Lower-case hexadecimal SHA-256.
std::string sha256_hex(std::string_view bytes);

}  // namespace finsight::host
