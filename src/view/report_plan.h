#pragma once

#include "hand/hand.h"
#include "mesh/triangle_mesh.h"

#include <string>
#include <utility>
#include <vector>

#include <Eigen/Geometry>

namespace handhold {

/// Something that is drawn, and where it is. W is the world.
struct ReportedBody {
  enum class Role { robot, hand, object, obstacle };
  std::string name;
  Role role = Role::obstacle;
  TriangleMesh mesh;                   // in its own frame
  std::vector<Eigen::Isometry3d> X_W;  // one pose for every time of the report, or one that stays
  double goneFrom = -1;                // s, from when on it is not drawn; < 0: never
};

/// Numbers on the surface of a body. (n) is their count.
struct ReportedMap {
  std::string label, unit, meaning;
  std::vector<float> point, normal;  // (n,3) in the body's frame [m]
  std::vector<float> value;          // (n)
};

/// A grasp of the ranking.
struct ReportedRank {
  int hand = 0;  // of ReportedPlan::hands
  std::string arm;
  std::uint32_t grasp = 0;  // row of the set
  double score = 0, gq = 0, gb = 0, ge = 0;
  Eigen::Isometry3d X_WH;         // of the hand's root
  Eigen::VectorXd jointPosition;  // (J) of the hand, closed
  std::string verdict, detail;    // planned, a reason of rejection, or empty: not tested
};

/// What a report shows of a plan or a task.
struct ReportedPlan {
  struct Segment {
    std::string name, note;     // note: what a task does there
    double begin = 0, end = 0;  // s
  };
  std::string title, status;                               // planned, infeasible or failed
  std::vector<std::pair<std::string, std::string>> facts;  // label, value
  std::vector<ReportedBody> bodies;
  std::vector<double> time;  // (F) [s]
  std::vector<Segment> segments;
  std::vector<ReportedMap> maps;
  std::size_t mapBody = 0;  // on which they are
  std::vector<const Hand*> hands;
  std::vector<ReportedRank> ranking;                          // best first; as many as are shown
  std::size_t ranked = 0;                                     // in all
  std::vector<std::pair<std::string, std::size_t>> rejected;  // reason, count
};

/// The page: assemblePage's HTML. Of the scene at a time, the maps on the target, the ranking with what became of each
/// grasp, and the motions over time.
std::string planReportHtml(const ReportedPlan& plan);

}  // namespace handhold
