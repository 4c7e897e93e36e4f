#include "plan/trajectory.h"

#include <algorithm>
#include <cmath>

namespace handhold {
namespace {

constexpr int kPartsOfALine = 16;
constexpr double kMinLength = 1e-9;  // s at full speed: nothing moves

/// Time at which a trapezoid of unit top speed and acceleration A has gone s of S.
double trapezoidTime(double s, double S, double A) {
  const double ramp = std::min(0.5 / A, S / 2);  // length of the rise
  const double top = std::sqrt(2 * A * ramp);    // speed reached
  const double rise = top / A;
  if (s <= ramp) return std::sqrt(2 * s / A);
  if (s <= S - ramp) return rise + (s - ramp) / top;
  return 2 * rise + (S - 2 * ramp) / top - std::sqrt(2 * std::max(0.0, S - s) / A);
}

double trapezoidSpeed(double s, double S, double A) {
  return std::min({1.0, std::sqrt(2 * A * s), std::sqrt(2 * A * std::max(0.0, S - s))});
}

/// Points of a smooth curve, rest to rest, from time 0.
std::vector<TrajectoryPoint> timeCurve(const JointPath& nodes, const JointLimits& limits) {
  // s: time at full speed of the slowest joint.
  std::vector<double> s(nodes.size(), 0);
  double sharpest = 0;  // largest |dq/ds| / acceleration
  for (std::size_t i = 1; i < nodes.size(); ++i) {
    const Eigen::ArrayXd step = (nodes[i] - nodes[i - 1]).cwiseAbs().array();
    const double ds = (step / limits.velocity.array()).maxCoeff();
    s[i] = s[i - 1] + ds;
    if (ds > 0) sharpest = std::max(sharpest, (step / limits.acceleration.array()).maxCoeff() / ds);
  }
  const double S = s.back();
  std::vector<TrajectoryPoint> points;
  if (S < kMinLength) return points;
  const double A = 1 / std::max(sharpest, 1e-6);
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (i > 0 && s[i] - s[i - 1] < kMinLength) continue;
    const bool isEnd = i == 0 || i + 1 == nodes.size();
    TrajectoryPoint point{trapezoidTime(s[i], S, A), nodes[i], Eigen::VectorXd::Zero(nodes[i].size())};
    if (!isEnd) point.velocity = trapezoidSpeed(s[i], S, A) * (nodes[i + 1] - nodes[i - 1]) / (s[i + 1] - s[i - 1]);
    points.push_back(std::move(point));
  }
  points.back().velocity.setZero();
  double slower = 1;
  Eigen::VectorXd velocity, acceleration;
  for (std::size_t i = 1; i < points.size(); ++i) {
    cubicPeaks(points[i - 1], points[i], velocity, acceleration);
    slower = std::max({slower, (velocity.array() / limits.velocity.array()).maxCoeff(),
                       std::sqrt((acceleration.array() / limits.acceleration.array()).maxCoeff())});
  }
  for (TrajectoryPoint& point : points) {
    point.time *= slower;
    point.velocity /= slower;
  }
  return points;
}

/// Adds what comes after the trajectory's last point.
void join(const std::vector<TrajectoryPoint>& points, Trajectory& trajectory) {
  const double start = trajectory.points.back().time;
  for (std::size_t i = 1; i < points.size(); ++i) {
    trajectory.points.push_back(points[i]);
    trajectory.points.back().time += start;
  }
}

}  // namespace

void cubicPeaks(const TrajectoryPoint& a, const TrajectoryPoint& b, Eigen::VectorXd& velocity,
                Eigen::VectorXd& acceleration) {
  const double h = b.time - a.time;
  const Eigen::ArrayXd slope = (b.position - a.position).array() / h;
  const Eigen::ArrayXd va = a.velocity.array(), vb = b.velocity.array();
  const Eigen::ArrayXd start = (6 * slope - 4 * va - 2 * vb) / h, end = (-6 * slope + 2 * va + 4 * vb) / h;
  acceleration = start.abs().max(end.abs());
  velocity = va.abs().max(vb.abs());
  for (Eigen::Index j = 0; j < velocity.size(); ++j) {
    if (start[j] * end[j] >= 0) continue;  // the velocity has no turning point inside
    const double t = start[j] / (start[j] - end[j]);
    velocity[j] = std::max(velocity[j], std::abs(va[j] + h * t * (start[j] + (end[j] - start[j]) * t / 2)));
  }
}

void appendSegment(const std::string& name, const JointPath& path, bool corners, const JointLimits& limits,
                   Trajectory& trajectory) {
  if (trajectory.points.empty()) {
    trajectory.points.push_back({0, path.front(), Eigen::VectorXd::Zero(path.front().size())});
  }
  const std::size_t begin = trajectory.points.size() - 1;
  if (corners) {
    for (std::size_t i = 1; i < path.size(); ++i) {
      JointPath line;
      for (int part = 0; part <= kPartsOfALine; ++part) {
        line.push_back(path[i - 1] + (path[i] - path[i - 1]) * part / kPartsOfALine);
      }
      join(timeCurve(line, limits), trajectory);
    }
  } else if (path.size() > 1) {
    join(timeCurve(path, limits), trajectory);
  }
  trajectory.segments.push_back({name, begin, trajectory.points.size() - 1});
}

Eigen::VectorXd positionAt(const Trajectory& trajectory, std::size_t i, double t) {
  const TrajectoryPoint &a = trajectory.points[i], &b = trajectory.points[i + 1];
  const double h = b.time - a.time, u = (t - a.time) / h;
  const double h00 = (1 + 2 * u) * (1 - u) * (1 - u), h10 = u * (1 - u) * (1 - u);
  const double h01 = u * u * (3 - 2 * u), h11 = u * u * (u - 1);
  return h00 * a.position + h10 * h * a.velocity + h01 * b.position + h11 * h * b.velocity;
}

}  // namespace handhold
