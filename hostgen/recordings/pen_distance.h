// The shape against the pen: how far the pushed point of the reconstructed surface is from where the recording has it.
#pragma once

#include "firmware/model/model.h"
#include "firmware/ports/session.h"

namespace finsight::host {

struct PenDistance {
  double mean_mm = 0, error_95_mm = 0;  ///< of the reconstructed surface point
  double rest_mean_mm = 0;              ///< of the same point if the finger did not move: what the shape explains
  std::size_t rows = 0;
};

/// Solves the shape from the one recorded plate (the prior completes the others) for at most `most_rows` rows, spread
/// over the file, outliers left out. The pushed point is the front-face node nearest to where the pen was when the
/// plate had moved least, moved sideways onto that place. With progress. Throws Interrupted.
PenDistance measure_pen_distance(const RecordedMotion& motion, const Model& model, std::size_t most_rows);

}  // namespace finsight::host
