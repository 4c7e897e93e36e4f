#include "store/query.h"

#include "core/error.h"
#include "core/farthest_poses.h"
#include "core/file.h"
#include "store/database.h"
#include "store/index.h"
#include "store/layout.h"
#include "store/physics_set.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;
using Filter = std::size_t LeftOut::*;  // null: none

/// Names are those of the program's options.
void checkNumber(const char* name, double value, double least, double most, const char* wanted) {
  if (std::isfinite(value) && value >= least && value <= most) return;
  throw InputError(fmt::format("query: {} is {}, want {}", name, value, wanted));
}

void checkVector(const char* name, const Eigen::Vector3d& v) {
  if (!v.allFinite())
    throw InputError(fmt::format("query: {} is {},{},{}, want three numbers", name, v.x(), v.y(), v.z()));
}

void checkQuery(const GraspQuery& query) {
  constexpr double kAny = std::numeric_limits<double>::max(), kDegree = std::numbers::pi / 180;
  if (query.setVersion) checkNumber("set-version", *query.setVersion, 1, kAny, "a number from 1");
  if (query.minEpsilon) checkNumber("min-epsilon", *query.minEpsilon, -kAny, kAny, "a number");
  if (query.friction) checkNumber("friction", *query.friction, 0, kAny, "a number from 0");
  if (query.minPhysics) checkNumber("min-physics", *query.minPhysics, 0, 1, "a share, 0 to 1");
  if (query.approach) {
    checkVector("approach", query.approach->axis);
    if (query.approach->axis.isZero(0)) throw InputError("query: approach is 0,0,0, want a direction");
    checkNumber("within", query.approach->halfAngle / kDegree, 0, 180, "0 to 180 degrees");
  }
  if (query.near) {
    checkVector("near", query.near->center);
    checkNumber("radius", query.near->radius, 0, kAny, "metres, from 0");
  }
  if (query.top == std::size_t{0}) throw InputError("query: top is 0, want 1 or more");
  if (query.diverse && !query.top) throw InputError("query: diverse is asked for without top, want how many to keep");
}

/// Of each object and hand the newest set, or the one of the version that is asked for.
std::vector<SetFile> selectSets(const Database& database, const GraspQuery& query) {
  std::vector<SetFile> selected;
  for (SetFile& file : database.sets(query.object, query.hand)) {
    if (query.setVersion) {
      if (file.version == *query.setVersion) selected.push_back(std::move(file));
    } else if (!selected.empty() && selected.back().object == file.object && selected.back().hand == file.hand) {
      selected.back() = std::move(file);
    } else {
      selected.push_back(std::move(file));
    }
  }
  if (selected.empty()) {
    const std::string version = query.setVersion ? fmt::format(", version {}", *query.setVersion) : "";
    throw InputError(fmt::format("query: object \"{}\", hand \"{}\"{} picks no set of {}", query.object, query.hand,
                                 version, database.folder().string()));
  }
  return selected;
}

/// Have the set's grasps been simulated? Their results would lie beside it.
bool hasPhysics(const fs::path& set) { return fs::exists(physicsPath(set)); }

/// Stored as the nearest 32-bit number: one that equals the limit passes, whichever way it was rounded.
bool isAtMost(double criticalFriction, double limit) {
  return static_cast<float>(criticalFriction) <= static_cast<float>(limit);
}

/// The filter of minPhysics, minEpsilon and friction that no grasp can pass, by the extremes over all of them.
Filter failedByAll(const GraspQuery& query, const fs::path& path, double bestEpsilon, double leastCriticalFriction) {
  if (query.minPhysics && !hasPhysics(path)) return &LeftOut::notSimulated;
  if (query.minEpsilon && bestEpsilon < *query.minEpsilon) return &LeftOut::minEpsilon;
  if (query.friction && std::isnan(leastCriticalFriction)) return &LeftOut::unknownFriction;
  if (query.friction && !isAtMost(leastCriticalFriction, *query.friction)) return &LeftOut::friction;
  return nullptr;
}

