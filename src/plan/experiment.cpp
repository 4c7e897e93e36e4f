#include "plan/experiment.h"

#include "core/error.h"
#include "core/hash.h"
#include "core/job_system.h"
#include "core/random.h"
#include "core/yaml.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <numeric>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

using std::numbers::pi;
using Json = nlohmann::ordered_json;

constexpr int kDraws = 200;  // of an object's pose, until enough grasps are reachable
constexpr int kObstacleDraws = 400;
constexpr int kResamples = 2000;  // of the bootstrap

/// A box that stands on the table; its centre is above it.
struct Block {
  Eigen::Vector3d size, position;
  double yaw = 0;
};

/// Do two upright boxes overlap from above? Separating axes of two rectangles.
bool overlap(const Block& a, const Block& b) {
  for (const Block* box : {&a, &b}) {
    for (const double turn : {0.0, pi / 2}) {
      const Eigen::Vector2d axis(std::cos(box->yaw + turn), std::sin(box->yaw + turn));
      const auto halfWidth = [&](const Block& c) {
        const Eigen::Vector2d u(std::cos(c.yaw), std::sin(c.yaw)), v(-u.y(), u.x());
        return c.size.x() / 2 * std::abs(axis.dot(u)) + c.size.y() / 2 * std::abs(axis.dot(v));
      };
      const Eigen::Vector2d between = (a.position - b.position).head<2>();
      if (std::abs(axis.dot(between)) >= halfWidth(a) + halfWidth(b)) return false;
    }
  }
  return true;
}

/// Numbers of one scene, in the order in which they are drawn.
class Dice {
 public:
  explicit Dice(RandomStream stream) : stream_(stream) {}
  double between(double low, double high) { return std::lerp(low, high, stream_.uniform(counter_++)); }
  int whole(int low, int high) {
    return low + static_cast<int>(stream_.bits(counter_++) % static_cast<std::uint64_t>(high - low + 1));
  }

 private:
  RandomStream stream_;
  std::uint64_t counter_ = 0;
};

std::string poseText(const Eigen::Vector3d& p, double yaw) {
  return fmt::format("{{position: [{:.6f}, {:.6f}, {:.6f}], orientation: [0, 0, {:.9f}, {:.9f}]}}", p.x(), p.y(), p.z(),
                     std::sin(yaw / 2), std::cos(yaw / 2));
}

RandomStream streamOf(std::uint64_t seed, const std::string& robot, const std::string& object) {
  ContentHash hash;
  hash.addText(robot);
  hash.addText(object);
  return RandomStream(seed).child(std::stoull(hash.hex().substr(0, 16), nullptr, 16));
}

/// Draws scenes around one object for one robot.
class SceneMaker {
 public:
  SceneMaker(const Robot& robot, const std::string& object, const TriangleMesh& mesh, const ExperimentOptions& options)
      : robot_(robot), object_(object), box_(boundingBox(mesh)), options_(options) {
    if (!robot.workspace) {
      throw InputError(fmt::format("robot {}: robot.yaml has no workspace, want one for experiments", robot.name));
    }
  }

  /// The scene file. `tryObject` says whether enough grasps can be reached with the object alone.
  std::string make(const RandomStream& stream, const std::function<bool(const std::string&)>& tryObject) const {
    const Workspace& place = *robot_.workspace;
    const double top = place.tablePosition.z() + place.tableSize.z() / 2;
    Dice dice(stream);
    for (int draw = 0; draw < kDraws; ++draw) {
      const double x = dice.between(place.x[0], place.x[1]), y = dice.between(place.y[0], place.y[1]);
      const double yaw = dice.between(0, 2 * pi);
      const std::string head = headText(place, {x, y, top - box_.min().z()}, yaw);
      if (!tryObject(head)) continue;
      return head + obstaclesText(dice, {x, y}, yaw, top);
    }
    throw InputError(
        fmt::format("robot {}, object {}: no pose of {} in the workspace has {:.0f} % of the grasps "
                    "reachable, want another workspace or more grasps",
                    robot_.name, object_, kDraws, 100 * options_.minReachable));
  }

