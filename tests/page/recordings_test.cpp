#include "firmware/page/recordings.h"

#include <doctest/doctest.h>

#include <cstdlib>
#include <fstream>

#include "tests/model/scratch_folder.h"

using namespace finsight::page;
namespace fs = std::filesystem;

namespace {

void make_session(const fs::path& folder, const std::string& name, std::size_t frame_bytes) {
  fs::create_directories(folder / name);
  std::ofstream(folder / name / "frames.y4m") << std::string(frame_bytes, 'x');
  std::ofstream(folder / name / "session.toml") << "description = \"\"\n";
}

}  // namespace

TEST_CASE("recordings: only names that the recorder makes are looked up") {
  for (const char* name : {"session-0001", "session-12345"}) CHECK(Recordings::is_name(name));
  for (const char* name :
       {"", "session-", "session-1/../..", "../session-1", "session-1x", "session-%2e", "session-12345678901"}) {
    CHECK_FALSE(Recordings::is_name(name));
  }
}

TEST_CASE("recordings: the newest first, with their size; other folders are not shown") {
  const finsight::test::ScratchFolder folder;
  make_session(folder.path(), "session-0001", 10);
  make_session(folder.path(), "session-0002", 20);
  fs::create_directories(folder / "private");
  const auto list = Recordings(folder.path()).list();
  REQUIRE(list.size() == 2);
  CHECK(list[0]["name"] == "session-0002");
  CHECK(list[0]["bytes"] == 20 + 17);
  CHECK(list[0]["complete"] == true);
  CHECK(Recordings(folder / "nowhere").list().empty());
  CHECK(Recordings("").list().empty());
}

TEST_CASE("recordings: tar reads the archive, whatever the size of the pieces") {
  const finsight::test::ScratchFolder folder;
  make_session(folder.path(), "session-0001", 200'001);
  const auto more = Recordings(folder.path()).tar("session-0001");
  REQUIRE(more);
  std::ofstream out(folder / "a.tar", std::ios::binary);
  std::vector<char> bytes(777);
  while (const auto count = more(bytes.data(), bytes.size())) out.write(bytes.data(), count);
  out.close();
  fs::create_directories(folder / "out");
  const std::string command = "tar -xf " + (folder / "a.tar").string() + " -C " + (folder / "out").string();
  REQUIRE(std::system(command.c_str()) == 0);
  CHECK(fs::file_size(folder / "out/session-0001/frames.y4m") == 200'001);
  CHECK(fs::file_size(folder / "out/session-0001/session.toml") == 17);
  CHECK_FALSE(Recordings(folder.path()).tar("session-0002"));
  CHECK_FALSE(Recordings(folder.path()).tar("../etc"));
}

TEST_CASE("recordings: one is deleted, but not while it runs") {
  const finsight::test::ScratchFolder folder;
  make_session(folder.path(), "session-0001", 10);
  const Recordings recordings(folder.path());
  std::ofstream(folder / "session-0001/session.toml") << "complete = false\n";
  CHECK(recordings.remove("session-0001", false)->status == 409);  // it has begun before the register says so
  fs::last_write_time(folder / "session-0001", fs::file_time_type::clock::now() - std::chrono::minutes(1));
  CHECK(recordings.remove("session-0001", true)->status == 409);
  CHECK(recordings.remove("session-0001", std::nullopt)->status == 503);
  CHECK_FALSE(recordings.remove("session-0001", false));
  CHECK_FALSE(fs::exists(folder / "session-0001"));
  CHECK(recordings.remove("session-0001", false)->status == 404);
  CHECK(recordings.remove("..", false)->status == 404);
}

TEST_CASE("recordings: while one runs, complete ones and those that were cut off before can be deleted") {
  const finsight::test::ScratchFolder folder;
  for (const char* name : {"session-0001", "session-0002", "session-0003"}) make_session(folder.path(), name, 10);
  for (const char* name : {"session-0001", "session-0003"})
    std::ofstream(folder / name / "session.toml") << "complete = false\n";
  fs::last_write_time(folder / "session-0001", fs::file_time_type::clock::now() - std::chrono::minutes(1));
  const Recordings recordings(folder.path());
  CHECK_FALSE(recordings.remove("session-0001", true));
  CHECK_FALSE(recordings.remove("session-0002", std::nullopt));
  CHECK(recordings.remove("session-0003", true)->status == 409);
}

TEST_CASE("recordings: a download breaks where a file is deleted or gets shorter meanwhile") {
  for (const bool is_deleted : {true, false}) {
    const finsight::test::ScratchFolder folder;
    make_session(folder.path(), "session-0001", 200'001);
    const auto more = Recordings(folder.path()).tar("session-0001");
    std::vector<char> bytes(1000);
    REQUIRE(more(bytes.data(), bytes.size()) == 1000);
    if (is_deleted) {
      fs::remove_all(folder / "session-0001");
    } else {
      fs::resize_file(folder / "session-0001/session.toml", 3);
    }
    std::int64_t count = 1;
    while (count > 0) count = more(bytes.data(), bytes.size());
    CHECK(count < 0);
  }
}
