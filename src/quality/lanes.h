#pragma once

#include <array>
#include <cstring>

// Eight numbers at once, in vectors of W = 2 or 4 doubles; no other library includes it. Every operation is one IEEE
// operation a lane, and folds over lanes have one order, so that all widths give equal bits.
namespace handhold::lanes {

/// Force the callee into its caller: a template on W must become part of the function that names the instruction set.
#define HANDHOLD_INLINE [[gnu::always_inline]] inline

template <int W>
struct Vector {
  typedef double Part __attribute__((vector_size(8 * W)));
  typedef long long PartMask __attribute__((vector_size(8 * W)));
};

template <int W>
struct Mask {
  std::array<typename Vector<W>::PartMask, 8 / W> part;
};

template <int W>
struct Lanes {
  std::array<typename Vector<W>::Part, 8 / W> part;

  HANDHOLD_INLINE static Lanes load(const double* from) {
    Lanes a;
    for (int i = 0; i < 8 / W; ++i) std::memcpy(&a.part[i], from + W * i, sizeof(a.part[i]));  // whole vectors
    return a;
  }
  HANDHOLD_INLINE static Lanes all(double value) {
    Lanes a;
    for (auto& part : a.part) part = value - typename Vector<W>::Part{};
    return a;
  }
  HANDHOLD_INLINE void store(double* to) const {
    for (int i = 0; i < 8 / W; ++i) std::memcpy(to + W * i, &part[i], sizeof(part[i]));
  }
};

template <int W>
HANDHOLD_INLINE Lanes<W> operator+(const Lanes<W>& a, const Lanes<W>& b) {
  Lanes<W> c;
  for (int i = 0; i < 8 / W; ++i) c.part[i] = a.part[i] + b.part[i];
  return c;
}
template <int W>
HANDHOLD_INLINE Lanes<W> operator-(const Lanes<W>& a, const Lanes<W>& b) {
  Lanes<W> c;
  for (int i = 0; i < 8 / W; ++i) c.part[i] = a.part[i] - b.part[i];
  return c;
}
template <int W>
HANDHOLD_INLINE Lanes<W> operator*(const Lanes<W>& a, const Lanes<W>& b) {
  Lanes<W> c;
  for (int i = 0; i < 8 / W; ++i) c.part[i] = a.part[i] * b.part[i];
  return c;
}
template <int W>
HANDHOLD_INLINE Lanes<W> operator*(const Lanes<W>& a, double b) {
  Lanes<W> c;
  for (int i = 0; i < 8 / W; ++i) c.part[i] = a.part[i] * b;
  return c;
}
template <int W>
HANDHOLD_INLINE Lanes<W> operator/(const Lanes<W>& a, const Lanes<W>& b) {
  Lanes<W> c;
  for (int i = 0; i < 8 / W; ++i) c.part[i] = a.part[i] / b.part[i];
  return c;
}
template <int W>
HANDHOLD_INLINE Mask<W> operator>(const Lanes<W>& a, const Lanes<W>& b) {
  Mask<W> c;
  for (int i = 0; i < 8 / W; ++i) c.part[i] = a.part[i] > b.part[i];
  return c;
}
template <int W>
HANDHOLD_INLINE Mask<W> operator<=(const Lanes<W>& a, const Lanes<W>& b) {
  Mask<W> c;
  for (int i = 0; i < 8 / W; ++i) c.part[i] = a.part[i] <= b.part[i];
  return c;
}
template <int W>
HANDHOLD_INLINE Mask<W> operator==(const Lanes<W>& a, const Lanes<W>& b) {
  Mask<W> c;
  for (int i = 0; i < 8 / W; ++i) c.part[i] = a.part[i] == b.part[i];
  return c;
}

/// Lane by lane: yes where the mask holds, else no.
template <int W>
HANDHOLD_INLINE Lanes<W> select(const Mask<W>& mask, const Lanes<W>& yes, const Lanes<W>& no) {
  Lanes<W> c;
  for (int i = 0; i < 8 / W; ++i) c.part[i] = mask.part[i] ? yes.part[i] : no.part[i];
  return c;
}

/// Lane by lane; b where a is not a number.
template <int W>
HANDHOLD_INLINE Lanes<W> larger(const Lanes<W>& a, const Lanes<W>& b) {
  return select(a > b, a, b);
}

/// (d_0 a_0 + d_1 a_1) + (d_2 a_2 + d_3 a_3) + (d_4 a_4 + d_5 a_5), a sum of vectors a_k weighed by d.
template <int W>
HANDHOLD_INLINE Lanes<W> mixture(const std::array<Lanes<W>, 6>& a, const double* d) {
  return ((a[0] * d[0] + a[1] * d[1]) + (a[2] * d[2] + a[3] * d[3])) + (a[4] * d[4] + a[5] * d[5]);
}

namespace fold {
struct Add {
  template <class T>
  HANDHOLD_INLINE static void into(T& a, const T& b) {
    a += b;
  }
};
struct Largest {
  template <class T>
  HANDHOLD_INLINE static void into(T& a, const T& b) {
    a = a > b ? a : b;
  }
};
struct Least {
  template <class T>
  HANDHOLD_INLINE static void into(T& a, const T& b) {
    a = a < b ? a : b;
  }
};
}  // namespace fold

/// Lanes i and i + 4, then i and i + 2, then i and i + 1.
template <class Fold, int W>
HANDHOLD_INLINE double folded(const Lanes<W>& a) {
  auto part = a.part;
  for (int half = 4 / W; half > 0; half /= 2) {
    for (int i = 0; i < half; ++i) Fold::into(part[i], part[i + half]);
  }
  typename Vector<2>::Part two;
  if constexpr (W == 4) {
    two = __builtin_shufflevector(part[0], part[0], 0, 1);
    Fold::into(two, __builtin_shufflevector(part[0], part[0], 2, 3));
  } else {
    two = part[0];
  }
  double one = two[0];
  Fold::into(one, double{two[1]});
  return one;
}

template <int W>
HANDHOLD_INLINE double sum(const Lanes<W>& a) {
  return folded<fold::Add>(a);
}
template <int W>
HANDHOLD_INLINE double largest(const Lanes<W>& a) {
  return folded<fold::Largest>(a);
}
template <int W>
HANDHOLD_INLINE double least(const Lanes<W>& a) {
  return folded<fold::Least>(a);
}

/// A bit for each lane where the mask holds.
template <int W>
HANDHOLD_INLINE unsigned bitsOf(const Mask<W>& mask) {
  constexpr std::array<double, 8> kBits = {1, 2, 4, 8, 16, 32, 64, 128};
  return static_cast<unsigned>(sum(select(mask, Lanes<W>::load(kBits.data()), Lanes<W>::all(0))));
}

}  // namespace handhold::lanes
