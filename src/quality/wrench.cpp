#include "quality/force_closure.h"

#include <cassert>
#include <cmath>
#include <numbers>

#include <Eigen/Geometry>

namespace handhold {
namespace {

struct TangentBasis {
  Eigen::Vector3d t;
  Eigen::Vector3d b;
};

/// Two tangents from the unit normal alone, t x b = n. Continuous but on the plane n_z = 0, where the sign flips; the
/// denominator is never below 1.
TangentBasis tangentBasis(const Eigen::Vector3d& n) {
  const double sign = std::copysign(1.0, n.z());
  const double a = -1 / (sign + n.z());
  const double b = n.x() * n.y() * a;
  return {{1 + sign * n.x() * n.x() * a, sign * b, -sign * n.x()}, {b, sign + n.y() * n.y() * a, -n.y()}};
}

}  // namespace

FrictionCones::FrictionCones(const WrenchModel& model) : model_(model) {
  assert(model.coneEdges >= 3 && model.torqueScale > 0 && model.friction >= 0);
  for (int j = 0; j < model.coneEdges; ++j) {
    const double angle = 2 * std::numbers::pi * j / model.coneEdges;
    edges_.emplace_back(model.friction * std::cos(angle), model.friction * std::sin(angle));
  }
}

Eigen::Map<const WrenchMatrix> FrictionCones::wrenches(std::span<const Contact> contacts) {
  const std::size_t nWrenches = contacts.size() * edges_.size();
  if (columns_.size() < 6 * nWrenches) columns_.resize(6 * nWrenches);
  double* column = columns_.data();
  for (const Contact& contact : contacts) {
    const TangentBasis tangents = tangentBasis(contact.normal);
    const Eigen::Vector3d arm = (contact.position - model_.centerOfMass) / model_.torqueScale;
    for (const Eigen::Vector2d& edge : edges_) {
      const Eigen::Vector3d f = contact.normal + edge.x() * tangents.t + edge.y() * tangents.b;
      Eigen::Map<Eigen::Matrix<double, 6, 1>>(column) << f, arm.cross(f);
      column += 6;
    }
  }
  return {columns_.data(), 6, static_cast<int>(nWrenches)};
}

WrenchMatrix frictionConeWrenches(std::span<const Contact> contacts, const WrenchModel& model) {
  return FrictionCones(model).wrenches(contacts);
}

}  // namespace handhold
