#include "firmware/device/recorder.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <exception>
#include <fstream>
#include <optional>
#include <utility>

namespace finsight {

namespace {

/// The first number that no folder has, and none after it: names are never used again while a later one exists.
std::filesystem::path next_folder(const std::filesystem::path& parent) {
  int last = 0;
  std::filesystem::create_directories(parent);
  for (const auto& entry : std::filesystem::directory_iterator(parent)) {
    int number = 0;
    if (std::sscanf(entry.path().filename().c_str(), "session-%d", &number) == 1) last = std::max(last, number);
  }
  char name[32];
  std::snprintf(name, sizeof name, "session-%04d", last + 1);
  return parent / name;
}

void write_text(const std::filesystem::path& file, const std::string& text) {
  std::ofstream out(file);
  out << text;
  out.flush();
  if (!out) throw std::runtime_error(file.string() + ": cannot be written");
}

}  // namespace

/// The files of one recording; the images get their name when it is over.
struct Recorder::Session {
  Session(const std::filesystem::path& parent, const SessionInfo& session)
      : folder(next_folder(parent)), info(session) {
    std::filesystem::create_directory(folder);
    images.emplace(folder / kSessionFrames, info.width_px, info.height_px, info.frames_per_second);
    registers.open(folder / "registers.csv");
    registers << "frame";
    for (int i = 0; i < kMeasurementRegisters; ++i) registers << ",r" << i;
    registers << "\n";
  }
  void add(const Slot& slot) {
    images->write(slot.grey.data());
    registers << slot.sequence;
    for (const std::uint16_t word : slot.image.words) registers << "," << word;
    registers << "\n";
    ++frames;
  }
  void finish(unsigned left_out) {
    images->finish();
    registers.flush();
    if (!registers) throw std::runtime_error((folder / "registers.csv").string() + ": cannot be written");
    info.description = "recorded by finsightd: " + std::to_string(frames) + " frames, " + std::to_string(left_out) +
                       " left out because the disk was too slow";
    write_text(folder / kSessionInfo, session_info_toml(info));
  }

  std::filesystem::path folder;
  SessionInfo info;
  std::optional<Y4mWriter> images;
  std::ofstream registers;
  unsigned frames = 0;
};

Recorder::Recorder(std::filesystem::path folder, const SessionInfo& info) : folder_(std::move(folder)), info_(info) {
  for (Slot& slot : slots_) slot.grey.resize(static_cast<std::size_t>(info.width_px) * info.height_px);
  thread_ = std::thread([this] { run(); });
}

Recorder::~Recorder() {
  push_order(Order::kEnd);
  thread_.join();
}

// Frames leave room for these, so they never wait.
void Recorder::push_order(Order order) {
  ++open_orders_;
  slots_[head_ % kSlots].order = order;
  push();
}

void Recorder::add(const Frame& frame, const RegisterImage& image) {
  if (state_ != State::kRecording || !frame.grey || frame.width_px != info_.width_px ||
      frame.height_px != info_.height_px) {
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
      std::fprintf(stderr, "finsightd: recording: %s\n", error.what());
      session.reset();
      state_ = State::kFailed;
    }
    if (slot.order != Order::kFrame) --open_orders_;
  }
}

}  // namespace finsight
