#include "hostgen/recordings/recording_training.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>

#include "firmware/geometry/plate_motion.h"
#include "firmware/input_error.h"
#include "firmware/model/plate_prior.h"
#include "firmware/touch/features.h"
#include "firmware/touch/touch_stage.h"
#include "hostgen/learn/network.h"
#include "hostgen/learn/regression.h"
#include "hostgen/learn/split.h"
#include "hostgen/recordings/audit.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

constexpr int kFolds = 5;

/// The rows that are used, in the order of the file.
struct Rows {
  std::vector<PlatePoses> poses;
  Eigen::Matrix3Xf pen_mm;
  std::vector<int> point;
  std::vector<std::string> recording;
};

/// Appends; recordings and contact points of different files are different.
void add_usable_rows(const RecordedMotion& motion, const std::string& file, Rows& rows) {
  const std::vector<bool> outlier = find_outliers(motion);
  const int first_point = rows.point.empty() ? 0 : 1 + *std::ranges::max_element(rows.point);
  std::vector<Vec3f> pen_mm;
  for (std::size_t row = 0; row < outlier.size(); ++row) {
    if (outlier[row]) continue;
    rows.poses.push_back(motion.poses[row]);
    rows.point.push_back(first_point + motion.surface_node[row]);
    rows.recording.push_back(file + motion.recording[row]);
    pen_mm.push_back(motion.pen_mm[row]);
  }
  const Eigen::Index before = rows.pen_mm.cols();
  rows.pen_mm.conservativeResize(3, before + static_cast<Eigen::Index>(pen_mm.size()));
  for (std::size_t i = 0; i < pen_mm.size(); ++i) rows.pen_mm.col(before + static_cast<Eigen::Index>(i)) = pen_mm[i];
}

/// Trains on the first rows in so many steps, predicts the second ones.
using Learner = std::function<Eigen::MatrixXf(const std::vector<std::size_t>&, const std::vector<std::size_t>&,
                                              int steps, const std::function<void()>& tick)>;

template <class Matrix>
Eigen::MatrixXf columns(const Matrix& all, const std::vector<std::size_t>& rows) {
  Eigen::MatrixXf chosen(all.rows(), static_cast<Eigen::Index>(rows.size()));
  for (std::size_t i = 0; i < rows.size(); ++i)
    chosen.col(static_cast<Eigen::Index>(i)) = all.col(static_cast<Eigen::Index>(rows[i]));
  return chosen;
}

Learner regression_learner(Eigen::MatrixXf inputs, const Rows& rows, const RegressionPlan& plan) {
  return [inputs = std::move(inputs), &rows, plan](const auto& train, const auto& test, int steps, const auto& tick) {
    RegressionPlan now = plan;
    now.steps = steps;
    Regression network(columns(inputs, train), columns(rows.pen_mm, train), now, tick);
    return network.predict(columns(inputs, test));
  };
}

Eigen::MatrixXf paper_inputs(const Rows& rows) {
  Eigen::MatrixXf inputs(kPoseDims, rows.pen_mm.cols());
  for (Eigen::Index i = 0; i < inputs.cols(); ++i) {
    const PlateMotion& plate = rows.poses[static_cast<std::size_t>(i)].plates[kTopPlate];
    for (int copy = 0; copy < 3; ++copy) {
      inputs.col(i).segment<3>(6 * copy) = plate.displacement_mm;
      inputs.col(i).segment<3>(6 * copy + 3) = plate.rotation_rad;
    }
  }
  return inputs;
}

Eigen::Matrix<float, 6, 1> plate_millimetres(const PlatePoses& poses) {
  const PlateMotion& plate = poses.plates[kTopPlate];
  Eigen::Matrix<float, 6, 1> numbers;
  numbers << plate.displacement_mm, kMillimetresPerRadian * plate.rotation_rad;
  return numbers;
}

// Direction and size of the plate's motion: touches of one point then look nearly alike at every force.
Eigen::MatrixXf direction_inputs(const Rows& rows) {
  Eigen::MatrixXf inputs(7, rows.pen_mm.cols());
  for (Eigen::Index i = 0; i < inputs.cols(); ++i) {
    const Eigen::Matrix<float, 6, 1> numbers = plate_millimetres(rows.poses[static_cast<std::size_t>(i)]);
    const float size = numbers.norm() + kSmallestMotion;
    for (int k = 0; k < 6; ++k) inputs(k, i) = numbers[k] / size;
    inputs(6, i) = std::log(size);
  }
  return inputs;
}

