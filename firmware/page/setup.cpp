#include "firmware/page/setup.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "firmware/input_error.h"
#include "firmware/model/model.h"

namespace finsight::page {

namespace {

using nlohmann::json;

constexpr std::size_t kMostPictures = 80;
constexpr double kStill_px = 2;  // of the board's corners, over a third of a second
constexpr std::chrono::milliseconds kBetweenPictures(300), kPoll(10);
constexpr std::int64_t kMountTime_ns = 3 * kNsPerS, kPictureTime_ns = 2 * kNsPerS;
constexpr double kDegPerRad = 180 / std::numbers::pi;
constexpr const char* kNoFolder = "The board file names no folder for it (page.measured).";

/// Mean distance of corners that both have; large without any.
double moved_px(const BoardSight& a, const BoardSight& b) {
  double sum = 0;
  int both = 0;
  for (std::size_t i = 0; i < a.id.size(); ++i) {
    for (std::size_t j = 0; j < b.id.size(); ++j) {
      if (a.id[i] != b.id[j]) continue;
      sum += static_cast<double>((a.corner_px[i] - b.corner_px[j]).norm());
      ++both;
    }
  }
  return both > 0 ? sum / both : 1e9;
}

/// Pictures of one size only: the first decides.
Coverage ninths_of(std::vector<BoardView>& views) {
  LensCalibration any;
  any.lens = Lens{.width_px = 1, .height_px = 1, .fx = 1, .fy = 1};
  if (!views.empty()) {
    any.lens.width_px = views[0].width_px;
    any.lens.height_px = views[0].height_px;
  }
  Coverage coverage = coverage_of(any, views);
  coverage.tilted = {};  // not known before there is a lens
  return coverage;
}

json three(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

}  // namespace

Setup::Setup(const Settings& settings, Device& device)
    : settings_(settings), device_(device), finder_(board_), thread_([this] { run(); }) {}

Setup::~Setup() {
  {
    const std::lock_guard guard(mutex_);
    stopping_ = true;
  }
  wake_.notify_one();
  thread_.join();
}

bool Setup::is_stopping() {
  const std::lock_guard guard(mutex_);
  return stopping_;
}

void Setup::run() {
  for (;;) {
    std::function<void()> work;
    {
      std::unique_lock guard(mutex_);
      wake_.wait(guard, [&] { return stopping_ || work_; });
      if (stopping_) return;
      work = std::exchange(work_, nullptr);
    }
    work();
    const std::lock_guard guard(mutex_);
    is_busy_ = false;
  }
}

std::optional<Refusal> Setup::begin(std::function<void()> work) {
  {
    const std::lock_guard guard(mutex_);
    if (is_busy_) return Refusal{409, "The last picture or measurement is still being worked on."};
    is_busy_ = true;
    work_ = std::move(work);
  }
  wake_.notify_one();
  return std::nullopt;
}

std::optional<Refusal> Setup::capture(bool only_still) {
  return begin([this, only_still] {
    std::string error;
    try {
      take_view(only_still);
    } catch (const std::exception& problem) {
      error = problem.what();
    }
    if (error.empty()) return compute();
    const std::lock_guard guard(mutex_);
    lens_error_ = only_still ? "" : error;
  });
}

void Setup::take_view(bool only_still) {
  const auto look = [&] {
    device_.watch();
    const std::int64_t until_ns = steady_now_ns() + kPictureTime_ns;
    std::optional<PublishedPicture> picture;
    while (!(picture = device_.picture()) && steady_now_ns() < until_ns && !is_stopping()) {
      std::this_thread::sleep_for(kPoll);
    }
    if (!picture) throw std::runtime_error("There is no picture.");
    return view_of("", {picture->grey.data(), picture->width_px, picture->height_px, picture->width_px}, finder_);
  };
  BoardView view = look();
  if (only_still) {
    std::this_thread::sleep_for(kBetweenPictures);
    const BoardView second = look();
    if (moved_px(view.sight, second.sight) > kStill_px) throw std::runtime_error("The board moves.");
  }
  const std::lock_guard guard(mutex_);
  if (captured_.size() >= kMostPictures) throw std::runtime_error("There are enough pictures; remove some first.");
  view.name = "picture " + std::to_string(next_id_);
  if (only_still) {
    std::vector<BoardView> all;
    for (const Captured& one : captured_) all.push_back(one.view);
    all.push_back(view);
    reject_bad_views(board_, all);
    if (!all.back().rejected.empty()) throw std::runtime_error(all.back().rejected);
  }
  captured_.push_back({next_id_++, std::move(view)});
}

/// From all pictures that are there.
void Setup::compute() {
  std::vector<BoardView> views;
  {
    const std::lock_guard guard(mutex_);
    for (const Captured& one : captured_) views.push_back(one.view);
  }
  reject_bad_views(board_, views);
  std::optional<LensCalibration> calibration;
  std::string error;
  Coverage coverage = ninths_of(views);
  std::vector<BoardView> judged = views;
  if (used_views(views).size() >= kMinViews) {
    try {
      calibration = calibrate_lens(board_, judged, "pictures", [this] {
        if (is_stopping()) throw InputError("page", "stopped");
      });
      coverage = coverage_of(*calibration, judged);
    } catch (const InputError& problem) {
      error = problem.what();
    }
  }
  const std::lock_guard guard(mutex_);
  shown_ = std::move(judged);
  coverage_ = coverage;
  calibration_ = calibration;
  lens_error_ = error;
}

std::optional<Refusal> Setup::remove(std::int64_t id) {
  {
    const std::lock_guard guard(mutex_);
    if (std::ranges::find(captured_, id, &Captured::id) == captured_.end()) {
      return Refusal{404, "There is no picture of that number."};
    }
  }
  return begin([this, id] {
    {
      const std::lock_guard guard(mutex_);
      std::erase_if(captured_, [&](const Captured& one) { return one.id == id; });
    }
    compute();
  });
}

std::optional<Refusal> Setup::clear() {
  return begin([this] {
    {
      const std::lock_guard guard(mutex_);
      captured_.clear();
    }
    compute();
  });
}

std::optional<Refusal> Setup::measure_mount() {
  return begin([this] {
    std::string error;
    try {
      measure();
    } catch (const std::exception& problem) {
      error = problem.what();
    }
    const std::lock_guard guard(mutex_);
    mount_error_ = error;
    if (!error.empty()) estimate_.reset();
  });
}

void Setup::measure() {
  const json about = json::parse(device_.about(), nullptr, false);
  if (!about.is_object() || !about.contains("lens"))
    throw std::runtime_error("There is no camera or session to look through.");
  const json& given = about["lens"];
  LensNumbers numbers{};
  for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = given.at(kLensNames[i]).get<double>();
  const Lens lens = make_lens(given.at("width_px").get<int>(), given.at("height_px").get<int>(), numbers);
  RestingCornersSum sum;
  std::uint64_t last = 0;
  const std::int64_t until_ns = steady_now_ns() + kMountTime_ns;
  while (steady_now_ns() < until_ns && !is_stopping()) {
    std::this_thread::sleep_for(kPoll);
    const auto frame = device_.frame();
    if (!frame || frame->number == last) continue;
    last = frame->number;
    MarkerCorners corners;
    for (std::size_t p = 0; p < kPlates; ++p) {
      corners.seen[p] = frame->marker_found[p] != 0;
      for (std::size_t k = 0; k < 4; ++k)
        corners.corners_px[p][k] = {frame->corners_px[p][k][0], frame->corners_px[p][k][1]};
    }
    sum.add(corners);
  }
  const Model model = Model::open(settings_.pack);
  const MountEstimate estimate = estimate_mount(model.mount, sum.mean(lens, "camera"), "camera");
  const std::lock_guard guard(mutex_);
  estimate_ = estimate;
  mount_pictures_ = sum.frames();
}

json Setup::lens() {
  const std::lock_guard guard(mutex_);
  json state = {{"is_busy", is_busy_},        {"error", lens_error_},
                {"least_views", kMinViews},   {"coverage", coverage_.views},
                {"tilted", coverage_.tilted}, {"advice", json::array()},
                {"views", json::array()},     {"can_store", !settings_.page->measured.empty()}};
  for (std::size_t i = 0; i < captured_.size(); ++i) {
    const BoardView& view = i < shown_.size() ? shown_[i] : captured_[i].view;
    state["views"].push_back({{"id", captured_[i].id},
                              {"corners", captured_[i].view.sight.id.size()},
                              {"rejected", view.rejected},
                              {"rms_px", view.rms_px}});
  }
  if (calibration_) {
    state["advice"] = advice(coverage_);
    state["result"] = {
        {"lens", lens_numbers(calibration_->lens)}, {"sigma", calibration_->sigma}, {"rms_px", calibration_->rms_px}};
  }
  return state;
}

json Setup::mount() {
  const std::lock_guard guard(mutex_);
  json state = {{"is_running", is_busy_}, {"error", mount_error_}, {"can_store", !settings_.page->measured.empty()}};
  if (!estimate_) return state;
  json parts = json::array();
  for (int i = 0; i < 1 + kPlates; ++i) {
    parts.push_back({{"name", i == 0 ? "camera" : kPlateNames[static_cast<std::size_t>(i - 1)]},
                     {"shift_mm", three(estimate_->change.col(i).head<3>())},
                     {"shift_sigma_mm", three(estimate_->sigma.col(i).head<3>())},
                     {"turn_deg", three(kDegPerRad * estimate_->change.col(i).tail<3>())},
                     {"turn_sigma_deg", three(kDegPerRad * estimate_->sigma.col(i).tail<3>())}});
  }
  state["result"] = {{"parts", parts}, {"rms_px", estimate_->rms_px}, {"pictures", mount_pictures_}};
  return state;
}

std::string Setup::lens_toml() {
  const std::lock_guard guard(mutex_);
  return calibration_ ? lens_file(*calibration_, "pictures on the commissioning page") : "";
}

std::string Setup::mount_toml() {
  const std::lock_guard guard(mutex_);
  if (!estimate_) return "";
  return "# Where camera and markers of this device are, measured on the commissioning page.\n"
         "# In a board file: mount = \"this file\", before the first table.\n" +
         measured_mount_toml(estimate_->mount);
}

std::optional<Refusal> Setup::use(Part part, const std::string& toml, const Restart& restart) {
  if (part != Part::kFit && toml.empty()) return Refusal{409, "There is no result to store."};
  try {
    check_part(part, toml, finger_at_start(settings_));
  } catch (const InputError& error) {
    return Refusal{400, std::string(error.what()) + "."};
  }
  if (settings_.page->measured.empty()) return Refusal{409, kNoFolder};
  return store_parts(settings_.page->measured, {{part, toml}}, restart);
}

std::optional<Refusal> Setup::restore(Part part, const Restart& restart) {
  if (settings_.page->measured.empty()) return Refusal{409, kNoFolder};
  return bring_back(
      settings_.page->measured, part, [this] { return finger_at_start(settings_); }, restart);
}

}  // namespace finsight::page
