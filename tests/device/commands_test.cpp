#include "firmware/device/commands.h"

#include <doctest/doctest.h>

#include <array>
#include <chrono>
#include <thread>

#include "tests/count_allocations.h"
#include "tests/model/scratch_folder.h"
#include "tests/model/tiny_model.h"

using namespace finsight;

namespace {

const Model& model() {
  static const Model the_model = test::TinyModel().open();
  return the_model;
}

PlatePoses resting(float size) {
  std::array<float, kPoseDims> numbers{};
  for (std::size_t p = 0; p < kPlates; ++p) numbers[6 * p + 2] = size;
  return seen_poses(numbers);
}

ZeroBasis basis() { return {model().checksum, poses_of(model().mount)}; }

/// A device without a camera: a client's writes on one side, frames on the other.
struct Device {
  explicit Device(const std::filesystem::path& file = {}, const SavedState& saved = {}, OtherFingers others = {})
      : loop(model(), std::nullopt, {.shape = {}, .runtime = saved.settings}),
        control(kDefaultWriteKey, RuntimeSettings{}, saved.settings) {
    if (!file.empty()) saver.emplace(file, basis());
    write(kKeyRegister, {kDefaultWriteKey});
    commands.emplace(control, loop, saver ? &*saver : nullptr, nullptr, saved, 100'000'000, others);
  }
  void give(Command command, std::uint16_t number) {
    REQUIRE(write(kCommandRegister, {static_cast<std::uint16_t>(command), number}) == Exception::kNone);
  }
  Exception write(int address, std::vector<std::uint16_t> words) { return control.write(address, words, access, 0); }
  std::uint16_t read(int address) {
    std::uint16_t word = 0;
    control.read(address, {&word, 1}, access, 0);
    return word;
  }
  const RegisterImage& frame(const PlatePoses& poses) {
    commands->poll();
    now_ns += 16'666'667;
    return loop.step(Observation{.exposure_ns = now_ns, .sequence = sequence++, .poses = poses});
  }
  /// Frames until the command has ended; its result.
  int result_of(Command command, const PlatePoses& poses) {
    const std::uint16_t number = static_cast<std::uint16_t>(read(kResultSequenceRegister) + 1);
    REQUIRE(write(kCommandRegister, {static_cast<std::uint16_t>(command), number}) == Exception::kNone);
    for (int i = 0; i < 3000; ++i) {
      frame(poses);
      if (read(kResultSequenceRegister) == number) return read(kResultRegister);
      if (command == Command::kSave) std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    return -1;
  }

  FrameLoop loop;
  Control control;
  std::optional<StateSaver> saver;
  std::optional<Commands> commands;
  ClientAccess access{.may_write = true};
  std::int64_t now_ns = steady_now_ns();
  std::uint32_t sequence = 0;
};

}  // namespace

TEST_CASE("commands: a zero that was saved is used after a restart") {
  const test::ScratchFolder folder;
  const auto file = folder / "state.toml";
  {
    Device device(file);
    CHECK(static_cast<std::int16_t>(device.frame(resting(1)).words[16]) == 100);
    CHECK(device.result_of(Command::kZero, resting(1)) == 0);
    const RegisterImage& image = device.frame(resting(1.5F));
    CHECK(static_cast<std::int16_t>(image.words[16]) == 50);
    CHECK((image.words[0] & (kZeroed | kSettingsUnsaved)) == (kZeroed | kSettingsUnsaved));
    CHECK(device.result_of(Command::kSave, resting(1)) == 0);
    CHECK((device.frame(resting(1)).words[0] & (kZeroed | kSettingsUnsaved)) == kZeroed);
  }
  const ZeroBasis same = basis();
  Device device(file, load_state(file, &same)->state);
  const RegisterImage& image = device.frame(resting(1.5F));
  CHECK(static_cast<std::int16_t>(image.words[16]) == 50);
  CHECK((image.words[0] & (kZeroed | kSettingsUnsaved)) == kZeroed);
}

TEST_CASE("commands: a zero of a touched finger is not possible") {
  Device device;
  CHECK(device.result_of(Command::kZero, resting(5)) == 1);
  CHECK((device.frame(resting(1)).words[0] & kZeroed) == 0);
}

TEST_CASE("commands: zero all zeroes every finger, and its result is the worst") {
  for (const float other_mm : {1.0F, 5.0F}) {  // 5 mm: it is touched
    CAPTURE(other_mm);
    ZeroTogether zeros(2);
    Device left({}, {}, {&zeros, 0}), right({}, {}, {&zeros, 1});
    left.give(Command::kZeroAll, 1);
    unsigned left_status = 0, right_status = 0;
    for (int i = 0; i < 300; ++i) {
      left_status = left.frame(resting(1)).words[0];
      right_status = right.frame(resting(other_mm)).words[0];
    }
    // By these bits a client tells whose zero is new.
    constexpr unsigned kNew = kZeroed | kSettingsUnsaved;
    CHECK((left_status & kNew) == kNew);
    CHECK((right_status & kNew) == (other_mm < 5 ? kNew : 0));
    CHECK(left.read(kResultSequenceRegister) == 1);
    CHECK(left.read(kResultRegister) == (other_mm < 5 ? 0 : 1));
    CHECK(right.read(kResultSequenceRegister) == 0);  // its own clients ordered nothing
  }
}

TEST_CASE("commands: two fingers that order a zero of all at the same time both get it") {
  ZeroTogether zeros(2);
  Device left({}, {}, {&zeros, 0}), right({}, {}, {&zeros, 1});
  left.give(Command::kZeroAll, 1);
  right.give(Command::kZeroAll, 1);
  for (int i = 0; i < 300; ++i) {
    left.frame(resting(1));
    right.frame(resting(1));
  }
  CHECK(left.read(kResultSequenceRegister) == 1);
  CHECK(left.read(kResultRegister) == 0);
  CHECK(right.read(kResultSequenceRegister) == 1);
  CHECK(right.read(kResultRegister) == 0);
}

TEST_CASE("commands: a tare takes one frame and is refused while its value is not valid; a zero clears it") {
  constexpr std::size_t kState = 5, kDeformation = 11, kForce = 10;  // behind register 1110
  Device device;
  device.frame(resting(1));
  CHECK(device.result_of(Command::kTareForce, resting(1)) == 1);  // no touch, no force
  CHECK(device.result_of(Command::kTareDeformation, resting(1)) == 0);
  const RegisterImage& image = device.frame(resting(1));
  CHECK(image.process[kState] == bit_named("process_state", "deformation_tared"));
  CHECK(image.process[kDeformation] == 0);
  CHECK(image.process[kForce] == 0x8000);
  CHECK(device.result_of(Command::kZero, resting(1)) == 0);
  CHECK(device.frame(resting(1)).process[kState] == 0);
}

TEST_CASE("commands: a tare that is ordered during a stall is not possible; the next one counts from a fresh frame") {
  constexpr std::size_t kDeformation = 11;  // behind register 1110
  Device device;
  device.now_ns -= 10'000'000'000;  // the last frame is ten seconds old
  device.frame(resting(1));
  CHECK(device.result_of(Command::kTareDeformation, resting(3)) == 1);
  CHECK(device.loop.registers().process[5] == 0);
  device.now_ns = steady_now_ns();
  device.frame(resting(3));
  CHECK(device.result_of(Command::kTareDeformation, resting(5)) == 0);
  CHECK(device.frame(resting(5)).process[kDeformation] == 0);
}

TEST_CASE("commands: a tare counts from a frame after its order, not from the one before") {
  constexpr std::size_t kDeformation = 11;  // behind register 1110
  Device device;
  device.frame(resting(1));
  CHECK(device.result_of(Command::kTareDeformation, resting(3)) == 0);
  CHECK(device.frame(resting(3)).process[kDeformation] == 0);
}

TEST_CASE("commands: a result is told after the frame that shows what was done") {
  Device device;
  device.frame(resting(1));
  REQUIRE(device.write(kCommandRegister, {static_cast<std::uint16_t>(Command::kTareDeformation), 9}) ==
          Exception::kNone);
  device.commands->poll();
  CHECK(device.read(kResultSequenceRegister) == 0);  // no frame has shown the tare yet
  const RegisterImage& image = device.loop.step(Observation{.exposure_ns = device.now_ns += 1, .poses = resting(1)});
  CHECK(image.process[5] == bit_named("process_state", "deformation_tared"));
  device.commands->poll();
  CHECK(device.read(kResultSequenceRegister) == 9);
}

TEST_CASE("commands: without a folder for settings or recordings, saving and recording are not configured") {
  Device device;
  CHECK(device.result_of(Command::kSave, resting(0)) == 2);
  CHECK(device.result_of(Command::kRecord, resting(0)) == 2);
  CHECK(device.result_of(Command::kStopRecording, resting(0)) == 2);
}

TEST_CASE("commands: a setting applies from the next frame on, and is unsaved until it is saved or changed back") {
  Device device;
  CHECK(device.frame(resting(1)).words[46] == 0x1234);
  REQUIRE(device.write(1019, {1}) == Exception::kNone);
  CHECK(device.frame(resting(1)).words[46] == 0x5678);
  CHECK((device.frame(resting(1)).words[0] & kSettingsUnsaved) != 0);
  REQUIRE(device.write(1019, {0}) == Exception::kNone);
  CHECK((device.frame(resting(1)).words[0] & kSettingsUnsaved) == 0);
}

TEST_CASE("commands: factory settings apply at once and remove the zero; the saved file stays") {
  const test::ScratchFolder folder;
  SavedState saved;
  saved.settings[kWordOrder] = 1;
  saved.zero.emplace();
  Device device(folder / "state.toml", saved);
  CHECK((device.frame(resting(1)).words[0] & (kZeroed | kSettingsUnsaved)) == kZeroed);
  CHECK(device.result_of(Command::kFactory, resting(1)) == 0);
  const RegisterImage& image = device.frame(resting(1));
  CHECK(image.words[46] == 0x1234);
  CHECK((image.words[0] & (kZeroed | kSettingsUnsaved)) == kSettingsUnsaved);
  CHECK(device.read(1019) == 0);
}

TEST_CASE("commands: a lasting fault stays until it is cleared") {
  Device device;
  device.loop.set_lasting_fault(FaultCode::kSavedSettings);
  CHECK(device.frame(resting(1)).words[1] == 7);
  CHECK((device.frame(resting(1)).words[0] & kAnyFault) != 0);
  CHECK(device.result_of(Command::kClearFault, resting(1)) == 0);
  CHECK(device.frame(resting(1)).words[1] == 0);
}

TEST_CASE("commands: a reset is reported as done before it is due") {
  Device device;
  CHECK(device.result_of(Command::kReset, resting(1)) == 0);
  CHECK(device.commands->reset_is_ordered());
  CHECK_FALSE(device.commands->reset_is_due());  // its result can be read first
  std::this_thread::sleep_for(std::chrono::nanoseconds(kResultIsShownNs));
  CHECK(device.commands->reset_is_due());
}

TEST_CASE("commands: the trigger starts its command, unless another one is running") {
  Device device;
  device.commands->trigger();
  CHECK((device.frame(resting(1)).words[0] & kZeroed) == 0);
  REQUIRE(device.write(1021, {1}) == Exception::kNone);
  device.frame(resting(1));
  device.commands->trigger();
  for (int i = 0; i <= Zeroing::kFrames; ++i) device.frame(resting(1));
  CHECK((device.frame(resting(1)).words[0] & kZeroed) != 0);
  CHECK(device.read(kResultSequenceRegister) == 0);  // nobody ordered it
}

TEST_CASE("commands: poll does not allocate") {
  Device device;
  REQUIRE(device.write(kCommandRegister, {1, 1}) == Exception::kNone);
  const PlatePoses poses = resting(1);
  device.frame(poses);
  const long before = test::allocations;
  for (int i = 0; i <= Zeroing::kFrames; ++i) device.frame(poses);
  CHECK(test::allocations == before);
  CHECK(device.read(kResultSequenceRegister) == 1);
}

TEST_CASE("commands: a lost master is fault 14 from the next frame on, values stay valid, and it ends with its write") {
  Device device;
  CHECK(device.frame(resting(3)).words[1] == 0);
  REQUIRE(device.write(address_of("master_timeout"), {1}) == Exception::kNone);
  device.frame(resting(3));  // the time starts
  std::this_thread::sleep_for(std::chrono::milliseconds(5));
  const RegisterImage lost = device.frame(resting(3));
  CHECK(lost.words[1] == 14);
  CHECK((lost.words[0] & (kAnyFault | kReady | kShapeValid)) == (kAnyFault | kReady | kShapeValid));
  REQUIRE(device.write(address_of("master_timeout"), {60000}) == Exception::kNone);
  const ClientAccess master{.may_write = true};
  REQUIRE(device.control.write(kRefreshRegister, std::array<std::uint16_t, 1>{1}, master, steady_now_ns()) ==
          Exception::kLocked);  // its unlock was at 0
  REQUIRE(device.control.write(kKeyRegister, std::array{kDefaultWriteKey}, master, steady_now_ns()) ==
          Exception::kNone);
  REQUIRE(device.control.write(kRefreshRegister, std::array<std::uint16_t, 1>{1}, master, steady_now_ns()) ==
          Exception::kNone);
  CHECK(device.frame(resting(3)).words[1] == 0);
}
