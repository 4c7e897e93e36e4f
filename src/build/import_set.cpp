#include "build/import_set.h"

#include "build/timing.h"
#include "core/hash.h"
#include "mesh/ray_scene.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

/// The distance map has the points of a build with so many samples.
constexpr int kSamples = 1000;

/// A given grasp in the words of the policy: palm frame, target point, back-off.
struct Aim {
  GraspCandidate candidate;  // its target point lies on the approach direction through the palm, wherever that leads
  double backoff = 0;        // m, of the palm from there
  Vector3d target, normal;   // on the surface
};

std::size_t nearestPoint(const SurfaceSamples& samples, const Vector3d& p) {
  std::size_t best = 0;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    if ((samples.point[i] - p.cast<float>()).squaredNorm() < (samples.point[best] - p.cast<float>()).squaredNorm())
      best = i;
  }
  return best;
}

Aim aimOf(const GivenGrasp& grasp, const Hand& hand, const SampledObject& object, const RayScene& scene) {
  const auto X_HL = forwardKinematics(hand, hand.preshapes[grasp.preshape].jointPosition);
  const Isometry3d X_OG = grasp.X_OH * X_HL[hand.palmLink] * hand.X_LG;
  const Vector3d palm = X_OG.translation();
  Aim aim;
  aim.candidate.preshape = grasp.preshape;
  aim.candidate.approach = X_OG.linear().col(2);
  const Eigen::Matrix3d unrolled = palmPose(palm, aim.candidate.approach, 0).linear();
  const Vector3d x = X_OG.linear().col(0);
  aim.candidate.roll = std::atan2(x.dot(unrolled.col(1)), x.dot(unrolled.col(0)));
  // From 0 up, and 0 itself whichever way it was rounded.
  if (aim.candidate.roll < -1e-9) aim.candidate.roll += 2 * std::numbers::pi;
  aim.candidate.roll = std::max(aim.candidate.roll, 0.0);
  const RayHit hit = scene.cast(palm, aim.candidate.approach);
  if (hit.missed()) {
    const std::size_t i = nearestPoint(object.mapSamples, grasp.X_OH * X_HL[hand.tcpLink] * hand.p_LT);
    aim.target = object.mapSamples.point[i].cast<double>();
    aim.normal = object.mapSamples.normal[i].cast<double>();
    aim.backoff = (aim.target - palm).dot(aim.candidate.approach);
  } else {
    aim.target = palm + hit.distance * aim.candidate.approach;
    aim.normal = object.model.mesh.normal(hit.triangle);
    if (!object.model.watertight && aim.normal.dot(aim.candidate.approach) > 0) aim.normal = -aim.normal;
    aim.backoff = hit.distance;
  }
  aim.candidate.targetPoint = palm + aim.backoff * aim.candidate.approach;
  return aim;
}

std::vector<Aim> aimAll(const std::vector<GivenGrasp>& grasps, const Hand& hand, SampledObject& object) {
  const RayScene scene(object.model.mesh);
  std::vector<Aim> aims;
  SurfaceSamples samples;
  for (const GivenGrasp& grasp : grasps) {
    const Aim& aim = aims.emplace_back(aimOf(grasp, hand, object, scene));
    samples.point.push_back(aim.target.cast<float>());
    samples.normal.push_back(aim.normal.cast<float>());
    samples.approach.push_back(aim.candidate.approach.cast<float>());
  }
  object.samples = std::move(samples);
  return aims;
}

/// Closes the hand, or takes its joints as given, and judges. False when the hand in its preshape touches the object.
bool evaluateGiven(const GivenGrasp& grasp, const Aim& aim, SetWorker& worker, StageSeconds& seconds) {
  const auto start = std::chrono::steady_clock::now();
  GraspTrial& trial = worker.evaluation.trial;
  const bool isFree = worker.policy->closeAt(grasp.X_OH, grasp.preshape, trial);
  if (isFree && grasp.jointPosition.size() > 0) worker.policy->touchAt(grasp.X_OH, grasp.jointPosition, trial);
  seconds.policy += secondsSince(start);
  if (!isFree) return false;
  trial.backoff = aim.backoff;
  judge(*worker.policy, aim.candidate, worker.cones, worker.evaluation, seconds);
  return true;
}

