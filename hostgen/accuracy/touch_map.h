// The touch error over the face and by how sure the firmware says it is.
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "firmware/model/model.h"
#include "hostgen/fem/dataset.h"
#include "hostgen/finger/spec.h"

namespace finsight::host {

/// Every valid state `draws` times with the spec's noise through the firmware's touch stage.
/// `face`: per contact point x_mm, y_mm, touches, published (a share), mean_mm, error_95_mm. `reliability`: per band of
/// plate motion from_mm, touches and `inside`, the shares of errors inside 0.1, 0.2 ... 3 published radii.
nlohmann::json map_touches(const Model& model, const FingerSpec& spec, const FemDataset& unseen, int draws);

}  // namespace finsight::host