 private:
  std::string headText(const Workspace& place, const Eigen::Vector3d& p, double yaw) const {
    const Eigen::Vector3d base = place.X_WB.translation();
    const Eigen::Quaterniond turn(place.X_WB.linear());
    return fmt::format(
        "robot: {{base: {{position: [{}, {}, {}], orientation: [{}, {}, {}, {}]}}, joints: home{}}}\n"
        "target: {{object: {}, pose: {}}}\n"
        "obstacles:\n"
        "  - {{name: table, box: [{}, {}, {}], pose: {{position: [{}, {}, {}]}}}}\n",
        base.x(), base.y(), base.z(), turn.x(), turn.y(), turn.z(), turn.w(),
        place.arm.empty() ? "" : ", arm: " + place.arm, object_, poseText(p, yaw), place.tableSize.x(),
        place.tableSize.y(), place.tableSize.z(), place.tablePosition.x(), place.tablePosition.y(),
        place.tablePosition.z());
  }

  std::string obstaclesText(Dice& dice, const Eigen::Vector2d& at, double yaw, double top) const {
    Block object{box_.sizes(), {}, yaw};
    const Eigen::Vector3d middle = box_.center();
    object.position = Eigen::Vector3d(at.x(), at.y(), 0) +
                      Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * Eigen::Vector3d(middle.x(), middle.y(), 0);
    std::vector<Block> placed = {object};
    const int wanted = dice.whole(options_.fewestObstacles, options_.mostObstacles);
    std::string text;
    for (int draw = 0; draw < kObstacleDraws && static_cast<int>(placed.size()) <= wanted; ++draw) {
      const double angle = dice.between(0, 2 * pi);
      Block block;
      block.size = {dice.between(0.04, 0.1), dice.between(0.04, 0.1), dice.between(0.08, 0.25)};
      block.yaw = dice.between(0, 2 * pi);
      block.position = {at.x() + options_.circle * std::cos(angle), at.y() + options_.circle * std::sin(angle),
                        top + block.size.z() / 2};
      const Eigen::Vector3d from = (block.position - robot_.workspace->tablePosition).cwiseAbs();
      if (from.x() > robot_.workspace->tableSize.x() / 2 || from.y() > robot_.workspace->tableSize.y() / 2) continue;
      if (std::any_of(placed.begin(), placed.end(), [&](const Block& other) { return overlap(block, other); }))
        continue;
      text += fmt::format("  - {{name: block_{}, box: [{:.6f}, {:.6f}, {:.6f}], pose: {}}}\n", placed.size(),
                          block.size.x(), block.size.y(), block.size.z(), poseText(block.position, block.yaw));
      placed.push_back(block);
    }
    return text;
  }

  const Robot& robot_;
  std::string object_;
  Eigen::AlignedBox3d box_;
  const ExperimentOptions& options_;
};

/// Tests until the first grasp that works, from 1; all and one more when none does.
std::size_t firstWorking(const std::vector<std::uint32_t>& order, const std::vector<bool>& works) {
  const auto at = std::find_if(order.begin(), order.end(), [&](std::uint32_t grasp) { return works[grasp]; });
  return static_cast<std::size_t>(at - order.begin()) + 1;
}

/// Mean over shuffles of the tests until the first valid grasp (Fisher and Yates).
double naiveMean(const std::vector<bool>& works, int shuffles, const RandomStream& stream) {
  double sum = 0;
  for (int s = 0; s < shuffles; ++s) {
    const RandomStream shuffle = stream.child(static_cast<std::uint64_t>(s));
    std::vector<std::uint32_t> order(works.size());
    std::iota(order.begin(), order.end(), 0u);
    for (std::size_t i = order.size() - 1; i > 0; --i) std::swap(order[i], order[shuffle.bits(i) % (i + 1)]);
    sum += static_cast<double>(firstWorking(order, works));
  }
  return sum / shuffles;
}

