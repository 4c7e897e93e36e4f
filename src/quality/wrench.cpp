#include "quality/force_closure.h"
#include "quality/tangent_basis.h"

#include <cassert>
#include <cmath>
#include <numbers>

#include <Eigen/Geometry>

namespace handhold {
FrictionCones::FrictionCones(const WrenchModel& model) : model_(model) {
  assert(model.coneEdges >= 3 && model.torqueScale > 0 && model.friction >= 0 && model.torsionRadius >= 0);
  const auto addParallel = [&](double radius, double z, double shift) {
    for (int j = 0; j < model.coneEdges; ++j) {
      const double angle = 2 * std::numbers::pi * (j + shift) / model.coneEdges;
      generators_.emplace_back(radius * std::cos(angle), radius * std::sin(angle), z);
    }
  };
  addParallel(model.friction, 0, 0);
  if (model.torsionRadius == 0) return;
  for (const double side : {model.friction, -model.friction}) {
    addParallel(model.friction * std::sqrt(0.5), side * std::sqrt(0.5), 0.5);
    generators_.emplace_back(0, 0, side);
  }
}

Eigen::Map<const WrenchMatrix> FrictionCones::wrenches(std::span<const Contact> contacts) {
  const std::size_t nWrenches = contacts.size() * generators_.size();
  if (columns_.size() < 6 * nWrenches) columns_.resize(6 * nWrenches);
  const double torsion = model_.torsionRadius / model_.torqueScale;
  double* column = columns_.data();
  for (const Contact& contact : contacts) {
    const TangentBasis tangents = tangentBasis(contact.normal);
    const Eigen::Vector3d arm = (contact.position - model_.centerOfMass) / model_.torqueScale;
    for (const Eigen::Vector3d& generator : generators_) {
      const Eigen::Vector3d f = contact.normal + generator.x() * tangents.t + generator.y() * tangents.b;
      Eigen::Vector3d torque = arm.cross(f);
      if (generator.z() != 0) torque += generator.z() * torsion * contact.normal;
      Eigen::Map<Eigen::Matrix<double, 6, 1>>(column) << f, torque;
      column += 6;
    }
  }
  return {columns_.data(), 6, static_cast<int>(nWrenches)};
}

WrenchMatrix frictionConeWrenches(std::span<const Contact> contacts, const WrenchModel& model) {
  return FrictionCones(model).wrenches(contacts);
}

}  // namespace handhold
