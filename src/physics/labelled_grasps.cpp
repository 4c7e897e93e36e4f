#include "physics/labelled_grasps.h"

#include "build/evaluate.h"
#include "build/stored_set.h"
#include "quality/true_cone.h"

#include <algorithm>
#include <cmath>

namespace handhold {
namespace {

constexpr double kPull = 1;  // N, at which the load margin counts half: that of the test

/// One grasp that was drawn.
struct Draw {
  std::size_t trial = 0;           // index into N*R*M
  std::optional<std::size_t> row;  // of /grasps, where it is stored
};

std::vector<Draw> drawAll(const GraspSet& set, std::size_t count, std::uint64_t seed) {
  const DrawnGrasps drawn = drawGrasps(set, count, count, seed);
  std::vector<Draw> draws;
  for (const std::size_t row : drawn.rows) draws.push_back({trialOf(set, row), row});
  for (const std::size_t trial : drawn.trials) draws.push_back({trial, std::nullopt});
  return draws;
}

/// The friction beyond which none is looked for.
double largestFriction(const SimulatedSet& set) { return std::max(set.set().friction, set.settings().world.friction); }

WrenchModel withFriction(WrenchModel model, double friction) {
  model.friction = friction;
  return model;
}

double numberOr(double value, double otherwise) { return std::isnan(value) ? otherwise : value; }

/// Labels one draw after another; a thread's own.
class Worker {
 public:
  Worker(const SimulatedSet& set, const RecordedTrials& trials, SetWorker worker)
      : worker_(std::move(worker)),
        set_(set),
        trials_(trials),
        wrenches_(trials.wrenches()),
        tasks_(taskWrenches(trials.job())),
        load_(wrenches_),
        cones_(withFriction(wrenches_, largestFriction(set))),
        simulator_(set.model()) {}

  /// @param stream  of the robustness
  LabelledGrasp label(const Draw& draw, const RandomStream& stream) {
    const GraspCandidate candidate = trials_.candidate(draw.trial);
    StageSeconds seconds;
    evaluate(*worker_.policy, candidate, worker_.cones, worker_.evaluation, seconds);
    const GraspPosture posture =
        draw.row ? set_.posture(*draw.row) : trials_.posture(candidate, worker_.evaluation.trial);
    LabelledGrasp grasp;
    grasp.stored = draw.row.has_value();
    const auto feature = [&](HoldFeature which) -> double& { return grasp.features[static_cast<std::size_t>(which)]; };
    feature(HoldFeature::epsilon) = draw.row ? set_.set().epsilon[*draw.row] : numberOr(worker_.evaluation.epsilon, 0);
    feature(HoldFeature::criticalFriction) = criticalFriction(draw, posture);
    feature(HoldFeature::loadMargin) = loadShare(posture);
    feature(HoldFeature::robustness) = robustness(candidate.preshape, stream);
    const TestResult result = simulator_.run(posture, PhysicsTest::pull);
    feature(HoldFeature::settledClosed) = result.settled.closed ? 1 : 0;
    grasp.held = isHeld(result);
    return grasp;
  }

 private:
  bool hasContacts(const GraspPosture& posture) const { return posture.contacts.size() >= wrenches_.fewestContacts(); }

  double criticalFriction(const Draw& draw, const GraspPosture& posture) {
    const GraspSet& set = set_.set();
    if (draw.row) return numberOr(set.criticalFriction[*draw.row], set.friction);
    const double largest = largestFriction(set_);
    return hasContacts(posture) ? numberOr(cones_.criticalFriction(posture.contacts).friction, largest) : largest;
  }

  double loadShare(const GraspPosture& posture) {
    if (!hasContacts(posture)) return 0;
    const double load = evaluateLoad(load_, set_.model().hand(), posture.joints, posture.X_OH, posture.contacts,
                                     wrenches_.centerOfMass, tasks_)
                            .load;
    return std::isinf(load) ? 1 : numberOr(load / (load + kPull), 0);
  }

  /// Of the trial that was evaluated.
  double robustness(int preshape, const RandomStream& stream) {
    const GraspTrial& trial = worker_.evaluation.trial;
    const Eigen::Isometry3d X_OH = Eigen::Translation3d(-trial.centering) * trial.X_OH;
    return forceClosureUnderNoise(*worker_.policy, worker_.cones.linearised, X_OH, preshape, wrenches_.centerOfMass,
                                  kCalibrationNoise, stream)
        .share;
  }

  SetWorker worker_;
  const SimulatedSet& set_;
  const RecordedTrials& trials_;
  WrenchModel wrenches_;
  TaskWrenches tasks_;
  LoadMarginSolver load_;
  TrueCones cones_;
  GraspSimulator simulator_;
};

}  // namespace

std::optional<std::vector<LabelledGrasp>> GraspLabeller::label(const SimulatedSet& set, std::size_t count,
                                                               std::uint64_t seed, const JobSystem& jobs,
                                                               const std::atomic<bool>& cancel) {
  const std::vector<Draw> draws = drawAll(set.set(), count, seed);
  const RecordedTrials trials(set, fields_, cancel);
  std::vector<Worker> workers;
  for (SetWorker& worker : trials.makeWorkers(jobs)) workers.emplace_back(set, trials, std::move(worker));
  const RandomStream random = drawStream(set.set(), seed).child(4);
  std::vector<LabelledGrasp> grasps(draws.size());
  jobs.run(
      draws.size(), 1,
      [&](int worker, std::size_t i) { grasps[i] = workers[worker].label(draws[i], random.child(draws[i].trial)); },
      &cancel);
  if (cancel) return std::nullopt;
  return grasps;
}

}  // namespace handhold
