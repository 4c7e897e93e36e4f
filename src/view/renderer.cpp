#include "view/renderer.h"

#include "core/random.h"
#include "mesh/ray_scene.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cassert>
#include <cmath>
#include <limits>
#include <numbers>
#include <thread>

namespace handhold {
namespace {

using Eigen::Vector3d;

constexpr double kFieldOfView = 0.50;    // rad, of the longer side: little perspective
constexpr double kMargin = 1.10;         // the frame is this much larger than the scene
constexpr double kCreaseCosine = 0.77;   // faces that meet at less than 40 degrees are shaded as one smooth surface
constexpr double kMarkVisibility = 0.6;  // of a mark behind something
constexpr double kAmbientReach = 0.6;    // ambient rays see this far, in scene radii
constexpr double kSamePlane = 2e-4;      // scene radii: surfaces so near each other are seen as one
const Vector3d kBackground(0.955, 0.96, 0.97);
const Vector3d kKeyLight(0.78, 0.76, 0.72);
const Vector3d kSky(0.50, 0.52, 0.56);
const Vector3d kFloorLight(0.34, 0.33, 0.32);  // ambient light from below

/// The surface as rays and shading see it: all parts in W, with a colour a triangle and a normal a corner.
struct Surface {
  TriangleMesh mesh;
  std::vector<Vector3d> colour;                       // (triangles)
  std::vector<std::array<Vector3d, 3>> cornerNormal;  // (triangles), in W
};

/// Area-weighted mean of the normals around each corner, over the faces that are nearly level with its own.
std::vector<std::array<Vector3d, 3>> cornerNormals(const TriangleMesh& mesh) {
  std::vector<Vector3d> areaNormal(mesh.triangles.size());
  std::vector<std::vector<std::uint32_t>> around(mesh.vertices.size());
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto [a, b, c] = mesh.corners(t);
    areaNormal[t] = (b - a).cross(c - a);
    for (const std::uint32_t v : mesh.triangles[t]) around[v].push_back(static_cast<std::uint32_t>(t));
  }
  std::vector<std::array<Vector3d, 3>> result(mesh.triangles.size());
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Vector3d own = areaNormal[t].normalized();
    for (int corner = 0; corner < 3; ++corner) {
      Vector3d sum = Vector3d::Zero();
      for (const std::uint32_t other : around[mesh.triangles[t][corner]]) {
        if (own.dot(areaNormal[other].normalized()) >= kCreaseCosine) sum += areaNormal[other];
      }
      result[t][corner] = sum.squaredNorm() > 0 ? sum.normalized() : own;
    }
  }
  return result;
}

Surface mergeParts(const std::vector<ScenePart>& parts, bool marks) {
  Surface surface;
  for (const ScenePart& part : parts) {
    if (part.isMark != marks) continue;
    append(surface.mesh, part.mesh, part.X_W);
    surface.colour.insert(surface.colour.end(), part.mesh.triangles.size(), part.colour);
    for (auto normals : cornerNormals(part.mesh)) {
      for (Vector3d& normal : normals) normal = part.X_W.linear() * normal;
      surface.cornerNormal.push_back(normals);
    }
  }
  return surface;
}

/// Barycentric interpolation of the corner normals at a point of the triangle.
Vector3d smoothNormal(const Surface& surface, std::uint32_t triangle, const Vector3d& point) {
  const auto [a, b, c] = surface.mesh.corners(triangle);
  const Vector3d n = (b - a).cross(c - a);
  const double area = n.squaredNorm();
  if (!(area > 0)) return surface.cornerNormal[triangle][0];
  const double wb = (point - a).cross(c - a).dot(n) / area, wc = (b - a).cross(point - a).dot(n) / area;
  const auto& normals = surface.cornerNormal[triangle];
  return ((1 - wb - wc) * normals[0] + wb * normals[1] + wc * normals[2]).normalized();
}

/// Any right-handed frame with the given z axis.
Eigen::Matrix3d frameAlong(const Vector3d& z) {
  Eigen::Matrix3d frame;
  frame.col(2) = z;
  frame.col(0) = z.unitOrthogonal();
  frame.col(1) = z.cross(frame.col(0));
  return frame;
}

double fraction(double x) { return x - std::floor(x); }

// The inverse of the plastic number and its square: their multiples fill the unit square evenly.
constexpr double kA = 0.7548776662466927, kB = 0.5698402909980532;