// Direction, and the plate's numbers now and up to a quarter of a second ago (60 frames/s). Several frames average the
// noise of a single marker's tilt, and a real finger creeps, so its recent motion also says where it is pushed. Before
// its first row a recording counts as at rest.
Eigen::MatrixXf history_inputs(const Rows& rows) {
  constexpr std::array<std::size_t, 5> kFramesAgo = {0, 2, 4, 8, 15};
  const Eigen::MatrixXf direction = direction_inputs(rows);
  Eigen::MatrixXf inputs(direction.rows() + 6 * static_cast<Eigen::Index>(kFramesAgo.size()), direction.cols());
  inputs.topRows(direction.rows()) = direction;
  std::size_t first = 0;  // of the recording
  for (std::size_t row = 0; row < rows.poses.size(); ++row) {
    if (rows.recording[row] != rows.recording[first]) first = row;
    for (std::size_t k = 0; k < kFramesAgo.size(); ++k) {
      const std::size_t then = row - std::min(kFramesAgo[k], row - first);
      inputs.col(static_cast<Eigen::Index>(row)).segment<6>(direction.rows() + 6 * static_cast<Eigen::Index>(k)) =
          plate_millimetres(rows.poses[then]);
    }
  }
  return inputs;
}

// The pack's network in floats, trained further. Recordings hold the contact point, which is touched point plus
// displacement, so the output rows of both receive the same gradient.
class PackNetwork {
 public:
  PackNetwork(const Model& pack, const Rows& rows, const RecordingTrainingPlan& plan)
      : model_(pack.touch), rows_(rows), plan_(plan), inputs_(TouchModel::kInputs, rows.pen_mm.cols()) {
    for (Eigen::Index i = 0; i < inputs_.cols(); ++i) {
      PlatePoses poses = rows.poses[static_cast<std::size_t>(i)];
      complete_from_prior(pack.prior, poses);
      touch_features(model_, pose_vector(poses), network_noise(poses), 0,
                     std::span<float, TouchModel::kInputs>(inputs_.col(i).data(), TouchModel::kInputs));
    }
  }

  Eigen::MatrixXf as_simulated(const std::vector<std::size_t>& test) const {
    Network network = network_of_pack();
    return contact(network.forward(columns(inputs_, test)));
  }

  Eigen::MatrixXf fine_tuned(const std::vector<std::size_t>& train, const std::vector<std::size_t>& test, int steps,
                             const std::function<void()>& tick) const {
    constexpr float kPeakRate = 5e-4f;  // half of that for training from scratch
    Network network = network_of_pack();
    Adam adam(network);
    Random random(plan_.seed);
    Eigen::MatrixXf x(inputs_.rows(), 128), pen_mm(3, 128), gradient;
    for (int step = 0; step < steps; ++step) {
      for (Eigen::Index column = 0; column < x.cols(); ++column) {
        const auto row = static_cast<Eigen::Index>(train[random.index(train.size())]);
        x.col(column) = inputs_.col(row);
        pen_mm.col(column) = rows_.pen_mm.col(row);
      }
      const Eigen::MatrixXf& outputs = network.forward(x);
      const Eigen::MatrixXf error = (contact(outputs) - pen_mm) / static_cast<float>(x.cols());
      gradient.setZero(outputs.rows(), outputs.cols());
      for (int i = 0; i < 3; ++i) {
        // Each coordinate is scaled by its standard deviation, as in the training of the pack.
        gradient.row(i) = error.row(i) / scale(i);
        gradient.row(3 + i) = error.row(i) * scale(3 + i) / (scale(i) * scale(i));
      }
      network.backward(gradient);
      adam.step(network, cosine_rate(kPeakRate, step, steps));
      tick();
    }
    return contact(network.forward(columns(inputs_, test)));
  }

 private:
  float scale(int i) const { return model_.output_scale[static_cast<std::size_t>(i)]; }
  float mean(int i) const { return model_.output_mean[static_cast<std::size_t>(i)]; }

