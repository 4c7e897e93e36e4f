#include "plan/motion.h"

#include "core/random.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

#include <ompl/base/MotionValidator.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/datastructures/NearestNeighborsLinear.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>

namespace handhold {
namespace {

namespace ob = ompl::base;

Eigen::VectorXd toVector(const ob::State* state, Eigen::Index size) {
  return Eigen::Map<const Eigen::VectorXd>(state->as<ob::RealVectorStateSpace::StateType>()->values, size);
}

/// Uniform postures from a counter-based stream: OMPL's own generators share a global seed.
class StreamSampler : public ob::RealVectorStateSampler {
 public:
  StreamSampler(const ob::StateSpace* space, RandomStream stream) : RealVectorStateSampler(space), stream_(stream) {}

  void sampleUniform(ob::State* state) override {
    const auto* space = static_cast<const ob::RealVectorStateSpace*>(space_);
    double* const values = state->as<ob::RealVectorStateSpace::StateType>()->values;
    for (unsigned i = 0; i < space->getDimension(); ++i) {
      values[i] = std::lerp(space->getBounds().low[i], space->getBounds().high[i], stream_.uniform(counter_++));
    }
  }

 private:
  RandomStream stream_;
  std::uint64_t counter_ = 0;
};

/// Straight lines, checked at steps of the robot's points instead of fractions of the space.
class LineValidator : public ob::MotionValidator {
 public:
  LineValidator(const ob::SpaceInformationPtr& information, const MotionSpace& space, double step)
      : MotionValidator(information), space_(space), step_(step) {}

  bool checkMotion(const ob::State* a, const ob::State* b) const override {
    const Eigen::Index n = space_.lower.size();
    const Eigen::VectorXd end = toVector(b, n);
    return space_.isFree(end) && lineIsFree(space_, toVector(a, n), end, step_);
  }
  bool checkMotion(const ob::State*, const ob::State*, std::pair<ob::State*, double>&) const override {
    throw std::logic_error("RRT-Connect does not ask for the last valid state");
  }