Filter failedByAll(const GraspQuery& query, const fs::path& path, const GraspSet& set) {
  double least = std::numeric_limits<double>::quiet_NaN();
  for (const float friction : set.criticalFriction) least = std::fmin(least, friction);
  return failedByAll(query, path, set.epsilon.empty() ? 0 : set.epsilon.front(), least);
}

Eigen::Vector3d vectorAt(const std::vector<float>& values, std::size_t row) {
  return Eigen::Vector3f(values.data() + 3 * row).cast<double>();
}

double angleBetween(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

/// The first filter that one grasp fails. `wantedPreshape`: by the index of the preshape. `held`: of each grasp the
/// share of the simulated directions, where it was asked for.
Filter failedBy(const GraspQuery& query, const GraspSet& set, const std::vector<bool>& wantedPreshape,
                const std::vector<double>& held, std::size_t row) {
  if (query.minPhysics && std::isnan(held[row])) return &LeftOut::notSimulated;
  if (query.minPhysics && held[row] < *query.minPhysics) return &LeftOut::minPhysics;
  if (query.minEpsilon && set.epsilon[row] < *query.minEpsilon) return &LeftOut::minEpsilon;
  if (query.friction && std::isnan(set.criticalFriction[row])) return &LeftOut::unknownFriction;
  if (query.friction && !isAtMost(set.criticalFriction[row], *query.friction)) return &LeftOut::friction;
  if (!wantedPreshape[set.trial[3 * row + 2]]) return &LeftOut::preshape;
  if (query.approach &&
      angleBetween(vectorAt(set.approachDirection, row), query.approach->axis) > query.approach->halfAngle) {
    return &LeftOut::approach;
  }
  if (query.near && (vectorAt(set.targetPoint, row) - query.near->center).norm() > query.near->radius) {
    return &LeftOut::near;
  }
  return nullptr;
}

std::vector<std::size_t> passingRows(const GraspQuery& query, const GraspSet& set, const std::vector<double>& held,
                                     LeftOut& leftOut) {
  std::vector<bool> wantedPreshape;
  for (const std::string& name : set.preshapeNames) wantedPreshape.push_back(matchesGlob(name, query.preshape));
  std::vector<std::size_t> rows;
  for (std::size_t row = 0; row < set.graspCount(); ++row) {
    const Filter failed = failedBy(query, set, wantedPreshape, held, row);
    if (failed == nullptr) {
      rows.push_back(row);
    } else {
      ++(leftOut.*failed);
    }
  }
  return rows;
}

/// `top` of the rows, in their order; returns the cover radius.
double keepDiverse(const GraspSet& set, std::size_t top, std::vector<std::size_t>& rows) {
  std::vector<Eigen::Isometry3d> poses;
  poses.reserve(rows.size());
  for (const std::size_t row : rows) poses.push_back(set.X_OH(row));
  const PoseCover cover = farthestPoses(poses, top, set.torqueScale);
  std::vector<std::size_t> kept;
  for (const std::size_t i : cover.chosen) kept.push_back(rows[i]);
  rows = std::move(kept);
  return cover.radius;
}

FoundGrasp graspAt(const GraspSet& set, std::size_t row) {
  const auto nJoints = static_cast<Eigen::Index>(set.jointNames.size());
  const auto joints = [&](const std::vector<float>& values) -> Eigen::VectorXd {
    return Eigen::Map<const Eigen::VectorXf>(values.data() + row * set.jointNames.size(), nJoints).cast<double>();
  };
  FoundGrasp found;
  found.grasp = row;
  std::copy_n(set.trial.begin() + static_cast<std::ptrdiff_t>(3 * row), 3, found.trial.begin());
  found.epsilon = set.epsilon[row];
  found.epsilonLower = set.epsilonLower[row];
  found.epsilonUpper = set.epsilonUpper[row];
  found.criticalFriction = set.criticalFriction[row];
  found.loadMargin = set.loadMargin[row];
  found.robustness = set.robustness[row];
  found.robustnessLower = set.robustnessLower[row];
  found.robustnessUpper = set.robustnessUpper[row];
  std::copy_n(set.handPose.begin() + static_cast<std::ptrdiff_t>(7 * row), 7, found.handPose.begin());
  found.X_OH = set.X_OH(row);
  found.jointPosition = joints(set.jointPosition);
  found.preshapeJointPosition = joints(set.preshapeJointPosition);
  found.targetPoint = vectorAt(set.targetPoint, row);
  found.approachDirection = vectorAt(set.approachDirection, row);
  found.roll = set.roll[row];
  found.backoff = set.backoff[row];
  found.approachClear = set.approachClear[row] != 0;
  found.contacts = set.contactBegin[row + 1] - set.contactBegin[row];
  return found;
}

/// What of a set that was read answers the query.
FoundSet searchSet(const GraspQuery& query, const fs::path& path, GraspSet set, const std::vector<double>& held,
                   LeftOut& leftOut) {
  FoundSet found;
  found.path = path;
  found.object = set.object;
  found.hand = set.hand;
  found.setVersion = set.setVersion;
  found.friction = set.friction;
  std::vector<std::size_t> rows = passingRows(query, set, held, leftOut);
  found.passed = rows.size();
  if (query.diverse) {
    found.coverRadius = keepDiverse(set, *query.top, rows);
  } else if (query.top && *query.top < rows.size()) {
    rows.resize(*query.top);
  }
  found.grasps.reserve(rows.size());
  for (const std::size_t row : rows) {
    found.grasps.push_back(graspAt(set, row));
    if (!held.empty()) found.grasps.back().physics = held[row];
  }
  found.jointNames = std::move(set.jointNames);
  found.preshapeNames = std::move(set.preshapeNames);
  return found;
}

void requireFriction(const GraspQuery& query, const fs::path& path, double friction) {
  if (!query.friction || *query.friction <= friction) return;
  throw InputError(fmt::format("query: friction is {}, want at most {}: {} was built with that", *query.friction,
                               friction, path.string()));
}

}  // namespace

