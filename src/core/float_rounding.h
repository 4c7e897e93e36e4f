#pragma once

namespace handhold {

/// The nearest 32-bit float, as a double; -0 becomes +0.
/// The volatile is needed: at -O3 gcc 12 vectorises pairs of (double)(float) round trips and drops the rounding of some
/// (seen in the disassembly; tests/core holds it).
inline double roundedToFloat(double x) {
  volatile const float rounded = static_cast<float>(x);
  return static_cast<double>(rounded) + 0.0;
}

}  // namespace handhold
