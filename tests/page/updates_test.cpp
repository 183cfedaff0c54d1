#include "firmware/page/updates.h"

#include <doctest/doctest.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "tests/model/scratch_folder.h"

using namespace finsight::page;
using finsight::test::ScratchFolder;

namespace {

/// A device that runs version 1.
struct Machine {
  ScratchFolder folder;
  std::filesystem::path release = folder.write("release", "board=b\nversion=1\nid=x\n");
  Updates updates{folder / "updates", release, folder / "updated"};
  Machine() { std::filesystem::create_directories(folder / "updates" / "spool"); }
  std::filesystem::path whole() const { return folder / "updates" / "spool" / "upload.update"; }
  std::string state() { return updates.state()["state"].get<std::string>(); }
  void result(const std::string& text) const { std::ofstream(folder / "updates" / "result.txt") << text; }
};

}  // namespace

TEST_CASE("updates: a file is there as a whole once its last byte has come, and not before") {
  Machine machine;
  CHECK(machine.state() == "none");
  {
    const Intake intake = machine.updates.begin(6);
    REQUIRE_FALSE(intake.refusal);
    CHECK(intake.take("abc"));
    CHECK(machine.state() == "receiving");
    CHECK_FALSE(std::filesystem::exists(machine.whole()));
    CHECK(machine.updates.begin(6).refusal->status == 409);
    CHECK(intake.take("def"));
    std::ifstream in(machine.whole());
    CHECK(std::string(std::istreambuf_iterator<char>(in), {}) == "abcdef");
    CHECK_FALSE(intake.take("g"));
  }
  CHECK(machine.state() == "installing");
  CHECK(machine.updates.begin(6).refusal->status == 409);
}

TEST_CASE("updates: nothing is left of a file whose sender went away") {
  Machine machine;
  CHECK(machine.updates.begin(6).take("abc"));
  CHECK(machine.state() == "none");
  CHECK(std::filesystem::is_empty(machine.folder / "updates" / "spool"));
  std::ofstream(machine.folder / "updates" / "spool" / "upload.update.part7") << "of a program that was killed";
  const Updates again(machine.folder / "updates", machine.release, machine.folder / "updated");
  CHECK(std::filesystem::is_empty(machine.folder / "updates" / "spool"));
}

TEST_CASE("updates: the outcome is told from what the updater said and from what runs") {
  Machine machine;
  machine.result("finsight-update: x.update: the signature is not by a key of this device\n");
  CHECK(machine.state() == "refused");
  machine.result(
      "finsight-update: writing version 2 over 1 to slot b\nfinsight-update: slot b is complete and starts next\n");
  CHECK(machine.state() == "went_back");
  CHECK(machine.updates.state()["to"] == "2");
  machine.folder.write("updated", "");
  CHECK(machine.state() == "restarting");
  CHECK(machine.updates.begin(6).refusal);
  std::filesystem::remove(machine.folder / "updated");
  machine.folder.write("release", "board=b\nversion=2\nid=x\n");
  CHECK(machine.state() == "running");
}

TEST_CASE("updates: what has no room, no end or no place is refused") {
  Machine machine;
  CHECK(machine.updates.begin(0).refusal->status == 413);
  CHECK(machine.updates.begin(Updates::kLongest + 1).refusal->status == 413);
  Updates none("", machine.release, machine.folder / "updated");
  CHECK(none.state()["available"] == false);
  CHECK(none.begin(6).refusal->status == 409);
}
