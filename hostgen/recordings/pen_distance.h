// Distance between the pushed point of the reconstructed surface and the recorded position of the pen.
#pragma once

#include "firmware/model/model.h"
#include "firmware/ports/session.h"

namespace finsight::host {

struct PenDistance {
  double mean_mm = 0, error_95_mm = 0;  ///< of the reconstructed surface point
  double rest_mean_mm = 0;              ///< of the same point of the finger at rest, for comparison
  std::size_t rows = 0;
};

/// Solves the shape from the one recorded plate (the prior completes the others) for at most `max_rows` rows, spread
/// over the file, without outliers. The pushed point is the front-face node nearest to the pen's position when the
/// plate had moved least, shifted along the face to that position. Shows progress. Throws Interrupted.
PenDistance measure_pen_distance(const RecordedMotion& motion, const Model& model, std::size_t max_rows);

}  // namespace finsight::host
