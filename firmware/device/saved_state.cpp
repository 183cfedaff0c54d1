#include "firmware/device/saved_state.h"

#include <utility>

#include "firmware/device/log.h"
#include "firmware/input_error.h"
#include "firmware/settings/atomic_file.h"
#include "firmware/settings/state_text.h"
#include "firmware/settings/toml_table.h"

namespace finsight {

std::optional<LoadedState> load_state(const std::filesystem::path& file, const ZeroBasis* basis) {
  if (!std::filesystem::exists(file)) return std::nullopt;
  return read_state(TomlTable::parse_file(file), file.string(), basis);
}

LoadedState load_state_or_factory(const std::filesystem::path& file, const ZeroBasis* basis,
                                  const RuntimeSettings& factory) {
  const LoadedState unsaved{{factory, std::nullopt}, ""};
  if (file.empty()) return unsaved;
  try {
    return load_state(file, basis).value_or(unsaved);
  } catch (const InputError& error) {
    return {unsaved.state, std::string(error.what()) + "; the factory settings are used"};
  }
}

void save_state(const std::filesystem::path& file, const SavedState& state, const ZeroBasis& basis) {
  write_file_atomically(file, state_text(state.settings, state.zero, state.zero_g, basis.model_checksum, basis.mount));
}

StateSaver::StateSaver(std::filesystem::path file, ZeroBasis basis)
    : file_(std::move(file)), basis_(std::move(basis)), thread_([this] { run(); }) {}

StateSaver::~StateSaver() {
  stopping_ = true;
  work_.release();
  thread_.join();
}

void StateSaver::begin(const SavedState& state) {
  state_ = state;
  progress_ = Progress::kSaving;
  work_.release();
}

std::optional<bool> StateSaver::outcome() {
  const Progress progress = progress_;
  if (progress != Progress::kSaved && progress != Progress::kFailed) return std::nullopt;
  progress_ = Progress::kIdle;
  return progress == Progress::kSaved;
}

void StateSaver::run() {
  for (;;) {
    work_.acquire();
    if (progress_ == Progress::kSaving) {
      try {
        save_state(file_, state_, basis_);
        progress_ = Progress::kSaved;
      } catch (const std::exception& error) {
        log_message(error.what());
        progress_ = Progress::kFailed;
      }
    }
    if (stopping_) return;
  }
}

}  // namespace finsight
