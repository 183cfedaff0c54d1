#include "firmware/device/finger.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <system_error>
#include <thread>
#include <utility>

#include "firmware/device/log.h"
#include "firmware/device/realtime.h"
#include "firmware/loop/self_test.h"
#include "firmware/settings/measured_fit.h"

namespace finsight {

namespace {

Model tested_model(const Settings& settings) {
  if (settings.unusable) throw InputError(*settings.unusable);
  Model model = Model::open(settings.pack);
  check_self_test(model, settings.loop.shape.tier);
  log_message(settings.name,
              "model " + model.finger_name + " (" + std::to_string(model.shape.tets) + " tets) passed its self-test");
  return model;
}

/// What was imported on the page takes the place of what was saved. A file that cannot be used is deleted; one that
/// finds no room waits for the next start. Returns why it has to wait, empty if it does not.
std::string take_imported(const Settings& settings, const ZeroBasis& basis) {
  if (!settings.page || settings.page->measured.empty() || settings.saved_state.empty()) return "";
  const std::filesystem::path file = settings.page->measured / kImportedState;
  try {
    if (!std::filesystem::is_regular_file(file)) return "";
    const std::optional<LoadedState> imported = load_state(file, &basis);
    if (!imported) return "";
    if (!imported->problem.empty()) throw InputError(imported->problem, "nothing of the import is used");
    save_state(settings.saved_state, imported->state, basis);
    log_message(settings.name, "settings and zero were imported on the page");
  } catch (const InputError& error) {
    log_message(settings.name, error.what());
  } catch (const std::system_error& error) {
    return std::string(error.what()) + "; the settings and the zero that were imported wait for the next start";
  }
  std::filesystem::remove(file);
  return "";
}

LoopSettings loop_settings_of(const Settings& settings, const Model& model, const std::optional<SessionInfo>& images) {
  LoopSettings loop = settings.loop;
  if (settings.mount) loop.mount = corrected_mount(model.mount, *settings.mount);
  if (loop.fit && settings.fit_is_stored && loop.fit->model_checksum != model.checksum) {
    log_message(settings.name, "the fit that was stored on the page is of another model pack and is not used");
    loop.fit.reset();  // An update that brings a new pack must leave a device that measures.
  }
  if (loop.fit) check_fit(*loop.fit, model.checksum, settings.fit_where);
  complete_from_source(settings, images, loop);
  return loop;
}

/// Without a sensor there is no finger that a zero could belong to.
LoadedState saved_state_of(const Settings& settings, const ZeroBasis* basis, const std::string& waiting = "") {
  LoadedState saved = load_state_or_factory(settings.saved_state, basis, settings.loop.runtime);
  if (saved.problem.empty()) saved.problem = waiting;
  if (!saved.problem.empty()) log_message(settings.name, saved.problem);
  return saved;
}

RuntimeSettings first_settings(const Settings& settings, const Sensor* sensor) {
  return sensor ? sensor->saved.state.settings : saved_state_of(settings, nullptr).state.settings;
}

}  // namespace

Sensor::Sensor(const Settings& settings, bool takes_import)
    : model(tested_model(settings)),
      images(source_images(settings, model)),
      loop_settings(loop_settings_of(settings, model, images)),
      loop(model, images ? std::optional(images->lens) : std::nullopt, loop_settings),
      source(open_source(settings, images)),
      basis{model.checksum, poses_of(loop_settings.mount.value_or(model.mount)), model.touch.threshold_mm},
      saved(saved_state_of(settings, &basis, takes_import ? take_imported(settings, basis) : "")) {
  if (!saved.problem.empty()) loop.set_lasting_fault(FaultCode::kSavedSettings);
}

Finger::Finger(const Settings& settings, std::unique_ptr<Sensor> sensor, FaultCode fault, const std::string& registers,
               OtherFingers others)
    : settings_(settings),
      sensor_(std::move(sensor)),
      others_(others),
      control_(settings.write_key, settings.loop.runtime, first_settings(settings, sensor_.get())),
      outputs_(settings.gpio),
      thermometer_(control_),
      health_(control_),
      registers_(registers),
      log_(registers) {
  control_.identify(identity_of(settings, sensor_ ? &sensor_->model : nullptr));
  control_.expect_gravity(kNsPerMs * settings.gravity_max_age_ms);
  if (!sensor_) {
    fault_.emplace(control_, fault);
    return;
  }
  if (!settings.saved_state.empty()) saver_.emplace(settings.saved_state, sensor_->basis);
  if (!settings.recordings.empty() && sensor_->images) {
    recorder_.emplace(settings.recordings, *sensor_->images,
                      Recorder::Limits{settings.record_max_s, settings.record_reserve_mb});
  }
  if (settings.page) {
    // A page that cannot be shown is no reason not to measure.
    try {
      page_.emplace(settings, sensor_->model, sensor_->images, sensor_->loop_settings);
    } catch (const std::exception& error) {
      log_message(settings.name, std::string(error.what()) + "; the page (page.folder) will show no live values");
    }
  }
  commands_.emplace(control_, sensor_->loop, saver_ ? &*saver_ : nullptr, recorder_ ? &*recorder_ : nullptr,
                    sensor_->saved.state, kNsPerMs * frame_timeout_ms(settings), others);
}

bool Finger::run(SharedDevice& device) {
  make_realtime(settings_.realtime);
  if (!sensor_) {
    serve_fault(device);
    return true;
  }
  const FingerAtWork work{others_.own,
                          settings_.name,
                          sensor_->source,
                          sensor_->loop,
                          *commands_,
                          outputs_,
                          log_,
                          health_,
                          recorder_ ? &*recorder_ : nullptr,
                          page_ ? &*page_ : nullptr};
  const bool done = run_loop(work, device, frame_timeout_ms(settings_));
  is_reset_ordered_ = commands_->reset_is_ordered();
  return done;
}

/// The outputs keep their safe levels.
void Finger::serve_fault(SharedDevice& device) {
  while (!device.stop && !device.is_over && device.sources > 0) {
    const std::int64_t now_ns = steady_now_ns();
    device.server.publish(fault_->next(now_ns), others_.own);
    device.supervisor.alive(now_ns, false, others_.own);
    if (others_.zeros && others_.zeros->take(others_.own)) others_.zeros->tell(others_.own, false);
    if (fault_->reset_is_due(now_ns)) device.is_over = is_reset_ordered_ = true;
    std::this_thread::sleep_for(std::chrono::milliseconds(FaultBlock::kEvery_ms));
  }
}

bool Finger::close() {
  if (!sensor_) return true;
  if (const auto left_out = log_.write()) {
    log_message(registers_ + ": " + std::to_string(left_out) + " later blocks had no room");
  }
  const SourceStatus& status = status_of(sensor_->source);
  const CameraCounts counts = status.counts();
  const LoopState& state = sensor_->loop.state();
  if (!settings_.name.empty()) std::fprintf(stderr, "%s:\n", settings_.name.c_str());
  std::fprintf(stderr, "%sframes %u, dropped %u, late %u, broken %u; camera lost %u times\n",
               sensor_->loop.times().table().c_str(), state.frames, state.dropped_frames, counts.late, counts.broken,
               counts.losses);
  return !status.ended() || status.error().empty();
}

}  // namespace finsight
