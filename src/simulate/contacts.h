#pragma once

#include "mesh/triangle_mesh.h"
#include "quality/contact.h"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Two triangles, one of the object and one of the link, in the object frame.
using Corners = std::array<Eigen::Vector3d, 3>;

/// A pair of surface points at most `contactDistance` apart whose surfaces face each other.
struct ContactCandidate {
  Eigen::Vector3d position;  // on the object
  Eigen::Vector3d normal;    // outward, of the object's triangle
  double gap = 0;            // m, to the link
  double facing = 0;         // outward normals' dot product, < 0
};

/// A triangle with its unit normal by the right-hand rule.
struct ContactTriangle {
  Corners corners;
  Eigen::Vector3d normal;
};
ContactTriangle contactTriangle(const Corners& corners);

/// Adds the pairs at which the distance between two triangles takes its extremes: each vertex of one against the other,
/// and each pair of edges. They hold the closest pair of any two triangles and, where faces lie flush, every corner of
/// the overlap. `twoSided`: the object is an open surface, its normal is turned against the link's.
void addContactCandidates(const ContactTriangle& object, const ContactTriangle& link, double contactDistance,
                          bool twoSided, std::vector<ContactCandidate>& candidates);

/// The pairs of features of two triangles, a bit each: corner i of the object's against the link's triangle is bit i,
/// corner j of the link's against the object's triangle 3 + j, edge i of the object's against edge j of the link's
/// 6 + 3 i + j. Edge i runs from corner i to the next.
using FeaturePairs = std::uint32_t;

/// The same where all pairs of features within the contact distance are known to be among `close`.
void addContactCandidates(const ContactTriangle& object, const ContactTriangle& link, FeaturePairs close,
                          double contactDistance, bool twoSided, std::vector<ContactCandidate>& candidates);

/// What selectContacts works in. It keeps its memory, so that no call allocates once it has seen a set of this size.
struct ContactScratch {
  /// Candidates whose rounded positions are equal are one place.
  struct Place {
    std::array<std::int64_t, 3> cell;
    ContactCandidate best;
    double distance;  // m, from the contacts taken so far
  };
  std::vector<Place> places;
  std::vector<std::uint32_t> slots;  // hash table of the cells: index into `places` plus one, 0 is free
};

/// The patch rule. Of candidates at one place (0.1 um) the one whose normal opposes the link's most stays; then the one
/// with the smallest gap is taken, and again and again the one farthest from those taken, until `maximum` or until none
/// is `spacing` [m] away from all of them. The order of the candidates changes nothing.
void selectContacts(std::span<const ContactCandidate> candidates, int maximum, double spacing, std::uint16_t link,
                    ContactScratch& scratch, std::vector<Contact>& contacts);

/// Closest point of a triangle to `p`. Source: C. Ericson, "Real-Time Collision Detection", 2005, section 5.1.5
/// (Voronoi regions by barycentric signs).
Eigen::Vector3d closestPointOnTriangle(const Eigen::Vector3d& p, const Corners& triangle);

}  // namespace handhold
