// How much arithmetic the derivatives of one tetrahedron are, counted while it is done.
#pragma once

namespace finsight::host {

struct ArithmeticCount {
  long multiplications = 0, additions = 0, divisions = 0, roots = 0;
  /// What a core that multiplies and adds in one operation needs at least, divisions and roots counted as one each.
  double least_operations() const {
    return static_cast<double>((multiplications > additions ? multiplications : additions) + divisions + roots);
  }
};

/// Of gradient and Hessian of one tetrahedron, from its deformation gradient on.
ArithmeticCount derivative_operations();

}  // namespace finsight::host
