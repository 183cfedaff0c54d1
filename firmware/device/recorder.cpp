#include "firmware/device/recorder.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <exception>
#include <optional>
#include <utility>

#include "firmware/device/log.h"
#include "firmware/device/register_log.h"
#include "firmware/settings/atomic_file.h"

namespace finsight {

namespace {

/// Makes the folder with the number after the highest one.
std::filesystem::path new_folder(const std::filesystem::path& parent) {
  int last = 0;
  std::filesystem::create_directories(parent);
  for (const auto& entry : std::filesystem::directory_iterator(parent)) {
    int number = 0;
    if (std::sscanf(entry.path().filename().c_str(), "session-%d", &number) == 1) last = std::max(last, number);
  }
  char name[32];
  std::snprintf(name, sizeof name, "session-%04d", last + 1);
  std::filesystem::create_directory(parent / name);
  return parent / name;
}

}  // namespace

/// One recording. Its files have their names from the start, so that a kill leaves what was written; one that fails
/// before its first frame leaves nothing.
struct Recorder::Session {
  Session(const std::filesystem::path& parent, const SessionInfo& session) : folder(new_folder(parent)), info(session) {
    try {
      info.complete = false;
      info.description = "recorded by finsightd, and cut off";
      write_file_atomically(folder / kSessionInfo, session_info_toml(info));
      images.emplace(folder / kSessionFrames);
      images->write(y4m_header(info.lens.width_px, info.lens.height_px, info.frames_per_second));
      registers.emplace(folder / "registers.csv");
      registers->write("frame," + csv_names_of_registers() + "\n");
      sync_folder(folder);
      sync_folder(parent);
    } catch (...) {
      remove();
      throw;
    }
  }
  ~Session() {
    if (frames == 0 && info.complete == false) remove();
  }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  void remove() {
    std::error_code ignored;
    std::filesystem::remove_all(folder, ignored);
  }
  void add(const Slot& slot) {
    images->write(kY4mFrame);
    images->write({reinterpret_cast<const char*>(slot.grey.data()), slot.grey.size()});
    registers->write(std::to_string(slot.sequence) + "," + csv_of_registers(slot.image.words) + "\n");
    ++frames;
  }
  double seconds() const { return frames / info.frames_per_second; }
  /// session.toml comes last: what it calls complete is on the disk.
  void finish(unsigned left_out) {
    images->sync();
    registers->sync();
    SessionInfo whole = info;
    whole.complete = true;
    whole.description = "recorded by finsightd: " + std::to_string(frames) + " frames, " + std::to_string(left_out) +
                        " left out because the disk was too slow";
    write_file_atomically(folder / kSessionInfo, session_info_toml(whole));
    sync_folder(folder.parent_path());
    info = whole;
  }

  std::filesystem::path folder;
  SessionInfo info;
  std::optional<GrowingFile> images, registers;
  unsigned frames = 0;
};

Recorder::Recorder(std::filesystem::path folder, const SessionInfo& info, const Limits& limits)
    : folder_(std::move(folder)), info_(info), limits_(limits) {
  for (Slot& slot : slots_) slot.grey.resize(static_cast<std::size_t>(info.lens.width_px) * info.lens.height_px);
  look_up_room();
  thread_ = std::thread([this] { run(); });
}

Recorder::~Recorder() {
  push_order(Order::kEnd);
  thread_.join();
}

// Frames leave room for orders, so these never wait.
void Recorder::push_order(Order order) {
  ++open_orders_;
  slots_[head_ % kSlots].order = order;
  push();
}

void Recorder::add(const Frame& frame, const RegisterImage& image) {
  if (state_ != State::kRecording || !frame.grey || frame.width_px != info_.lens.width_px ||
      frame.height_px != info_.lens.height_px) {
    return;
  }
  if (head_ - tail_ >= kSlots - kForOrders) {
    ++left_out_;
    return;
  }
  Slot& slot = slots_[head_ % kSlots];
  slot.order = Order::kFrame;
  slot.sequence = frame.sequence;
  slot.image = image;
  for (int y = 0; y < frame.height_px; ++y) {
    std::memcpy(&slot.grey[static_cast<std::size_t>(y) * frame.width_px],
                frame.grey + static_cast<std::ptrdiff_t>(y) * frame.stride_bytes, frame.width_px);
  }
  push();
}

// Of the disk that the folder is on, or will be on.
void Recorder::look_up_room() {
  std::filesystem::path folder = std::filesystem::absolute(folder_);
  std::error_code error;
  while (!std::filesystem::exists(folder, error) && folder.has_relative_path()) folder = folder.parent_path();
  const std::filesystem::space_info space = std::filesystem::space(folder, error);
  const auto free_mb = error ? 0 : static_cast<std::int64_t>(space.available / 1'000'000);
  mb_left_ = static_cast<int>(std::clamp<std::int64_t>(free_mb - limits_.reserve_mb, 0, 65534));
}

void Recorder::run() {
  std::optional<Session> session;
  const auto finish = [&](State state) {
    if (session) session->finish(left_out_);
    session.reset();
    state_ = state;
  };
  for (bool ended = false; !ended; ++tail_) {
    while (!filled_.try_acquire_for(std::chrono::seconds(1))) look_up_room();
    const Slot& slot = slots_[tail_ % kSlots];
    try {
      if (slot.order == Order::kStart) {
        left_out_ = 0;
        seconds_ = 0;
        session.emplace(folder_, info_);
        state_ = State::kRecording;
      } else if (slot.order != Order::kFrame) {
        ended = slot.order == Order::kEnd;
        if (state_ == State::kRecording) finish(State::kIdle);
      } else if (session) {
        session->add(slot);
        const auto seconds = static_cast<int>(session->seconds());
        // Frames may come much faster than their rate says; so the last megabytes are looked at frame by frame.
        constexpr int kFew_mb = 64;
        if (seconds != seconds_.exchange(seconds) || mb_left_ < kFew_mb) look_up_room();
        const auto frame_mb = static_cast<int>(slot.grey.size() / 1'000'000);
        if (seconds >= limits_.longest_s || mb_left_ <= frame_mb) finish(State::kFull);
      }
    } catch (const std::exception& error) {
      log_message(std::string("recording: ") + error.what());
      session.reset();
      state_ = State::kFailed;
    }
    if (slot.order != Order::kFrame) --open_orders_;
  }
}

}  // namespace finsight
