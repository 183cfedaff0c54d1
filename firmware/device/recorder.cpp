#include "firmware/device/recorder.h"

#include <algorithm>
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

/// One recording. Its files get their names when it is over; one that fails leaves nothing behind.
struct Recorder::Session {
  Session(const std::filesystem::path& parent, const SessionInfo& session)
      : folder(new_folder(parent)),
        info(session),
        images(folder / kSessionFrames, info.lens.width_px, info.lens.height_px, info.frames_per_second),
        registers(folder / "registers.csv") {
    registers.write("frame," + csv_names_of_registers() + "\n");
  }
  ~Session() {
    std::error_code ignored;
    if (!is_finished) std::filesystem::remove_all(folder, ignored);
  }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  void add(const Slot& slot) {
    images.write(slot.grey.data());
    registers.write(std::to_string(slot.sequence) + "," + csv_of_registers(slot.image.words) + "\n");
    ++frames;
  }
  /// session.toml comes last: a folder that has one is complete.
  void finish(unsigned left_out) {
    images.finish();
    registers.commit();
    info.description = "recorded by finsightd: " + std::to_string(frames) + " frames, " + std::to_string(left_out) +
                       " left out because the disk was too slow";
    write_file_atomically(folder / kSessionInfo, session_info_toml(info));
    sync_folder(folder.parent_path());
    is_finished = true;
  }

  std::filesystem::path folder;
  SessionInfo info;
  Y4mWriter images;
  AtomicFile registers;
  unsigned frames = 0;
  bool is_finished = false;
};

Recorder::Recorder(std::filesystem::path folder, const SessionInfo& info) : folder_(std::move(folder)), info_(info) {
  for (Slot& slot : slots_) slot.grey.resize(static_cast<std::size_t>(info.lens.width_px) * info.lens.height_px);
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

void Recorder::run() {
  std::optional<Session> session;
  for (bool ended = false; !ended; ++tail_) {
    filled_.acquire();
    const Slot& slot = slots_[tail_ % kSlots];
    try {
      if (slot.order == Order::kStart) {
        left_out_ = 0;
        session.emplace(folder_, info_);
        state_ = State::kRecording;
      } else if (slot.order == Order::kFrame) {
        if (session) session->add(slot);
      } else {
        ended = slot.order == Order::kEnd;
        if (session) session->finish(left_out_);
        session.reset();
        if (state_ == State::kRecording) state_ = State::kIdle;
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