/// Point `index` of the additive sequence in the unit square, moved by `shift` around the torus.
Eigen::Vector2d sequencePoint(int index, const Eigen::Vector2d& shift) {
  return {fraction(shift.x() + kA * index), fraction(shift.y() + kB * index)};
}

/// Where a pixel's sequence starts: without a pattern, for the eye finds patterns.
Eigen::Vector2d pixelShift(int column, int row) {
  const RandomStream stream = RandomStream(static_cast<std::uint64_t>(row)).child(static_cast<std::uint64_t>(column));
  return {stream.uniform(0), stream.uniform(1)};
}

/// Direction about +z with density cos / pi.
Vector3d cosineDirection(const Eigen::Vector2d& square) {
  const double radius = std::sqrt(square.x()), angle = 2 * std::numbers::pi * square.y();
  return {radius * std::cos(angle), radius * std::sin(angle), std::sqrt(std::max(0.0, 1 - square.x()))};
}

std::uint8_t toByte(double linear) {
  const double c = std::clamp(linear, 0.0, 1.0);
  const double encoded = c <= 0.0031308 ? 12.92 * c : 1.055 * std::pow(c, 1 / 2.4) - 0.055;
  return static_cast<std::uint8_t>(std::lround(255 * encoded));
}

/// Casts and shades; const after construction.
class Renderer {
 public:
  Renderer(const std::vector<ScenePart>& parts, const Camera& camera, const RenderSettings& settings)
      : camera_(camera),
        settings_(settings),
        solid_(mergeParts(parts, false)),
        marks_(mergeParts(parts, true)),
        solidRays_(solid_.mesh),
        markRays_(marks_.mesh) {
    const Eigen::AlignedBox3d box = boundingBox(parts);
    radius_ = box.isEmpty() ? 1 : box.diagonal().norm() / 2;
    floor_ = box.isEmpty() ? 0 : box.min().z() - 0.04 * radius_;
    const Eigen::Matrix3d& R_WC = camera.X_WC.linear();
    light_ = frameAlong((0.75 * R_WC.col(2) - 0.55 * R_WC.col(0) + 1.25 * Vector3d::UnitZ()).normalized());
  }

  void renderRow(int row, std::uint8_t* rgb) const {
    const int side = settings_.samplesPerSide;
    for (int column = 0; column < settings_.width; ++column) {
      const Eigen::Vector2d shift = pixelShift(column, row);
      Vector3d sum = Vector3d::Zero();
      for (int k = 0; k < side * side; ++k) {
        const int subColumn = k % side, subRow = k / side;
        const double u = (column + (subColumn + 0.5) / side) / settings_.width;
        const double v = (row + (subRow + 0.5) / side) / settings_.height;
        sum += colourAlong(camera_.ray(u, v), k, shift);
      }
      for (int i = 0; i < 3; ++i) *rgb++ = toByte(sum[i] / (side * side));
    }
  }

 private:
  Vector3d colourAlong(const Vector3d& direction, int sample, const Eigen::Vector2d& shift) const {
    const Vector3d eye = camera_.X_WC.translation();
    const RayHit hit = firstSurface(eye, direction);
    const RayHit mark = markRays_.cast(eye, direction);
    if (!mark.missed() && mark.distance <= hit.distance) return shadeMark(mark, direction);
    const Vector3d colour = hit.missed() ? background(direction, sample, shift) : shade(hit, direction, sample, shift);
    return mark.missed() ? colour : kMarkVisibility * shadeMark(mark, direction) + (1 - kMarkVisibility) * colour;
  }

  /// The first hit; of surfaces that lie in each other (faces of two links in one plane) always the earlier part's, or
  /// rounding would choose another one in every pixel.
  RayHit firstSurface(const Vector3d& eye, const Vector3d& direction) const {
    RayHit first = solidRays_.cast(eye, direction);
    if (first.missed()) return first;
    thread_local std::vector<RayCrossing> met;
    const double ahead = first.distance - 1e-3 * radius_;
    solidRays_.crossings(eye + ahead * direction, direction, met);
    for (const RayCrossing& crossing : met) {
      if (crossing.hit.distance + ahead > first.distance + kSamePlane * radius_) break;
      if (crossing.sign < 0) first.triangle = std::min(first.triangle, crossing.hit.triangle);
    }
    return first;
  }

