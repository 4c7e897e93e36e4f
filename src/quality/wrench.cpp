#include "quality/force_closure.h"
#include "quality/tangent_basis.h"

#include <cassert>
#include <cmath>
#include <numbers>

#include <Eigen/Geometry>

namespace handhold {
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
