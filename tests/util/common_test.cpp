#include "hostgen/util/common.h"

#include <doctest/doctest.h>
#include <sched.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <mutex>
#include <set>
#include <system_error>
#include <thread>
#include <vector>

#include "firmware/input_error.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;
using test::ScratchFolder;

TEST_CASE("common: parallel_for calls every index once") {
  for (const std::size_t count : {0, 1, 2, 1000}) {
    std::vector<std::atomic<int>> calls(count);
    host::parallel_for(count, [&](std::size_t i) { ++calls[i]; });
    CHECK(std::all_of(calls.begin(), calls.end(), [](const auto& n) { return n == 1; }));
  }
}

TEST_CASE("common: as many threads work as there are processors that the process may run on, and as Slurm gave it") {
  cpu_set_t before, one;
  REQUIRE(sched_getaffinity(0, sizeof before, &before) == 0);
  CHECK(host::usable_cores() == static_cast<std::size_t>(CPU_COUNT(&before)));
  CPU_ZERO(&one);
  int first = 0;
  while (!CPU_ISSET(first, &before)) ++first;
  CPU_SET(first, &one);
  REQUIRE(sched_setaffinity(0, sizeof one, &one) == 0);
  CHECK(host::usable_cores() == 1);
  std::set<std::thread::id> workers;
  std::mutex mutex;
  host::parallel_for(100, [&](std::size_t) {
    std::this_thread::sleep_for(std::chrono::microseconds(200));
    const std::lock_guard lock(mutex);
    workers.insert(std::this_thread::get_id());
  });
  CHECK(workers.size() == 1);
  REQUIRE(sched_setaffinity(0, sizeof before, &before) == 0);
  setenv("SLURM_CPUS_PER_TASK", "1", 1);
  CHECK(host::usable_cores() == 1);
  setenv("SLURM_CPUS_PER_TASK", "100000", 1);
  CHECK(host::usable_cores() == static_cast<std::size_t>(CPU_COUNT(&before)));
  unsetenv("SLURM_CPUS_PER_TASK");
}

TEST_CASE("common: parallel_for stops at an exception of any worker and throws it again") {
  std::atomic<int> calls{0};
  const auto work = [&](std::size_t i) {
    ++calls;
    if (i == 3) throw InputError("spec.toml", "bad");
  };
  CHECK_THROWS_WITH_AS(host::parallel_for(1'000'000, work), "spec.toml: bad", InputError);
  CHECK(calls < 1'000'000);
}

TEST_CASE("common: files are written whole, with their folders, and replace older ones") {
  const ScratchFolder folder;
  const auto file = folder / "a/b/file";
  host::write_file_atomically(file, std::string("first, and longer"));
  host::write_file_atomically(file, std::string("second\0third", 12));
  CHECK(host::read_file(file) == std::string("second\0third", 12));
  host::write_file_atomically(file, std::string());
  CHECK(host::read_file(file).empty());
  CHECK(std::distance(std::filesystem::directory_iterator(folder / "a/b"), {}) == 1);
}

TEST_CASE("common: a failed write keeps the old file and leaves no temporary one") {
  const ScratchFolder folder;
  std::filesystem::create_directory(folder / "taken");
  folder.write("taken/inside", "kept");
  CHECK_THROWS_AS(host::write_file_atomically(folder / "taken", std::string("x")), std::system_error);
  CHECK(host::read_file(folder / "taken/inside") == "kept");
  CHECK(std::distance(std::filesystem::directory_iterator(folder.path()), {}) == 1);
  folder.write("file", "");
  CHECK_THROWS_AS(host::write_file_atomically(folder / "file/below", std::string("x")), std::system_error);
}

TEST_CASE("common: check_writable tells before the work whether a file can be written, and leaves nothing behind") {
  const ScratchFolder folder;
  host::check_writable(folder / "new" / "pack");
  CHECK(std::filesystem::is_empty(folder / "new"));
  CHECK_THROWS_AS(host::check_writable(folder / "new"), InputError);
  CHECK_THROWS_AS(host::check_writable(folder / "other" / ""), InputError);
  CHECK_FALSE(std::filesystem::exists(folder / "other"));
  host::write_file_atomically(folder / "file", std::string("no folder"));
  CHECK_THROWS(host::check_writable(folder / "file" / "pack"));
  host::check_writable(folder / "pack", {folder / "file", folder / "missing", ""});
  CHECK_THROWS_WITH_AS(host::check_writable(folder / "new" / ".." / "file", {folder / "missing", folder / "file"}),
                       doctest::Contains("would replace a file that this command also uses"), InputError);
  std::filesystem::create_symlink(folder / "file", folder / "symbolic");
  std::filesystem::create_hard_link(folder / "file", folder / "hard");
  CHECK_THROWS_AS(host::check_writable(folder / "none", {folder / "new" / ".." / "none"}), InputError);
  for (const char* name : {"symbolic", "hard"}) {
    CHECK_THROWS_AS(host::check_writable(folder / name, {folder / "missing", folder / "file"}), InputError);
  }
}

TEST_CASE("common: a file that cannot be read is bad input") {
  const ScratchFolder folder;
  CHECK_THROWS_WITH_AS(host::read_file(folder / "missing"), doctest::Contains("missing: "), InputError);
}

TEST_CASE("common: SHA-256 as in FIPS 180-4") {
  CHECK(host::sha256_hex("abc") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  CHECK(host::sha256_hex("") == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

TEST_CASE("common: progress may be advanced by many threads and beyond its total") {
  host::Progress progress("counting", 10);
  std::vector<std::jthread> threads;
  for (int t = 0; t < 4; ++t) threads.emplace_back([&] { progress.advance(5); });
}

// Last, because a program that was interrupted stays so.
TEST_CASE("common: Ctrl-C ends a parallel_for with Interrupted") {
  host::catch_interrupts();
  CHECK_FALSE(host::interrupted());
  std::atomic<int> calls{0};
  const auto work = [&](std::size_t i) {
    ++calls;
    if (i == 5) std::raise(SIGINT);
  };
  CHECK_THROWS_AS(host::parallel_for(1'000'000, work), host::Interrupted);
  CHECK(calls < 1'000'000);
  CHECK(host::interrupted());
}
