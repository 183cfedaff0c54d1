#include "hostgen/learn/touch_comparison.h"

#include <Eigen/Cholesky>
#include <opencv2/ml.hpp>
#include <stdexcept>

#include "hostgen/learn/regression.h"
#include "hostgen/learn/split.h"
#include "hostgen/learn/touch_samples.h"
#include "hostgen/util/common.h"
#include "hostgen/util/stopwatch.h"

namespace finsight::host {

namespace {

constexpr int kFolds = 5;
constexpr std::size_t kMinStates = 50;

/// [18, samples] -> [3, samples]
using Predictor = std::function<Eigen::MatrixXf(const Eigen::MatrixXf&)>;

struct Normalisation {
  Eigen::VectorXf mean, scale;
  explicit Normalisation(const Eigen::MatrixXf& rows)
      : mean(rows.rowwise().mean()),
        scale((rows.colwise() - mean).array().square().rowwise().mean().sqrt().max(1e-6f).matrix()) {}
  Eigen::MatrixXf apply(const Eigen::MatrixXf& rows) const {
    return scale.cwiseInverse().asDiagonal() * (rows.colwise() - mean);
  }
  Eigen::MatrixXf undo(const Eigen::MatrixXf& rows) const { return (scale.asDiagonal() * rows).colwise() + mean; }
};

// A column in Eigen is a row in OpenCV.
cv::Mat view(const Eigen::MatrixXf& columns) {
  return {static_cast<int>(columns.cols()), static_cast<int>(columns.rows()), CV_32F,
          const_cast<float*>(columns.data())};
}

Predictor fit_linear(const Eigen::MatrixXf& x, const Eigen::MatrixXf& y) {
  Eigen::MatrixXd ones(x.rows() + 1, x.cols());
  ones << x.cast<double>(), Eigen::RowVectorXd::Ones(x.cols());
  const Eigen::MatrixXd normal = ones * ones.transpose();
  const Eigen::MatrixXf weights = normal.ldlt().solve(ones * y.cast<double>().transpose()).transpose().cast<float>();
  return [weights](const Eigen::MatrixXf& inputs) -> Eigen::MatrixXf {
    return (weights.leftCols(inputs.rows()) * inputs).colwise() + weights.col(inputs.rows());
  };
}

// One model per coordinate: OpenCV's models predict a single number.
template <class Make>
Predictor fit_opencv(const Eigen::MatrixXf& x, const Eigen::MatrixXf& y, Make make) {
  std::vector<cv::Ptr<cv::ml::StatModel>> models;
  for (Eigen::Index axis = 0; axis < y.rows(); ++axis) {
    const Eigen::VectorXf target = y.row(axis).transpose();
    const cv::Mat responses(static_cast<int>(target.size()), 1, CV_32F, const_cast<float*>(target.data()));
    models.push_back(make());
    models.back()->train(view(x), cv::ml::ROW_SAMPLE, responses);
  }
  return [models](const Eigen::MatrixXf& inputs) {
    Eigen::MatrixXf answer(static_cast<Eigen::Index>(models.size()), inputs.cols());
    for (std::size_t axis = 0; axis < models.size(); ++axis) {
      cv::Mat results;
      models[axis]->predict(view(inputs), results);
      for (Eigen::Index i = 0; i < inputs.cols(); ++i) {
        answer(static_cast<Eigen::Index>(axis), i) = results.at<float>(static_cast<int>(i));
      }
    }
    return answer;
  };
}

cv::Ptr<cv::ml::StatModel> make_svm() {
  const auto svm = cv::ml::SVM::create();
  svm->setType(cv::ml::SVM::EPS_SVR);
  svm->setKernel(cv::ml::SVM::RBF);
  svm->setGamma(1.0 / kPoseDims);
  svm->setC(10);
  svm->setP(0.02);
  svm->setTermCriteria({cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 100000, 1e-4});
  return svm;
}

cv::Ptr<cv::ml::StatModel> make_neighbours() {
  const auto neighbours = cv::ml::KNearest::create();
  neighbours->setDefaultK(5);
  neighbours->setIsClassifier(false);
  return neighbours;
}

cv::Ptr<cv::ml::StatModel> make_tree() {
  const auto tree = cv::ml::DTrees::create();
  tree->setMaxDepth(24);
  tree->setMinSampleCount(2);
  tree->setRegressionAccuracy(1e-4f);
  tree->setCVFolds(0);  // no pruning
  tree->setUseSurrogates(false);
  return tree;
}

Predictor fit_network(const Eigen::MatrixXf& x, const Eigen::MatrixXf& y, const ComparisonPlan& plan) {
  const auto network = std::make_shared<Regression>(x, y, RegressionPlan{.steps = plan.steps, .seed = plan.seed}, [] {
    if (interrupted()) throw Interrupted();
  });
  return [network](const Eigen::MatrixXf& inputs) { return network->predict(inputs); };
}

Predictor fit(const std::string& name, const Eigen::MatrixXf& x, const Eigen::MatrixXf& y, const ComparisonPlan& plan) {
  if (name == "lr") return fit_linear(x, y);
  if (name == "svm") return fit_opencv(x, y, make_svm);
  if (name == "knn") return fit_opencv(x, y, make_neighbours);
  if (name == "dt") return fit_opencv(x, y, make_tree);
  return fit_network(x, y, plan);
}

struct States {
  Eigen::MatrixXf clean, noisy, point_mm;  // a column each
  std::vector<int> path;
};

States states_of(const FingerSpec& spec, const FemDataset& dataset, std::uint64_t seed) {
  std::vector<const FemState*> valid;
  for (const FemState& state : dataset.states) {
    if (state.valid() && state.force_n > 0) valid.push_back(&state);
  }
  if (valid.size() < kMinStates)
    throw std::runtime_error("training set: fewer than 50 valid states; nothing to compare on");
  const auto count = static_cast<Eigen::Index>(valid.size());
  States states{Eigen::MatrixXf(kPoseDims, count), Eigen::MatrixXf(kPoseDims, count), Eigen::MatrixXf(3, count), {}};
  Random random(seed);
  for (Eigen::Index i = 0; i < count; ++i) {
    const FemState& state = *valid[static_cast<std::size_t>(i)];
    PoseVector numbers = touch_sample(state).numbers;
    states.clean.col(i) = numbers;
    add_noise(spec.noise, random, numbers);
    states.noisy.col(i) = numbers;
    states.point_mm.col(i) = state.point_mm;
    states.path.push_back(state.path);
  }
  return states;
}

Eigen::MatrixXf pick(const Eigen::MatrixXf& all, const std::vector<std::size_t>& columns) {
  Eigen::MatrixXf chosen(all.rows(), static_cast<Eigen::Index>(columns.size()));
  for (std::size_t i = 0; i < columns.size(); ++i) {
    chosen.col(static_cast<Eigen::Index>(i)) = all.col(static_cast<Eigen::Index>(columns[i]));
  }
  return chosen;
}

struct Trial {
  AxisErrors clean, noisy;
  double train_s = 0, predict_us = 0;
};

Trial try_method(const std::string& name, const States& states, const Split& split, const ComparisonPlan& plan) {
  const Eigen::MatrixXf train = pick(states.clean, split.train), truth = pick(states.point_mm, split.test);
  const Normalisation inputs(train), outputs(pick(states.point_mm, split.train));
  Trial trial;
  Stopwatch watch;
  const Predictor predictor = fit(name, inputs.apply(train), outputs.apply(pick(states.point_mm, split.train)), plan);
  trial.train_s = watch.lap_s();
  const auto errors = [&](const Eigen::MatrixXf& numbers) {
    const Eigen::MatrixXf answer = outputs.undo(predictor(inputs.apply(pick(numbers, split.test))));
    return axis_errors(truth.cast<double>(), (answer - truth).cast<double>());
  };
  watch.lap_s();
  trial.clean = errors(states.clean);
  trial.predict_us = watch.lap_us() / static_cast<double>(split.test.size());
  trial.noisy = errors(states.noisy);
  return trial;
}

}  // namespace

std::vector<MethodScore> compare_methods(const FingerSpec& spec, const FemDataset& dataset,
                                         const ComparisonPlan& plan) {
  const States states = states_of(spec, dataset, plan.seed);
  const std::array<Split, 2> splits = {random_split(states.path.size(), plan.seed),
                                       group_split(states.path, kFolds, 0, plan.seed)};
  std::vector<MethodScore> scores;
  Progress progress("methods of table 2", 10);
  // Sequentially, because their times are compared.
  for (const char* name : {"lr", "svm", "knn", "dt", "mlp"}) {
    std::array<Trial, 2> trials;
    for (std::size_t s = 0; s < splits.size(); ++s) {
      if (interrupted()) throw Interrupted();
      trials[s] = try_method(name, states, splits[s], plan);
      progress.advance();
    }
    scores.push_back({name, trials[0].clean, trials[0].noisy, trials[1].clean, trials[1].noisy, trials[0].train_s,
                      trials[0].predict_us});
  }
  return scores;
}

}  // namespace finsight::host