  template <class Weight>
  static Network::Layer layer_of(std::span<const Weight> weights, int outputs, int inputs,
                                 std::span<const float> bias) {
    using RowMajor = Eigen::Matrix<Weight, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    return {Eigen::Map<const RowMajor>(weights.data(), outputs, inputs).template cast<float>(),
            Eigen::Map<const Eigen::VectorXf>(bias.data(), outputs)};
  }
  static Network::Layer layer_of(const DenseFloat& of) { return layer_of(of.weights, of.outputs, of.inputs, of.bias); }
  static Network::Layer layer_of(const DenseInt8& of) {
    Network::Layer layer = layer_of(of.weights, of.outputs, of.inputs, of.bias);
    layer.weights = Eigen::Map<const Eigen::VectorXf>(of.scale.data(), of.outputs).asDiagonal() * layer.weights;
    return layer;
  }

  Network network_of_pack() const {
    std::vector<Network::Layer> layers = {layer_of(model_.first)};
    for (const DenseInt8& layer : model_.middle) layers.push_back(layer_of(layer));
    layers.push_back(layer_of(model_.last));
    std::vector<int> widths = {model_.first.inputs};
    for (const Network::Layer& layer : layers) widths.push_back(static_cast<int>(layer.bias.size()));
    Random random(1);  // arbitrary: every weight is replaced
    Network network(widths, Activation::kAlgebraicSilu, random);
    network.layers() = std::move(layers);
    return network;
  }

  Eigen::MatrixXf contact(const Eigen::MatrixXf& outputs) const {
    Eigen::MatrixXf place(3, outputs.cols());
    for (int i = 0; i < 3; ++i) {
      place.row(i) =
          (mean(i) + mean(3 + i) + scale(i) * outputs.row(i).array() + scale(3 + i) * outputs.row(3 + i).array())
              .matrix();
    }
    return place;
  }

  const TouchModel& model_;
  const Rows& rows_;
  RecordingTrainingPlan plan_;
  Eigen::MatrixXf inputs_;
};

struct Method {
  std::string name;
  Learner learner;
  bool learns = true;
};

double mean_distance_mm(const Eigen::MatrixXf& truth, const Eigen::MatrixXf& predicted) {
  return static_cast<double>((predicted - truth).colwise().norm().mean());
}

/// Trains as long as it helps rows that are held out (whole contact points, unless the split is by rows); then on all,
/// for as long as that was.
struct Trained {
  Eigen::MatrixXf predicted;
  int steps = 0;
};
Trained train_and_predict(const Method& method, const Rows& rows, const Split& split, bool by_point,
                          const RecordingTrainingPlan& plan, const std::function<void()>& tick) {
  constexpr int kShortest = 32;      // share of the most steps
  constexpr double kBetter = 0.995;  // errors of held-out points scatter by more than the rest
  if (!method.learns) return {method.learner(split.train, split.test, 0, tick), 0};
  std::vector<int> group;
  for (const std::size_t row : split.train) group.push_back(by_point ? rows.point[row] : static_cast<int>(row));
  const Split inner = group_split(group, kFolds, 0, plan.seed + 1);
  std::vector<std::size_t> learn, held_out;
  for (const std::size_t i : inner.train) learn.push_back(split.train[i]);
  for (const std::size_t i : inner.test) held_out.push_back(split.train[i]);
  int best_steps = plan.steps;
  if (!learn.empty() && !held_out.empty()) {
    const Eigen::MatrixXf truth = columns(rows.pen_mm, held_out);
    double best_mm = std::numeric_limits<double>::infinity();
    for (int steps = std::max(1, plan.steps / kShortest); steps <= plan.steps; steps *= 2) {
      const double error_mm = mean_distance_mm(truth, method.learner(learn, held_out, steps, tick));
      if (error_mm > kBetter * best_mm) break;
      best_mm = error_mm;
      best_steps = steps;
    }
  }
  return {method.learner(split.train, split.test, best_steps, tick), best_steps};
}

// Predictions of all folds, in the order of the rows.
struct Predictions {
  Split random;
  Eigen::MatrixXf at_random;
  Eigen::Matrix3Xf by_point;
  Eigen::MatrixXf other;
  std::vector<int> steps;
};

AxisErrors errors_of(const Eigen::MatrixXf& truth, const Eigen::MatrixXf& predicted) {
  return axis_errors(truth.cast<double>(), (predicted - truth).cast<double>());
}

