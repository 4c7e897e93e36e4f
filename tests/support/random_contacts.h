#pragma once

#include "core/random.h"
#include "quality/contact.h"

#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace handhold::testing {

/// Uniform on the unit sphere; uses positions `counter` and `counter + 1` of the stream.
inline Eigen::Vector3d randomUnitVector(const RandomStream& stream, std::uint64_t counter) {
  const double z = 2 * stream.uniform(counter) - 1;
  const double angle = 2 * std::numbers::pi * stream.uniform(counter + 1);
  const double radius = std::sqrt(1 - z * z);
  return {radius * std::cos(angle), radius * std::sin(angle), z};
}

/// Contacts on the unit sphere; normals point in and lean from the radius by up to about `lean` (0: a sphere).
inline std::vector<Contact> randomContacts(std::uint64_t seed, int nContacts, double lean = 0) {
  const RandomStream stream = RandomStream(seed).child(static_cast<std::uint64_t>(nContacts));
  std::vector<Contact> contacts;
  for (int i = 0; i < nContacts; ++i) {
    const std::uint64_t counter = 4 * static_cast<std::uint64_t>(i);
    const Eigen::Vector3d p = randomUnitVector(stream, counter);
    const Eigen::Vector3d inward = -p + lean * randomUnitVector(stream, counter + 2);
    contacts.push_back({p, inward.normalized(), 0});
  }
  return contacts;
}

}  // namespace handhold::testing
