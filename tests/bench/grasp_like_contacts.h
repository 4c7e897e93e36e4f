#pragma once

#include "support/random_contacts.h"

#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

namespace handhold::bench {

/// A hand about a bottle, lying in metres: three fingers and a palm, each with a patch of contacts whose normals differ
/// little, as the contacts of one link do.
inline std::vector<Contact> graspLikeContacts(std::uint64_t seed, int nContacts) {
  constexpr double kAzimuthDegrees[] = {90, 235, 305, 270};  // thumb, two fingers, palm
  constexpr double kRadius = 0.035;
  const RandomStream stream = RandomStream(seed).child(static_cast<std::uint64_t>(nContacts));
  std::vector<Contact> contacts;
  for (int i = 0; i < nContacts; ++i) {
    const int link = i % 4;
    const std::uint64_t ofLink = 2 * static_cast<std::uint64_t>(link);
    const std::uint64_t own = 8 + 4 * static_cast<std::uint64_t>(i);
    const double degrees = kAzimuthDegrees[link] + 40 * (stream.uniform(ofLink) - 0.5) + 15 * stream.uniform(own);
    const double height = 0.06 * (stream.uniform(ofLink + 1) - 0.5) + 0.02 * (stream.uniform(own + 1) - 0.5);
    const double angle = degrees * std::numbers::pi / 180;
    const Eigen::Vector3d outward(std::cos(angle), std::sin(angle), 0);
    const Eigen::Vector3d inward = -outward + 0.1 * testing::randomUnitVector(stream, own + 2);
    contacts.push_back({kRadius * outward + height * Eigen::Vector3d::UnitZ(), inward.normalized(), 0});
  }
  return contacts;
}

}  // namespace handhold::bench
