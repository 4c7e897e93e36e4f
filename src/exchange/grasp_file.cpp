#include "exchange/grasp_file.h"

#include "core/error.h"
#include "exchange/read_formats.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace handhold {
namespace {

/// Rotations in others' files are often 32-bit floats.
constexpr double kRigidSlack = 1e-3;
/// Simulators let joints overstep their limits by about as much [rad or m].
constexpr double kLimitSlack = 1e-3;

using Positions = std::map<std::string, double>;

int jointIndex(const GraspFile& file, const FileGrasp& grasp, const Hand& hand, const std::string& name) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < hand.joints.size(); ++i) {
    if (hand.joints[i].name == name) return static_cast<int>(i);
    names.push_back(hand.joints[i].name);
  }
  throw InputError(
      fmt::format("{}: {} has joint \"{}\", want those of {}: {} (--close passes over the joints of the file)",
                  file.path, grasp.name, name, hand.name, fmt::join(names, ", ")));
}

/// The whole posture (J), mimic joints that are not given following; empty when it is not fixed.
Eigen::VectorXd readPosture(const GraspFile& file, const FileGrasp& grasp, const Hand& hand) {
  Eigen::VectorXd q = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(hand.joints.size()));
  std::vector<int> given;
  for (const auto& [name, position] : grasp.jointPosition) {
    const int i = jointIndex(file, grasp, hand, name);
    const Joint& joint = hand.joints[static_cast<std::size_t>(i)];
    if (!(position >= joint.lower - kLimitSlack && position <= joint.upper + kLimitSlack)) {
      throw InputError(fmt::format("{}: {} has joint {} at {}, want it within {} .. {}", file.path, grasp.name, name,
                                   position, joint.lower, joint.upper));
    }
    q[i] = std::clamp(position, joint.lower, joint.upper);
    given.push_back(i);
  }
  for (const int joint : fixingJoints(hand)) {
    if (std::find(given.begin(), given.end(), joint) == given.end()) return {};
  }
  Eigen::VectorXd posture = followMimics(hand, q);
  for (const int joint : given) posture[joint] = q[joint];
  return posture;
}

/// The largest difference of the joints that are given.
double pregraspDistance(const GraspFile& file, const FileGrasp& grasp, const Hand& hand, const Preshape& preshape) {
  double distance = 0;
  for (const auto& [name, position] : grasp.pregraspPosition)
    distance = std::max(distance, std::abs(preshape.jointPosition[jointIndex(file, grasp, hand, name)] - position));
  return distance;
}

int namedPreshape(const Hand& hand, const std::string& name) {
  std::vector<std::string> names;
  for (const Preshape& preshape : hand.preshapes) names.push_back(preshape.name);
  const auto found = std::find(names.begin(), names.end(), name);
  if (found == names.end())
    throw InputError(fmt::format("--preshape is \"{}\", want one of {}: {}", name, hand.name, fmt::join(names, ", ")));
  return static_cast<int>(found - names.begin());
}

}  // namespace

Eigen::Isometry3d rigidTransform(const std::array<double, 16>& rows, const std::string& where) {
  const Eigen::Matrix4d X = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(rows.data());
  const Eigen::Matrix3d R = X.topLeftCorner<3, 3>();
  const auto refuse = [&](std::string_view what) {
    throw InputError(fmt::format("{} is {}, want a rigid transform, row by row", where, what));
  };
  if (!X.allFinite()) refuse("not finite");
  if ((X.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > kRigidSlack)
    refuse(fmt::format("a matrix whose last row is [{}]", fmt::join(X.row(3), ", ")));
  if ((R.transpose() * R - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() > kRigidSlack)
    refuse("a matrix that also scales or shears");
  if (R.determinant() < 0) refuse("a matrix that mirrors");
  return Eigen::Translation3d(X.topRightCorner<3, 1>()) * Eigen::Quaterniond(R).normalized();
}

GraspFile readGraspFile(const std::string& path) {
  const std::string extension = std::filesystem::path(path).extension();
  GraspFile file;
  if (extension == ".h5" || extension == ".hdf5") {
    file = readAcronym(path);
  } else if (extension == ".yaml" || extension == ".yml") {
    file = readIsaac(path);
  } else if (extension == ".json") {
    file = readGraspGen(path);
  } else {
    throw InputError(fmt::format("{}: ends with \"{}\", want .h5 (ACRONYM), .yaml (isaac_grasp) or .json (GraspGen)",
                                 path, extension));
  }
  file.path = path;
  if (file.grasps.empty())
    throw InputError(fmt::format("{}: holds no grasp{}", path,
                                 file.failed > 0 ? fmt::format(" but {} that it marks as failed", file.failed) : ""));
  return file;
}

GivenGrasps givenGrasps(const GraspFile& file, const Hand& hand, const GivenGraspOptions& options) {
  constexpr double kSamePregrasp = 1e-3;  // rad or m
  GivenGrasps given;
  const int named = options.preshape.empty() ? 0 : namedPreshape(hand, options.preshape);
  for (const FileGrasp& grasp : file.grasps) {
    GivenGrasp& result = given.grasps.emplace_back();
    result.preshape = named;
    if (options.preshape.empty() && !options.close && !grasp.pregraspPosition.empty()) {
      double nearest = std::numeric_limits<double>::infinity();
      for (std::size_t i = 0; i < hand.preshapes.size(); ++i) {
        const double distance = pregraspDistance(file, grasp, hand, hand.preshapes[i]);
        if (distance < nearest) nearest = distance, result.preshape = static_cast<int>(i);
      }
      given.otherPregrasp += nearest > kSamePregrasp ? 1 : 0;
    }
    const Preshape& preshape = hand.preshapes[static_cast<std::size_t>(result.preshape)];
    result.X_OH = grasp.X_OF * framePose(hand, preshape.jointPosition, options.frame, file.rootAxes).inverse();
    if (!options.close) result.jointPosition = readPosture(file, grasp, hand);
  }
  return given;
}

void keepUsedPreshapes(Hand& hand, std::vector<GivenGrasp>& grasps) {
  std::vector<int> newIndex(hand.preshapes.size(), -1);
  for (const GivenGrasp& grasp : grasps) newIndex[static_cast<std::size_t>(grasp.preshape)] = 0;
  std::vector<Preshape> used;
  for (std::size_t i = 0; i < newIndex.size(); ++i) {
    if (newIndex[i] < 0) continue;
    newIndex[i] = static_cast<int>(used.size());
    used.push_back(hand.preshapes[i]);
  }
  for (GivenGrasp& grasp : grasps) grasp.preshape = newIndex[static_cast<std::size_t>(grasp.preshape)];
  hand.preshapes = std::move(used);
}

}  // namespace handhold