QueryAnswer Database::query(const GraspQuery& query) const {
  checkQuery(query);
  const std::vector<SetFile> files = selectSets(*this, query);
  QueryAnswer answer;
  answer.setsAsked = files.size();
  // Only these filters can pass over a set by its extremes, and only the index tells them without reading it.
  const bool indexHelps = files.size() > 1 && (query.minPhysics || query.minEpsilon || query.friction);
  std::optional<CatalogIndex> index;
  if (indexHelps) index.emplace(folder());
  for (const auto& [path, object, hand, version] : files) {
    const std::optional<IndexedSet> indexed = index ? index->find(path) : std::nullopt;
    if (indexed) {
      const GraspSetSummary& summary = indexed->summary;
      requireFriction(query, path, summary.friction);
      if (const Filter failed = failedByAll(query, path, summary.bestEpsilon, summary.leastCriticalFriction)) {
        answer.graspsAsked += summary.grasps;
        answer.leftOut.*failed += summary.grasps;
        continue;
      }
    }
    GraspSet set;
    try {
      set = readGraspTable(path);
    } catch (const InputError& error) {
      answer.failures.emplace_back(error.what());
      continue;
    }
    requireFriction(query, path, set.friction);
    answer.graspsAsked += set.graspCount();
    if (const Filter failed = failedByAll(query, path, set)) {
      answer.leftOut.*failed += set.graspCount();
      continue;
    }
    std::vector<double> held;
    try {
      if (query.minPhysics)
        held = shareHeld(readPhysicsOf(path, set.inputHash, set.setVersion, set.graspCount()), set.graspCount());
    } catch (const InputError& error) {
      answer.failures.emplace_back(error.what());
      continue;
    }
    FoundSet found = searchSet(query, path, std::move(set), held, answer.leftOut);
    if (!found.grasps.empty()) answer.sets.push_back(std::move(found));
  }
  return answer;
}

}  // namespace handhold
