#pragma once

#include <cstdint>

#include <Eigen/Core>

namespace handhold {

/// A point where a link of the hand touches the object, in the object frame O.
struct Contact {
  Eigen::Vector3d position;  // p_OC [m], on the object's surface
  Eigen::Vector3d normal;    // n_OC, unit, into the object
  std::uint16_t link = 0;    // index into Hand::links
};

}  // namespace handhold
