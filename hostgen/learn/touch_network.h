// Trains one touch network and quantises it.
#pragma once

#include <functional>
#include <vector>

#include "hostgen/learn/corner_measurement.h"
#include "hostgen/learn/network.h"
#include "hostgen/learn/touch_samples.h"
#include "hostgen/learn/touch_training.h"

namespace finsight::host {

/// A float network with the normalisation of its inputs and outputs.
struct TouchNetwork {
  Network network;
  TouchModelData model;           ///< without the weights until quantise()
  Eigen::MatrixXf sample_inputs;  ///< [TouchModel::kInputs, samples] normalised, as in training: for quantise()
};

/// Trains on `touches`, each time with new pose noise of random size and sometimes with plates missing. Half of them
/// get the spec's noise, independently for each plate, the other half are measured by `camera`; without a camera all
/// get the spec's noise.
///
/// Loss: of the twelve means the squared error in the first fifth of the steps; then, for all of them but the
/// displacement, the Gaussian negative log-likelihood with the predicted standard deviation, weighted by that deviation
/// (beta-NLL with beta = 0.5, Seitzer et al. 2022), so that samples that say little about the touch neither dominate
/// nor vanish. Some touches are bent by gravity as well (add_gravity()). The displacement is weighted like the force.
/// Only touches on the face count. Added to it is the cross entropy of whether a touch of the scene moved the plates:
/// not those of other scenes, not swings of half a millimetre and more, not plates that came loose, which are added
/// here. `tick` is called after every step; it may throw to stop. Throws std::runtime_error if the training diverges.
TouchNetwork train_touch_network(const std::vector<TouchSample>& touches, const std::array<PoseNoise, kPlates>& noise,
                                 const PlatePrior& prior, const TouchTrainingPlan& plan, std::uint64_t seed,
                                 const std::function<void()>& tick, const CornerMeasurement* camera = nullptr);

/// What the network learns for one sample: its means, normalised; whether the scene explains the motion
/// and whether the means are known, each 0 or 1.
inline constexpr int kTouchTargets = TouchModel::kMeans + 2;

/// Derivative of that loss by the network's raw outputs, both [TouchModel::kOutputs, samples]; `targets` is
/// [kTouchTargets, samples]. `likelihood` selects the loss of the second part.
void touch_loss_gradient(const Eigen::MatrixXf& outputs, const Eigen::MatrixXf& targets, bool likelihood,
                         Eigen::MatrixXf& gradient);

/// Throws std::runtime_error if the network's raw outputs say that its training ended in nonsense. What it answers
/// where no means are learnt, such as for a plate that came loose, may be anything. Arrays as for the loss.
void check_converged(const Eigen::MatrixXf& outputs, const Eigen::MatrixXf& targets);

/// A layer as packs hold it.
LayerData float_layer(const Network::Layer& layer);

/// Rounds the weights of all layers but the first and the last to int8, with one scale per output channel (largest
/// weight = 127), into `trained.model`, changing the outputs for `trained.sample_inputs` as little as possible.
void quantise(TouchNetwork& trained);

/// The float network's numbers in physical units, for one pose, the noise of its plates (network_noise()) and what is
/// unknown of gravity.
Eigen::Matrix<float, TouchModel::kOutputs, 1> evaluate(TouchNetwork& trained, const PoseVector& numbers,
                                                       const std::array<float, kPlates>& noise, float unknown_g);

}  // namespace finsight::host