/// `count`: of the rows that are trained on; those after them are the other file's.
RecordingScore score(const std::string& name, const Rows& rows, Eigen::Index count, const Predictions& predictions) {
  const Eigen::MatrixXf own = rows.pen_mm.leftCols(count), other = rows.pen_mm.rightCols(rows.pen_mm.cols() - count);
  RecordingScore result{.method = name,
                        .random = errors_of(columns(rows.pen_mm, predictions.random.test), predictions.at_random),
                        .by_point = errors_of(own, predictions.by_point),
                        .mean_mm = mean_distance_mm(own, predictions.by_point),
                        .steps = {std::ranges::min(predictions.steps), std::ranges::max(predictions.steps)},
                        .other = {},
                        .other_mean_mm = 0};
  if (other.cols() > 0) {
    result.other = errors_of(other, predictions.other);
    result.other_mean_mm = mean_distance_mm(other, predictions.other);
  }
  return result;
}

}  // namespace

std::vector<RecordingScore> train_on_recordings(const RecordedMotion& motion, const Model* pack,
                                                const RecordingTrainingPlan& plan, const RecordedMotion* test) {
  Rows rows;
  add_usable_rows(motion, "", rows);
  const std::size_t count = rows.poses.size();
  const std::vector<int> point = rows.point;
  for (int fold = 0; fold < kFolds; ++fold) {
    if (group_split(point, kFolds, fold, plan.seed).test.empty()) {
      throw InputError("recordings", "contact points", "too few to split by point",
                       std::to_string(kFolds) + " or more");
    }
  }
  if (test) add_usable_rows(*test, "test ", rows);
  if (test && rows.poses.size() == count) throw InputError("--test", "no usable row in it");
  const RegressionPlan network_plan{.hidden = plan.hidden, .steps = plan.steps, .seed = plan.seed};
  RegressionPlan deeper_plan = network_plan;
  deeper_plan.hidden.insert(deeper_plan.hidden.begin(), plan.hidden.front());
  std::vector<Method> methods = {{"paper", regression_learner(paper_inputs(rows), rows, network_plan)},
                                 {"direction", regression_learner(direction_inputs(rows), rows, network_plan)},
                                 {"history", regression_learner(history_inputs(rows), rows, deeper_plan)}};
  std::optional<PackNetwork> network;
  if (pack) {
    network.emplace(*pack, rows, plan);
    methods.push_back({"simulation",
                       [&](const auto&, const auto& tested, int, const auto&) { return network->as_simulated(tested); },
                       false});
    methods.push_back({"fine-tuned", [&](const auto& train, const auto& tested, int steps, const auto& tick) {
                         return network->fine_tuned(train, tested, steps, tick);
                       }});
  }

  // Of each method: one per fold, the random split, and one on everything for the other file.
  const int trainings = kFolds + 1 + (test ? 1 : 0);
  std::vector<Predictions> predictions(methods.size());
  for (Predictions& one : predictions) {
    one.by_point.resize(3, static_cast<Eigen::Index>(count));
    one.steps.resize(static_cast<std::size_t>(trainings));
  }
  Progress progress("networks on recordings", methods.size() * static_cast<std::size_t>(trainings));
  const auto tick = [] {
    if (interrupted()) throw Interrupted();
  };
  parallel_for(methods.size() * static_cast<std::size_t>(trainings), [&](std::size_t work) {
    const std::size_t m = work / static_cast<std::size_t>(trainings);
    const int kind = static_cast<int>(work % static_cast<std::size_t>(trainings));
    Split split;
    if (kind < kFolds) {
      split = group_split(point, kFolds, kind, plan.seed);
    } else if (kind == kFolds) {
      split = random_split(count, plan.seed);
    } else {
      for (std::size_t row = 0; row < rows.poses.size(); ++row) (row < count ? split.train : split.test).push_back(row);
    }
    const Trained answer = train_and_predict(methods[m], rows, split, kind != kFolds, plan, tick);
    Predictions& into = predictions[m];
    into.steps[static_cast<std::size_t>(kind)] = answer.steps;
    progress.advance();
    if (kind == kFolds) {
      into.random = split;
      into.at_random = answer.predicted;
    } else if (kind > kFolds) {
      into.other = answer.predicted;
    } else {
      for (std::size_t i = 0; i < split.test.size(); ++i) {
        into.by_point.col(static_cast<Eigen::Index>(split.test[i])) =
            answer.predicted.col(static_cast<Eigen::Index>(i));
      }
    }
  });
  std::vector<RecordingScore> scores;
  for (std::size_t m = 0; m < methods.size(); ++m) {
    scores.push_back(score(methods[m].name, rows, static_cast<Eigen::Index>(count), predictions[m]));
  }
  return scores;
}

}  // namespace finsight::host
