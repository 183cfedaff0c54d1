// The wizard's work: pictures of a board -> the lens, the finger at rest -> the mount. By the code of hostgen calibrate
// and mount.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "firmware/calibrate/lens_calibration.h"
#include "firmware/calibrate/mount_estimate.h"
#include "firmware/page/device.h"
#include "firmware/page/measured_files.h"
#include "firmware/page/request_guard.h"
#include "firmware/settings/settings.h"

namespace finsight::page {

/// Thread-safe. One piece of work at a time, in a thread of its own; what it came to is in lens() and mount().
class Setup {
 public:
  Setup(const Settings& settings, Device& device);
  ~Setup();

  nlohmann::json lens();
  nlohmann::json mount();
  /// What is to be stored under page.measured, or downloaded. Empty: there is no result.
  std::string lens_toml();
  std::string mount_toml();

  // Begin something; a refusal says why not.
  /// `only_still`: nothing is kept unless the board is held still and shows something new.
  std::optional<Refusal> capture(bool only_still);
  std::optional<Refusal> remove(std::int64_t id);
  std::optional<Refusal> clear();
  std::optional<Refusal> measure_mount();
  /// Stores a result, lens_toml() or mount_toml(), or what `hostgen fit` has written, and restarts finsightd with it.
  /// What that would not start with is refused. The former one stays beside it.
  std::optional<Refusal> use(Part part, const std::string& toml, const Restart& restart);
  /// See bring_back().
  std::optional<Refusal> restore(Part part, const Restart& restart);

 private:
  struct Captured {
    int id = 0;
    BoardView view;
  };
  std::optional<Refusal> begin(std::function<void()> work);
  void run();
  void take_view(bool only_still);
  void compute();
  void measure();
  bool is_stopping();

  const Settings& settings_;
  Device& device_;
  const CharucoBoard board_;
  BoardFinder finder_;  ///< the worker's alone

  std::mutex mutex_;  ///< over what follows
  std::condition_variable wake_;
  bool stopping_ = false;
  std::function<void()> work_;
  bool is_busy_ = false;
  int next_id_ = 1;
  std::vector<Captured> captured_;
  std::vector<BoardView> shown_;  ///< of captured_, as judged
  Coverage coverage_;
  std::optional<LensCalibration> calibration_;
  std::string lens_error_;
  std::optional<MountEstimate> estimate_;
  int mount_pictures_ = 0;
  std::string mount_error_;
  std::thread thread_;
};

}  // namespace finsight::page
