#include "physics/convex_pieces.h"

#include <algorithm>

#include <Eigen/Eigenvalues>
#include <HACD/hacdHACD.h>

namespace handhold {
namespace {

// In HACD's units: the mesh scaled to a size of 1000.
constexpr double kConcavity = 20, kConnectDistance = 30;
constexpr std::size_t kCornersPerPiece = 64;
constexpr double kFlat = 1e-4;  // m: MuJoCo refuses pieces without a volume

/// Is the piece thicker than kFlat in every direction of its own axes?
bool isSolid(const ConvexPiece& piece) {
  if (piece.size() < 4) return false;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : piece) mean += p / static_cast<double>(piece.size());
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& p : piece) spread += (p - mean) * (p - mean).transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(spread);
  const Eigen::Vector3d thin = axes.eigenvectors().col(0);
  double low = 0, high = 0;
  for (const Eigen::Vector3d& p : piece) {
    low = std::min(low, thin.dot(p - mean));
    high = std::max(high, thin.dot(p - mean));
  }
  return high - low > kFlat;
}

}  // namespace

std::vector<ConvexPiece> convexPieces(const TriangleMesh& mesh) {
  std::vector<HACD::Vec3<HACD::Real>> points;
  std::vector<HACD::Vec3<long>> triangles;
  for (const Eigen::Vector3d& v : mesh.vertices) points.emplace_back(v.x(), v.y(), v.z());
  for (const auto& t : mesh.triangles) triangles.emplace_back(t[0], t[1], t[2]);
  HACD::HACD hacd;
  hacd.SetPoints(points.data());
  hacd.SetNPoints(points.size());
  hacd.SetTriangles(triangles.data());
  hacd.SetNTriangles(triangles.size());
  hacd.SetCompacityWeight(0.0001);
  hacd.SetVolumeWeight(0);
  hacd.SetConnectDist(kConnectDistance);
  hacd.SetNClusters(2);
  hacd.SetNVerticesPerCH(kCornersPerPiece);
  hacd.SetConcavity(kConcavity);
  hacd.SetAddExtraDistPoints(true);
  hacd.SetAddNeighboursDistPoints(true);
  hacd.SetAddFacesPoints(true);
  hacd.Compute();
  std::vector<ConvexPiece> pieces;
  for (std::size_t i = 0; i < hacd.GetNClusters(); ++i) {
    std::vector<HACD::Vec3<HACD::Real>> corners(hacd.GetNPointsCH(i));
    std::vector<HACD::Vec3<long>> faces(hacd.GetNTrianglesCH(i));
    hacd.GetCH(i, corners.data(), faces.data());
    ConvexPiece piece;
    for (const auto& p : corners) piece.emplace_back(p.X(), p.Y(), p.Z());
    if (isSolid(piece)) pieces.push_back(std::move(piece));
  }
  return pieces;
}

std::vector<ConvexPiece> connectedHulls(const TriangleMesh& mesh) {
  std::vector<ConvexPiece> result;
  for (TriangleMesh& piece : splitPieces(mesh)) {
    if (isSolid(piece.vertices)) result.push_back(std::move(piece.vertices));
  }
  return result;
}

}  // namespace handhold