  Vector3d shade(const RayHit& hit, const Vector3d& direction, int sample, const Eigen::Vector2d& shift) const {
    const Vector3d point = camera_.X_WC.translation() + hit.distance * direction;
    // Open surfaces and turned triangles are shaded from the side that the ray sees.
    Vector3d face = solid_.mesh.normal(hit.triangle), normal = smoothNormal(solid_, hit.triangle, point);
    if (face.dot(direction) > 0) face = -face, normal = -normal;
    const Vector3d start = point + 3 * kSamePlane * radius_ * face;
    const Vector3d& albedo = solid_.colour[hit.triangle];
    const Vector3d ambient = ambientLight(start, frameAlong(normal), face, sample, shift);
    const Vector3d& toLight = light_.col(2);
    const double facing = std::min(normal.dot(toLight), face.dot(toLight) > 0 ? 1.0 : 0.0);
    if (facing <= 0) return albedo.cwiseProduct(ambient);
    const double sheen = 0.10 * std::pow(std::max(0.0, normal.dot((toLight - direction).normalized())), 40);
    const double lit = litShare(start, sample, shift);
    return albedo.cwiseProduct(ambient) + lit * kKeyLight.cwiseProduct(albedo * facing + Vector3d::Constant(sheen));
  }

  /// The share of the key light, a disc of 8 degrees radius, that is seen from a point.
  double litShare(const Vector3d& point, int sample, const Eigen::Vector2d& shift) const {
    int seen = 0;
    for (int i = 0; i < settings_.lightRays; ++i) {
      const Eigen::Vector2d square = sequencePoint(sample * settings_.lightRays + i, {shift.y(), shift.x()});
      const double radius = 0.14 * std::sqrt(square.x()), angle = 2 * std::numbers::pi * square.y();
      const Vector3d d = (light_ * Vector3d(radius * std::cos(angle), radius * std::sin(angle), 1)).normalized();
      seen += solidRays_.cast(point, d).missed() ? 1 : 0;
    }
    return static_cast<double>(seen) / std::max(1, settings_.lightRays);
  }

  /// Marks are signs, not things: lit evenly, without shadow.
  Vector3d shadeMark(const RayHit& hit, const Vector3d& direction) const {
    const Vector3d point = camera_.X_WC.translation() + hit.distance * direction;
    const double facing = std::abs(smoothNormal(marks_, hit.triangle, point).dot(direction));
    return (0.55 + 0.45 * facing) * marks_.colour[hit.triangle];
  }

  /// Light from the sky and, weaker, from below, where nothing near stands in the way.
  Vector3d ambientLight(const Vector3d& start, const Eigen::Matrix3d& frame, const Vector3d& face, int sample,
                        const Eigen::Vector2d& shift) const {
    Vector3d sum = Vector3d::Zero();
    for (int i = 0; i < settings_.ambientRays; ++i) {
      const Vector3d d = frame * cosineDirection(sequencePoint(sample * settings_.ambientRays + i, shift));
      if (face.dot(d) <= 0) continue;
      const double open = std::min(1.0, solidRays_.cast(start, d).distance / (kAmbientReach * radius_));
      sum += open * (kFloorLight + 0.5 * (1 + d.z()) * (kSky - kFloorLight));
    }
    return sum / std::max(1, settings_.ambientRays);
  }

  /// The background, darker where the floor lies in a shadow; the floor itself has no edge and no colour.
  Vector3d background(const Vector3d& direction, int sample, const Eigen::Vector2d& shift) const {
    const Vector3d& eye = camera_.X_WC.translation();
    if (!settings_.groundShadow || !(direction.z() < -1e-3) || eye.z() <= floor_) return kBackground;
    const Vector3d point = eye + (floor_ - eye.z()) / direction.z() * direction;
    const double lit = litShare(point, sample, shift);
    double closed = 0;
    for (int i = 0; i < settings_.ambientRays; ++i) {
      const Vector3d d = cosineDirection(sequencePoint(sample * settings_.ambientRays + i, shift));
      closed += std::max(0.0, 1 - solidRays_.cast(point, d).distance / (2 * radius_));
    }
    closed /= std::max(1, settings_.ambientRays);
    return kBackground * (1 - 0.12 * (1 - lit) - 0.35 * closed);
  }

  const Camera& camera_;
  const RenderSettings& settings_;
  Surface solid_, marks_;
  RayScene solidRays_, markRays_;
  double radius_ = 1, floor_ = 0;  // m
  Eigen::Matrix3d light_;          // its z axis points to the key light
};

}  // namespace