 private:
  const MotionSpace& space_;
  double step_;
};

/// OMPL searches a path whose lines are checked every `step`.
std::optional<JointPath> search(const MotionSpace& space, const Eigen::VectorXd& start, const Eigen::VectorXd& goal,
                                double step, const RandomStream& stream, const std::function<bool()>& ended) {
  ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
  const auto n = static_cast<unsigned>(start.size());
  auto states = std::make_shared<ob::RealVectorStateSpace>(n);
  ob::RealVectorBounds bounds(n);
  for (unsigned i = 0; i < n; ++i) {
    const double low = std::min(start[i], goal[i]), high = std::max(start[i], goal[i]);
    bounds.setLow(i, std::isfinite(space.lower[i]) ? std::min(space.lower[i], low) : low - std::numbers::pi);
    bounds.setHigh(i,
                   (std::isfinite(space.upper[i]) ? std::max(space.upper[i], high) : high + std::numbers::pi) + 1e-9);
  }
  states->setBounds(bounds);
  states->setStateSamplerAllocator([&](const ob::StateSpace* s) { return std::make_shared<StreamSampler>(s, stream); });
  auto information = std::make_shared<ob::SpaceInformation>(states);
  information->setStateValidityChecker([&](const ob::State* state) { return space.isFree(toVector(state, n)); });
  information->setMotionValidator(std::make_shared<LineValidator>(information, space, step));
  information->setup();

  auto problem = std::make_shared<ob::ProblemDefinition>(information);
  ob::ScopedState<ob::RealVectorStateSpace> from(states), to(states);
  for (unsigned i = 0; i < n; ++i) {
    from[i] = start[i];
    to[i] = goal[i];
  }
  problem->setStartAndGoalStates(from, to, 1e-9);
  ompl::geometric::RRTConnect planner(information);
  planner.setRange(0.6);
  planner.setNearestNeighbors<ompl::NearestNeighborsLinear>();
  planner.setProblemDefinition(problem);
  planner.setup();
  const ob::PlannerStatus status = planner.solve(ob::PlannerTerminationCondition(ended));
  if (status != ob::PlannerStatus::EXACT_SOLUTION) return std::nullopt;
  JointPath path;
  for (const ob::State* state : problem->getSolutionPath()->as<ompl::geometric::PathGeometric>()->getStates()) {
    path.push_back(toVector(state, n));
  }
  return path;
}

double length(const MotionSpace& space, const Eigen::VectorXd& a, const Eigen::VectorXd& b) {
  return space.reach.dot((b - a).cwiseAbs());
}

/// Cuts corners: two points of the path, chosen at random, are joined by a line where that is free and shorter.
void shorten(const MotionSpace& space, double step, int tries, const RandomStream& stream,
             const std::function<bool()>& ended, JointPath& path) {
  for (int i = 0; i < tries && path.size() > 2 && !ended(); ++i) {
    std::vector<double> at(path.size(), 0);
    for (std::size_t k = 1; k < path.size(); ++k) at[k] = at[k - 1] + length(space, path[k - 1], path[k]);
    double s[2] = {at.back() * stream.uniform(2 * i), at.back() * stream.uniform(2 * i + 1)};
    if (i == 0) s[0] = 0, s[1] = at.back();
    if (s[0] > s[1]) std::swap(s[0], s[1]);
    std::size_t segment[2];
    Eigen::VectorXd point[2];
    for (int e = 0; e < 2; ++e) {
      const auto next = std::upper_bound(at.begin() + 1, at.end() - 1, s[e]);
      segment[e] = static_cast<std::size_t>(next - at.begin());
      const double span = at[segment[e]] - at[segment[e] - 1];
      const double t = span > 0 ? (s[e] - at[segment[e] - 1]) / span : 0;
      point[e] = path[segment[e] - 1] + std::min(t, 1.0) * (path[segment[e]] - path[segment[e] - 1]);
    }
    if (segment[0] == segment[1]) continue;
    if (!space.isFree(point[0]) || !space.isFree(point[1]) || !lineIsFree(space, point[0], point[1], step)) continue;
    JointPath cut(path.begin(), path.begin() + static_cast<std::ptrdiff_t>(segment[0]));
    cut.push_back(point[0]);
    cut.push_back(point[1]);
    cut.insert(cut.end(), path.begin() + static_cast<std::ptrdiff_t>(segment[1]), path.end());
    path = std::move(cut);
  }
  // The ends of the whole line may stand twice.
  path.erase(
      std::unique(path.begin(), path.end(),
                  [&](const Eigen::VectorXd& a, const Eigen::VectorXd& b) { return length(space, a, b) < 1e-9; }),
      path.end());
}

bool pathIsFree(const MotionSpace& space, const JointPath& path, double step) {
  for (std::size_t i = 1; i < path.size(); ++i) {
    if (!space.isFree(path[i]) || !lineIsFree(space, path[i - 1], path[i], step)) return false;
  }
  return true;
}

}  // namespace

bool lineIsFree(const MotionSpace& space, const Eigen::VectorXd& a, const Eigen::VectorXd& b, double step) {
  const int parts = std::max(1, static_cast<int>(std::ceil(length(space, a, b) / step)));
  // In the order of halving: what is in the way is found early.
  int stride = 1;
  while (stride < parts) stride *= 2;
  for (; stride > 1; stride /= 2) {
    for (int i = stride / 2; i < parts; i += stride) {
      if (!space.isFree(a + (b - a) * i / parts)) return false;
    }
  }
  return true;
}

std::optional<JointPath> planMotion(const MotionSpace& space, const Eigen::VectorXd& start, const Eigen::VectorXd& goal,
                                    const MotionSettings& settings) {
  int checks = 0;
  bool stopped = false;
  MotionSpace counted = space;
  counted.isFree = [&](const Eigen::VectorXd& q) {
    ++checks;
    if (checks % 64 == 0 && settings.stop && settings.stop()) stopped = true;
    return !stopped && space.isFree(q);
  };
  const auto ended = [&] { return stopped || checks > settings.maxChecks; };
  if (!counted.isFree(start) || !counted.isFree(goal)) return std::nullopt;
  if (lineIsFree(counted, start, goal, settings.fineStep)) return JointPath{start, goal};
  const RandomStream stream(settings.seed);
  // Lines that hold coarsely nearly always hold finely; where they do not, the search is done again finely.
  for (const double step : {settings.coarseStep, settings.fineStep}) {
    auto path = search(counted, start, goal, step, stream.child(0), ended);
    if (!path) return std::nullopt;
    shorten(counted, settings.fineStep, settings.shortcuts, stream.child(1), ended, *path);
    if (pathIsFree(counted, *path, settings.fineStep)) return path;
    if (ended()) return std::nullopt;
  }
  return std::nullopt;
}

}  // namespace handhold
