#include "view/report_plan.h"

#include "view/report_page.h"

#include <array>

#include <nlohmann/json.hpp>

namespace handhold {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::array<const char*, 4> kRoleNames = {"robot", "hand", "object", "obstacle"};

/// (n,7) x y z qx qy qz qw.
std::string packedPoses(const std::vector<Eigen::Isometry3d>& poses) {
  std::vector<float> numbers;
  numbers.reserve(7 * poses.size());
  for (const Eigen::Isometry3d& X : poses) {
    const Eigen::Quaterniond q(X.linear());
    for (const double x : {X.translation().x(), X.translation().y(), X.translation().z(), q.x(), q.y(), q.z(), q.w()}) {
      numbers.push_back(static_cast<float>(x));
    }
  }
  return packed(numbers);
}

/// One pose where all are the same.
std::vector<Eigen::Isometry3d> withoutRepeats(const std::vector<Eigen::Isometry3d>& poses) {
  for (const Eigen::Isometry3d& X : poses) {
    if (X.matrix() != poses.front().matrix()) return poses;
  }
  return {poses.front()};
}

Json bodyJson(const ReportedBody& body) {
  return {{"name", body.name},
          {"role", kRoleNames[static_cast<std::size_t>(body.role)]},
          {"mesh", Json::parse(meshJson(body.mesh))},
          {"poses", packedPoses(withoutRepeats(body.X_W))},
          {"gone_from", body.goneFrom}};
}

/// Column by column.
Json columnsOf(const std::vector<ReportedRank>& ranking) {
  Json arm = Json::array(), verdict = Json::array(), detail = Json::array(), joints = Json::array();
  std::vector<std::uint32_t> grasp;
  std::vector<std::uint8_t> hand;
  std::vector<float> score, gq, gb, ge;
  std::vector<Eigen::Isometry3d> poses;
  for (const ReportedRank& row : ranking) {
    arm.push_back(row.arm);
    verdict.push_back(row.verdict);
    detail.push_back(row.detail);
    joints.push_back(std::vector<float>(row.jointPosition.begin(), row.jointPosition.end()));
    grasp.push_back(row.grasp);
    hand.push_back(static_cast<std::uint8_t>(row.hand));
    score.push_back(static_cast<float>(row.score));
    gq.push_back(static_cast<float>(row.gq));
    gb.push_back(static_cast<float>(row.gb));
    ge.push_back(static_cast<float>(row.ge));
    poses.push_back(row.X_WH);
  }
  return {{"arm", arm},
          {"verdict", verdict},
          {"detail", detail},
          {"joints", joints},
          {"grasp", packed(grasp)},
          {"hand", packed(hand)},
          {"score", packed(score)},
          {"gq", packed(gq)},
          {"gb", packed(gb)},
          {"ge", packed(ge)},
          {"pose", packedPoses(poses)}};
}

}  // namespace

std::string planReportHtml(const ReportedPlan& plan) {
  Json bodies = Json::array(), segments = Json::array(), maps = Json::array(), hands = Json::array();
  for (const ReportedBody& body : plan.bodies) bodies.push_back(bodyJson(body));
  for (const ReportedPlan::Segment& segment : plan.segments) {
    segments.push_back(
        {{"name", segment.name}, {"note", segment.note}, {"begin", segment.begin}, {"end", segment.end}});
  }
  for (const ReportedMap& map : plan.maps) {
    maps.push_back({{"label", map.label},
                    {"unit", map.unit},
                    {"meaning", map.meaning},
                    {"point", packed(map.point)},
                    {"normal", packed(map.normal)},
                    {"value", packed(map.value)}});
  }
  for (const Hand* hand : plan.hands) hands.push_back(Json::parse(handJson(*hand)));
  const std::vector<float> time(plan.time.begin(), plan.time.end());
  const Json json = {{"title", plan.title},   {"status", plan.status},
                     {"facts", plan.facts},   {"bodies", bodies},
                     {"time", packed(time)},  {"segments", segments},
                     {"maps", maps},          {"map_body", plan.mapBody},
                     {"hands", hands},        {"ranking", columnsOf(plan.ranking)},
                     {"ranked", plan.ranked}, {"rejected", plan.rejected}};
  return assemblePage(plan.title + " - Handhold",
                      {{"plan", json.dump(-1, ' ', false, Json::error_handler_t::replace)}});
}

}  // namespace handhold
