#include "firmware/shape/shape_state.h"

#include <string>
#include <utility>

#include "firmware/input_error.h"

namespace finsight {

namespace {

// Elastic energy, as a part of the energy at rest, of strains of 40 % all over. (Bent by 40 mm and twisted by 90
// degrees the finger has 0.02.)
constexpr double kMaxStrainEnergy = 0.1;

}  // namespace

template <class S>
ShapeState<S>::ShapeState(const ShapeModel& model, const MountModel& mount, const Cholesky<S>* cholesky)
    : elements_(model, cholesky), rigid_plates_(model, mount) {
  for (const float coordinate : model.rest_mm) rest_.push_back(coordinate);
  free_offsets_.resize(model.cholesky.blocks);
  int free_nodes = 0;
  for (int i = 0; i < model.nodes; ++i) {
    if (model.free_index[i] >= 0) ++free_nodes;
  }
  if (free_nodes != model.cholesky.blocks) {
    throw InputError("shape model", "cholesky", std::to_string(model.cholesky.blocks) + " blocks",
                     std::to_string(free_nodes) + ", one for every free node");
  }
  for (int i = 0; i < model.nodes; ++i) {
    if (model.free_index[i] >= 0) free_offsets_.at(model.free_index[i]) = 3 * i;
  }
  for (std::vector<S>* array : {&x_, &trial_, &step_}) array->resize(rest_.size());
  start_at_rest();
  rest_energy_ = energy();
}

template <class S>
void ShapeState<S>::start_at_rest() {
  x_ = rest_;
  plates_ = {};
}

// Of a given shape only the free nodes count: the base is at rest, and the plates are where their poses put them.
template <class S>
void ShapeState<S>::assemble_trial(std::span<const float> node_mm, const PlateMotions& plates) {
  trial_ = rest_;
  for (const std::int32_t offset : free_offsets_) {
    for (int d = 0; d < 3; ++d) trial_[offset + d] = node_mm[offset + d];
  }
  rigid_plates_.place<S>(plates, trial_);
}

template <class S>
bool ShapeState<S>::start_from(std::span<const float> node_mm, const PlateMotions& plates) {
  assemble_trial(node_mm, plates);
  if (!(elements_.smallest_determinant(trial_) > 0)) return false;
  std::swap(x_, trial_);
  plates_ = plates;
  return true;
}

template <class S>
void ShapeState<S>::start_towards(std::span<const float> node_mm, const PlateMotions& plates) {
  start_at_rest();
  assemble_trial(node_mm, plates);
  for (std::size_t i = 0; i < x_.size(); ++i) step_[i] = trial_[i] - x_[i];
  const S part = elements_.longest_step(x_, step_);
  if (!(part > 0)) return;  // something is not finite
  for (std::size_t i = 0; i < x_.size(); ++i) x_[i] += part * step_[i];
  plates_ = between(plates_, plates, static_cast<double>(part));
}

template <class S>
bool ShapeState<S>::is_overstrained() const {
  return energy() - rest_energy_ > kMaxStrainEnergy * rest_energy_;
}

template class ShapeState<float>;
template class ShapeState<double>;

}  // namespace finsight