Eigen::AlignedBox3d boundingBox(const std::vector<ScenePart>& parts) {
  Eigen::AlignedBox3d box;
  for (const ScenePart& part : parts) {
    for (const Vector3d& vertex : part.mesh.vertices) box.extend(part.X_W * vertex);
  }
  return box;
}

Vector3d Camera::ray(double u, double v) const {
  const Vector3d inC((2 * u - 1) * tanHalfWidth, (1 - 2 * v) * tanHalfHeight, -1);
  return (X_WC.linear() * inC).normalized();
}

Camera frameScene(const std::vector<ScenePart>& parts, const Vector3d& toEye, double aspect) {
  Camera camera;
  const double longSide = std::tan(kFieldOfView / 2);
  camera.tanHalfWidth = aspect >= 1 ? longSide : longSide * aspect;
  camera.tanHalfHeight = camera.tanHalfWidth / aspect;
  Eigen::Matrix3d R_WC;
  R_WC.col(2) = toEye.normalized();
  R_WC.col(0) = Vector3d::UnitZ().cross(R_WC.col(2)).normalized();
  R_WC.col(1) = R_WC.col(2).cross(R_WC.col(0));
  const double tx = camera.tanHalfWidth / kMargin, ty = camera.tanHalfHeight / kMargin;
  Eigen::Vector4d most = Eigen::Vector4d::Constant(-std::numeric_limits<double>::infinity());  // R, L, top, bottom
  for (const ScenePart& part : parts) {
    for (const Vector3d& vertex : part.mesh.vertices) {
      const Vector3d p = R_WC.transpose() * (part.X_W * vertex);
      most = most.cwiseMax(
          Eigen::Vector4d(p.x() + tx * p.z(), -p.x() + tx * p.z(), p.y() + ty * p.z(), -p.y() + ty * p.z()));
    }
  }
  if (!most.allFinite()) most.setOnes();
  const double ez = std::max((most[0] + most[1]) / (2 * tx), (most[2] + most[3]) / (2 * ty));
  camera.X_WC.linear() = R_WC;
  camera.X_WC.translation() = R_WC * Vector3d((most[0] - most[1]) / 2, (most[2] - most[3]) / 2, ez);
  return camera;
}

Image render(const std::vector<ScenePart>& parts, const Camera& camera, const RenderSettings& settings) {
  Image image{settings.width, settings.height, {}};
  image.rgb.resize(std::size_t{3} * image.width * image.height);
  const Renderer renderer(parts, camera, settings);
  std::atomic<int> nextRow{0};
  const auto work = [&] {
    for (int row = nextRow++; row < image.height; row = nextRow++) {
      renderer.renderRow(row, image.rgb.data() + std::size_t{3} * row * image.width);
    }
  };
  std::vector<std::jthread> helpers;
  for (unsigned i = 1; i < std::thread::hardware_concurrency(); ++i) helpers.emplace_back(work);
  work();
  helpers.clear();  // joins
  return image;
}

Image composeGrid(const std::vector<Image>& images, int columns) {
  assert(columns > 0);
  int cellWidth = 0, cellHeight = 0;
  for (const Image& image : images) {
    cellWidth = std::max(cellWidth, image.width);
    cellHeight = std::max(cellHeight, image.height);
  }
  const int count = static_cast<int>(images.size()), rows = (count + columns - 1) / columns;
  Image grid{cellWidth * std::min(columns, count), cellHeight * rows, {}};
  grid.rgb.assign(std::size_t{3} * grid.width * grid.height, 255);
  for (int i = 0; i < count; ++i) {
    const Image& image = images[i];
    const int left = i % columns * cellWidth + (cellWidth - image.width) / 2;
    const int top = i / columns * cellHeight + (cellHeight - image.height) / 2;
    for (int row = 0; row < image.height; ++row) {
      std::copy_n(image.rgb.begin() + std::ptrdiff_t{3} * row * image.width, 3 * image.width,
                  grid.rgb.begin() + std::ptrdiff_t{3} * ((top + row) * grid.width + left));
    }
  }
  return grid;
}

int gridColumns(std::size_t count) {
  if (count <= 3) return std::max(1, static_cast<int>(count));
  return static_cast<int>(std::ceil(std::sqrt(static_cast<double>(count))));
}

}  // namespace handhold
