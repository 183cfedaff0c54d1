#include "firmware/settings/atomic_file.h"

#include <doctest/doctest.h>
#include <sys/stat.h>

#include <cerrno>
#include <fstream>
#include <iterator>
#include <system_error>

#include "tests/model/scratch_folder.h"

using namespace finsight;

namespace {

enum class Refused { kNothing, kSync, kFolderSync, kRename } refused = Refused::kNothing;
int syncs = 0;

struct Refuse {
  explicit Refuse(Refused what) {
    refused = what;
    syncs = 0;
  }
  ~Refuse() { refused = Refused::kNothing; }
};

std::string text_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::size_t entries(const std::filesystem::path& folder) {
  return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(folder), {}));
}

}  // namespace

// The linker calls these instead of the system's (--wrap). The first sync is the file's, the second the folder's.
extern "C" {
int __real_fsync(int fd);
int __real_rename(const char* from, const char* to);
int __wrap_fsync(int fd) {
  ++syncs;
  const bool fails = (refused == Refused::kSync && syncs == 1) || (refused == Refused::kFolderSync && syncs == 2);
  if (!fails) return __real_fsync(fd);
  errno = EIO;
  return -1;
}
int __wrap_rename(const char* from, const char* to) {
  if (refused != Refused::kRename) return __real_rename(from, to);
  errno = EIO;
  return -1;
}
}

TEST_CASE("atomic file: has its name only once it is complete, and replaces the older one") {
  const test::ScratchFolder folder;
  const auto file = folder / "new" / "file";
  const std::string large(200'000, 'x');  // longer than the buffer
  {
    AtomicFile out(file);
    out.write("first");
    CHECK_FALSE(std::filesystem::exists(file));
    out.write(large);
    out.write("last");
    out.commit();
  }
  CHECK(text_of(file) == "first" + large + "last");
  write_file_atomically(file, "");
  CHECK(text_of(file).empty());
  CHECK(entries(folder / "new") == 1);
}

TEST_CASE("atomic file: one that is not committed leaves the old file and nothing else") {
  const test::ScratchFolder folder;
  const auto file = folder.write("file", "old");
  { AtomicFile(file).write("new"); }
  CHECK(text_of(file) == "old");
  CHECK(entries(folder.path()) == 1);
}

TEST_CASE("atomic file: a disk that fails is an error naming the file, and leaves no open file behind") {
  const test::ScratchFolder folder;
  const auto file = folder.write("file", "old");
  const std::size_t open_files = entries("/proc/self/fd");
  for (const Refused what : {Refused::kSync, Refused::kRename, Refused::kFolderSync}) {
    const Refuse refuse(what);
    CHECK_THROWS_WITH_AS(write_file_atomically(file, "new"), doctest::Contains(folder.path().c_str()),
                         std::system_error);
    CHECK(text_of(file) == (what == Refused::kFolderSync ? "new" : "old"));
    CHECK(entries("/proc/self/fd") == open_files);
    CHECK(entries(folder.path()) == 1);
  }
}

TEST_CASE("atomic file: a file that another program wrote is on the disk before it gets its name") {
  const test::ScratchFolder folder;
  const auto from = folder.write("made", "by gnuplot"), to = folder.write("plot", "old");
  {
    const Refuse refuse(Refused::kSync);
    CHECK_THROWS_AS(replace_file(from, to), std::system_error);
    CHECK(text_of(to) == "old");
  }
  replace_file(from, to);
  CHECK(text_of(to) == "by gnuplot");
  CHECK_FALSE(std::filesystem::exists(from));
}

TEST_CASE("atomic file: writes where a link leads, and replaces no pipe") {
  const test::ScratchFolder folder;
  const auto file = folder.write("file", "old"), link = folder / "link", pipe = folder / "pipe";
  std::filesystem::create_symlink("file", link);
  write_file_atomically(link, "new");
  CHECK(text_of(file) == "new");
  CHECK(std::filesystem::is_symlink(link));
  REQUIRE(::mkfifo(pipe.c_str(), 0600) == 0);
  CHECK_THROWS_WITH_AS(write_file_atomically(pipe, "new"), doctest::Contains("pipe: is no ordinary file"),
                       std::system_error);
  CHECK(std::filesystem::is_fifo(pipe));
}