/// The order by a score of the three terms, ties by grasp.
template <class Score>
std::vector<std::uint32_t> orderBy(const std::vector<GraspScore>& terms, const Score& score) {
  std::vector<std::uint32_t> order(terms.size());
  std::iota(order.begin(), order.end(), 0u);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return score(terms[a]) > score(terms[b]); });
  return order;
}

std::vector<std::uint32_t> graspsOf(const Ranking& ranking) {
  std::vector<std::uint32_t> order;
  for (const RankedGrasp& grasp : ranking.grasps) order.push_back(grasp.score.grasp);
  return order;
}

void countTests(const Robot& robot, const Ranking& paper, const Ranking& reach, SceneTrial& trial) {
  const ScoreCoefficients& c = robot.score;
  trial.tests["paper"] = firstWorking(graspsOf(paper), trial.works);
  trial.tests["reach"] = firstWorking(graspsOf(reach), trial.works);
  const auto count = [&](const char* name, double c1, double c2, double c3) {
    trial.tests[name] = testsWith(trial, c1, c2, c3);
  };
  count("only_gq", 1, 0, 0);
  count("only_gb", 0, 1, 0);
  count("only_ge", 0, 0, 1);
  count("without_gq", 0, c.c2, c.c3);
  count("without_gb", c.c1, 0, c.c3);
  count("without_ge", c.c1, c.c2, 0);
}

std::string drawScene(Planner& planner, const SceneMaker& maker, const RandomStream& stream,
                      const ExperimentOptions& options) {
  const ObjectMeshes meshes = [&](const std::string& name) { return planner.objectMesh(name); };
  const auto take = [&](const std::string& yaml) {
    planner.setScene(readScene(YamlValue::parseText(yaml, "scene"), "", meshes));
  };
  const std::string yaml = maker.make(stream.child(0), [&](const std::string& head) {
    take(head);
    return planner.reachableShare() >= options.minReachable;
  });
  take(yaml);
  return yaml;
}

SceneTrial runScene(Planner& planner, const SceneMaker& maker, const std::string& object, int index,
                    const RandomStream& stream, const ExperimentOptions& options,
                    const std::map<std::string, std::vector<std::uint32_t>>& external) {
  SceneTrial trial;
  trial.name = fmt::format("{}_{}_{:03}", planner.robot().name, object, index);
  trial.yaml = drawScene(planner, maker, stream, options);
  const Ranking paper = planner.rank(ScoreKind::paper), reach = planner.rank(ScoreKind::reach);
  trial.grasps = paper.grasps.size();
  trial.paper.resize(trial.grasps);
  trial.works.resize(trial.grasps);
  for (const RankedGrasp& grasp : paper.grasps) {
    trial.paper[grasp.score.grasp] = grasp.score;
    trial.works[grasp.score.grasp] = !planner.test(grasp.score);
  }
  trial.valid = static_cast<std::size_t>(std::count(trial.works.begin(), trial.works.end(), true));
  if (trial.valid == 0) return trial;
  trial.naive = naiveMean(trial.works, options.shuffles, stream.child(1));
  countTests(planner.robot(), paper, reach, trial);
  if (external.empty()) return trial;
  const auto given = external.find(trial.name);
  if (given == external.end()) throw InputError(fmt::format("the order from outside has no scene {}", trial.name));
  for (const std::uint32_t grasp : given->second) {
    if (grasp >= trial.grasps) {
      throw InputError(
          fmt::format("the order from outside of {} has grasp {}, want below {}", trial.name, grasp, trial.grasps));
    }
  }
  trial.tests["external"] = firstWorking(given->second, trial.works);
  return trial;
}

double median(std::vector<double> values) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return n % 2 == 1 ? values[n / 2] : (values[n / 2 - 1] + values[n / 2]) / 2;
}