/// What became of one grasp.
struct Result {
  std::size_t outcome = static_cast<std::size_t>(GraspOutcome::notRun);
  double epsilon = std::numeric_limits<double>::quiet_NaN();
  bool byReference = false;
  std::optional<KeptGrasp> grasp;
  StageSeconds seconds;
};

}  // namespace

Job importJob(const std::string& provenance, double friction, double contactDistance) {
  return parseJobSettings(
      fmt::format("# {}\n"
                  "sampling: {{samples: {}, rolls: 1}}   # the samples that the distance map is made for\n"
                  "quality: {{friction: {}, contact_distance: {}}}\n",
                  provenance, kSamples, friction, contactDistance),
      "import");
}

std::string importHash(const Job& job, const CatalogItem& item, const std::string& meshHash, const Hand& hand,
                       const std::vector<GivenGrasp>& grasps) {
  ContentHash hash;
  hash.addText(kImportedPolicy);
  hash.addText(inputHash(job, item, meshHash, hand));
  for (const GivenGrasp& grasp : grasps) {
    for (const double number : grasp.X_OH.matrix().reshaped()) hash.addNumber(number);
    hash.addNumber(grasp.preshape);
    hash.addNumber(static_cast<double>(grasp.jointPosition.size()));
    for (const double position : grasp.jointPosition) hash.addNumber(position);
  }
  return hash.hex();
}

std::optional<GraspSet> importSet(const Job& job, SampledObject object, const Hand& hand,
                                  const std::vector<GivenGrasp>& grasps, const std::string& inputHash,
                                  const std::shared_ptr<const HandFields>& fields, const JobSystem& jobs,
                                  const std::atomic<bool>& cancel) {
  const std::vector<Aim> aims = aimAll(grasps, hand, object);
  GraspSet set = emptySet(job, object, hand);
  set.inputHash = inputHash;
  set.policy = kImportedPolicy;
  set.outcomeNames.emplace_back(kPreshapeTouches);
  const auto preshapeTouches = set.outcomeNames.size() - 1;

  std::vector<SetWorker> workers = makeWorkers(job, object, hand, fields, jobs);
  std::vector<Result> results(grasps.size());
  const auto run = [&](int index, std::size_t i) {
    SetWorker& worker = workers[static_cast<std::size_t>(index)];
    Result& result = results[i];
    const bool isFree = evaluateGiven(grasps[i], aims[i], worker, result.seconds);
    const GraspOutcome outcome = worker.evaluation.trial.outcome;
    result.outcome = isFree ? static_cast<std::size_t>(outcome) : preshapeTouches;
    result.byReference = worker.evaluation.trial.byReference;
    if (!isFree) return;
    result.epsilon = worker.evaluation.epsilon;
    const std::size_t trial = i * set.preshapes + static_cast<std::size_t>(grasps[i].preshape);
    if (outcome == GraspOutcome::forceClosed) result.grasp = keptGrasp(trial, worker.evaluation);
  };
  jobs.run(grasps.size(), 1, run, &cancel);
  if (cancel) return std::nullopt;

  set.outcome.assign(set.trialCount(), static_cast<std::uint8_t>(GraspOutcome::notRun));
  set.trialEpsilon.assign(set.trialCount(), std::numeric_limits<float>::quiet_NaN());
  StageSeconds seconds;
  std::vector<KeptGrasp> kept;
  for (std::size_t i = 0; i < results.size(); ++i) {
    const std::size_t trial = i * set.preshapes + static_cast<std::size_t>(grasps[i].preshape);
    set.outcome[trial] = static_cast<std::uint8_t>(results[i].outcome);
    set.trialEpsilon[trial] = static_cast<float>(results[i].epsilon);
    set.trialsByReference += results[i].byReference ? 1 : 0;
    seconds.add(results[i].seconds, 1);
    if (results[i].grasp) kept.push_back(std::move(*results[i].grasp));
  }
  if (!finishSet(job, object, hand, std::move(kept), seconds, jobs, cancel, workers, set)) return std::nullopt;
  // Given grasps lie on no grid of rolls.
  for (std::size_t row = 0; row < set.graspCount(); ++row)
    set.roll[row] = static_cast<float>(aims[set.trial[3 * row]].candidate.roll);
  return set;
}

}  // namespace handhold
