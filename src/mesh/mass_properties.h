#pragma once

#include "mesh/triangle_mesh.h"

#include <Eigen/Core>

namespace handhold {

/// Of the enclosed solid at density 1 when the mesh is watertight, else of its surface at area density 1.
struct MassProperties {
  double volume = 0;                                       // m^3; 0 for an open mesh
  double area = 0;                                         // m^2
  Eigen::Vector3d centerOfMass = Eigen::Vector3d::Zero();  // m, in the mesh frame
  Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();       // about the centre of mass, per unit of density
  double radius = 0;                                       // m, largest distance of the surface from the centre of mass
};

/// Exact polynomial integrals over tetrahedra (origin, triangle), derived in README.md; for open meshes over triangles.
MassProperties massProperties(const TriangleMesh& mesh, bool watertight);

}  // namespace handhold