double mean(const std::vector<double>& values) {
  return values.empty() ? 0 : std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

/// 95 % of the means of resampled scenes (Efron 1979, percentile interval).
std::pair<double, double> bootstrap(const std::vector<double>& values, std::uint64_t seed) {
  if (values.empty()) return {0, 0};
  const RandomStream stream(seed);
  std::vector<double> means;
  for (std::uint64_t r = 0; r < kResamples; ++r) {
    const RandomStream resample = stream.child(r);
    double sum = 0;
    for (std::size_t i = 0; i < values.size(); ++i) sum += values[resample.bits(i) % values.size()];
    means.push_back(sum / static_cast<double>(values.size()));
  }
  std::sort(means.begin(), means.end());
  return {means[kResamples / 40], means[kResamples - 1 - kResamples / 40]};
}

Json summaryJson(const ExperimentCell& cell, const std::string& order, std::uint64_t seed) {
  const OrderSummary s = summarise(cell, order, seed);
  return {{"robot", cell.robot},
          {"object", cell.object},
          {"score", order},
          {"scenes", s.scenes},
          {"feasible_scenes", s.feasible},
          {"mean_ratio", s.meanRatio},
          {"mean_ratio_ci", {s.ratioLow, s.ratioHigh}},
          {"ratio_of_means", s.ratioOfMeans},
          {"share_won", s.shareWon},
          {"hard_scenes", s.hard},
          {"share_won_hard", s.shareWonHard},
          {"mean_tested", s.meanTested},
          {"median_tested", s.medianTested},
          {"naive_mean_tested", s.naiveMeanTested}};
}

bool hasExternal(const ExperimentCell& cell) {
  return std::any_of(cell.scenes.begin(), cell.scenes.end(),
                     [](const SceneTrial& trial) { return trial.tests.contains("external"); });
}

}  // namespace

ExperimentCell runExperiment(const std::function<Planner()>& makePlanner, const std::string& object,
                             const ExperimentOptions& options, int threads,
                             const std::map<std::string, std::vector<std::uint32_t>>& externalOrder) {
  /// What a thread works with.
  struct Worker {
    Worker(Planner p, const std::string& o, const ExperimentOptions& settings)
        : planner(std::move(p)), maker(planner.robot(), o, planner.objectMesh(o), settings) {}
    Planner planner;
    SceneMaker maker;
  };
  const auto makeWorker = [&] { return std::make_unique<Worker>(makePlanner(), object, options); };
  const JobSystem jobs(threads);
  std::vector<std::unique_ptr<Worker>> workers(static_cast<std::size_t>(jobs.threads()));
  workers[0] = makeWorker();
  ExperimentCell cell;
  cell.robot = workers[0]->planner.robot().name;
  cell.object = object;
  cell.scenes.resize(static_cast<std::size_t>(options.scenes));
  const RandomStream stream = streamOf(options.seed, cell.robot, object);
  jobs.run(cell.scenes.size(), 1, [&](int worker, std::size_t i) {
    std::unique_ptr<Worker>& mine = workers[static_cast<std::size_t>(worker)];
    if (!mine) mine = makeWorker();
    cell.scenes[i] =
        runScene(mine->planner, mine->maker, object, static_cast<int>(i), stream.child(i), options, externalOrder);
  });
  return cell;
}

std::string takeRandomScene(Planner& planner, const std::string& object, int index, const ExperimentOptions& options) {
  const SceneMaker maker(planner.robot(), object, planner.objectMesh(object), options);
  return drawScene(planner, maker,
                   streamOf(options.seed, planner.robot().name, object).child(static_cast<std::uint64_t>(index)),
                   options);
}

std::size_t testsWith(const SceneTrial& trial, double c1, double c2, double c3) {
  // exp is monotonic: the product ranks as its exponent does.
  return firstWorking(orderBy(trial.paper, [&](const GraspScore& s) { return c1 * s.gq + c2 * s.gb + c3 * s.ge; }),
                      trial.works);
}

OrderSummary summarise(const ExperimentCell& cell, const std::string& order, std::uint64_t seed) {
  OrderSummary summary;
  summary.scenes = cell.scenes.size();
  std::vector<double> ratios, tested, naive;
  std::size_t won = 0, wonHard = 0;
  for (const SceneTrial& trial : cell.scenes) {
    if (trial.valid == 0) continue;
    const double tests = static_cast<double>(trial.tests.at(order));
    ratios.push_back(trial.naive / tests);
    tested.push_back(tests);
    naive.push_back(trial.naive);
    const bool isWon = tests<trial.naive, isHard = trial.naive> 2;
    won += isWon ? 1 : 0;
    summary.hard += isHard ? 1 : 0;
    wonHard += isWon && isHard ? 1 : 0;
  }
  summary.feasible = ratios.size();
  if (ratios.empty()) return summary;
  const double n = static_cast<double>(ratios.size());
  summary.meanRatio = mean(ratios);
  std::tie(summary.ratioLow, summary.ratioHigh) = bootstrap(ratios, seed);
  summary.meanTested = mean(tested);
  summary.naiveMeanTested = mean(naive);
  summary.ratioOfMeans = summary.naiveMeanTested / summary.meanTested;
  summary.medianTested = median(tested);
  summary.shareWon = static_cast<double>(won) / n;
  summary.shareWonHard = summary.hard > 0 ? static_cast<double>(wonHard) / static_cast<double>(summary.hard) : 1;
  return summary;
}

std::string cellsJson(const std::vector<ExperimentCell>& cells, std::uint64_t seed) {
  Json list = Json::array();
  for (const ExperimentCell& cell : cells) {
    for (const char* order : {"paper", "reach"}) list.push_back(summaryJson(cell, order, seed));
    if (hasExternal(cell)) list.push_back(summaryJson(cell, "external", seed));
  }
  return Json{{"cells", list}}.dump(1);
}

std::string ablationJson(const std::vector<ExperimentCell>& cells, std::uint64_t seed) {
  Json list = Json::array();
  for (const ExperimentCell& cell : cells) {
    for (const std::string_view order : kOrderNames) list.push_back(summaryJson(cell, std::string(order), seed));
  }
  return Json{{"cells", list}}.dump(1);
}

std::string sweepJson(const std::vector<ExperimentCell>& cells) {
  // Only the ratios matter: the exponent ranks as its multiples do.
  constexpr std::array<double, 6> kGq = {0, 0.1, 0.25, 0.5, 1, 2}, kGb = {0, 0.25, 0.5, 1, 2, 4};
  constexpr std::array<double, 4> kGe = {0, 1, 2, 4};
  Json list = Json::array();
  for (const ExperimentCell& cell : cells) {
    for (const double c1 : kGq) {
      for (const double c2 : kGb) {
        for (const double c3 : kGe) {
          std::vector<double> ratios, tested;
          for (const SceneTrial& trial : cell.scenes) {
            if (trial.valid == 0) continue;
            tested.push_back(static_cast<double>(testsWith(trial, c1, c2, c3)));
            ratios.push_back(trial.naive / tested.back());
          }
          list.push_back({{"robot", cell.robot},
                          {"object", cell.object},
                          {"c1", c1},
                          {"c2", c2},
                          {"c3", c3},
                          {"mean_ratio", mean(ratios)},
                          {"mean_tested", mean(tested)}});
        }
      }
    }
  }
  return Json{{"sweep", list}}.dump(1);
}

std::string scenesJson(const std::vector<ExperimentCell>& cells) {
  Json list = Json::array();
  for (const ExperimentCell& cell : cells) {
    for (const SceneTrial& trial : cell.scenes) {
      Json row = {{"scene", trial.name}, {"grasps", trial.grasps}, {"valid", trial.valid}};
      if (trial.valid > 0) row["naive"] = trial.naive;
      for (const auto& [order, tests] : trial.tests) row["tests"][order] = tests;
      list.push_back(std::move(row));
    }
  }
  return Json{{"scenes", list}}.dump(1);
}

}  // namespace handhold
