#include "app/commands.h"
#include "build/build_set.h"
#include "core/error.h"
#include "quality/true_cone.h"
#include "simulate/actuation.h"

#include <fmt/format.h>

namespace handhold {
namespace {

std::string text(const Eigen::Vector3d& v) { return fmt::format("({:.5f}, {:.5f}, {:.5f})", v.x(), v.y(), v.z()); }

void printStop(const Hand& hand, const ClosingStop& stop) {
  const Joint& joint = hand.joints[stop.joint];
  std::string links;
  for (const int link : stop.links) links += (links.empty() ? "" : ", ") + hand.links[link].name;
  fmt::print("  {} {} at {:.5f} {}\n", joint.name, links.empty() ? "reaches its limit" : "is stopped by " + links,
             stop.position, joint.type == JointType::revolute ? "rad" : "m");
}

void printContact(const Hand& hand, const Contact& contact) {
  fmt::print("  {:<28} position {}  normal {}\n", hand.links[contact.link].name, text(contact.position),
             text(contact.normal));
}

void printLoadMargin(const Job& job, const CatalogItem& item, const Hand& hand, const ObjectModel& object,
                     const GraspTrial& trial) {
  if (job.loadMargin.grasps == 0) return;
  if (!hasEffortLimits(hand)) {
    fmt::print("no load margin: the URDF gives no joint an effort limit\n");
    return;
  }
  const TaskWrenches tasks = taskWrenches(job);
  LoadMarginSolver solver(wrenchModel(job, item, object, hand));
  const LoadMargin margin =
      evaluateLoad(solver, hand, trial.jointPosition, trial.X_OH, trial.contacts, object.mass.centerOfMass, tasks);
  if (margin.verdict == LoadVerdict::failed) {
    fmt::print("the load margin could not be computed\n");
  } else {
    fmt::print("load margin {:.3f} N over {} tasks ({} iterations)\n", margin.load, tasks.cols(), margin.iterations);
  }
}

}  // namespace

int explainTrial(const Job& job, const CatalogItem& item, const Hand& hand, std::size_t trial) {
  const SampledObject object = loadSampledObject(job, item);
  const std::size_t trials = object.samples.size() * job.rolls * hand.preshapes.size();
  if (trial >= trials) {
    throw InputError(fmt::format("--trial {}: {} x {} has {} trials, want 0 to {}", trial, item.name, hand.name, trials,
                                 trials - 1));
  }
  const GraspCandidate candidate = candidateAt(job, object.samples, hand, trial);
  const auto fields = job.simulation == Simulation::fast ? makeHandFields(hand, nullptr, JobSystem()) : nullptr;
  const auto policy = makePolicy(job, hand, object.model, fields);
  Evaluation result;
  StageSeconds seconds;
  const WrenchModel model = wrenchModel(job, item, object.model, hand);
  Cones cones(model);
  evaluate(*policy, candidate, cones, result, seconds);

  const std::size_t preshapes = hand.preshapes.size();
  fmt::print("trial {} of {} x {}: sample {} of {}, roll {} of {}, preshape {}\n", trial, item.name, hand.name,
             trial / (preshapes * job.rolls), object.samples.size(), trial / preshapes % job.rolls, job.rolls,
             hand.preshapes[candidate.preshape].name);
  fmt::print("target point {} m, approach {}, roll {:.1f} degrees\n", text(candidate.targetPoint),
             text(candidate.approach), candidate.roll * 57.29577951308232);
  fmt::print("run by the {} policy{}\n", job.simulation == Simulation::fast ? "fast" : "reference",
             result.trial.byReference ? ", which handed it to the reference" : "");
  fmt::print("backed off by {:.2f} mm\n", 1e3 * result.trial.backoff);
  fmt::print("closing:\n");
  for (const ClosingStop& stop : result.trial.stops) printStop(hand, stop);
  if (!result.trial.centering.isZero())
    fmt::print("  the hand moves by {} m to centre the jaws\n", text(result.trial.centering));
  const Eigen::Quaterniond q(result.trial.X_OH.linear());
  fmt::print("hand pose {} m, quaternion [{:.5f}, {:.5f}, {:.5f}, {:.5f}] (x, y, z, w)\n",
             text(result.trial.X_OH.translation()), q.x(), q.y(), q.z(), q.w());
  fmt::print("{} contacts (normals into the object):\n", result.trial.contacts.size());
  for (const Contact& contact : result.trial.contacts) printContact(hand, contact);
  fmt::print("outcome {}, epsilon {:.6f} (contacts are {}; friction {}, {} cone edges)\n",
             kOutcomeNames[static_cast<int>(result.trial.outcome)], result.epsilon, contactModel(hand.torsionRadius),
             item.friction, job.coneEdges);
  if (result.trial.outcome == GraspOutcome::forceClosed) {
    TrueCones trueCones(model);
    const EpsilonBounds bounds = trueCones.epsilonBounds(result.trial.contacts);
    fmt::print("on the true cone epsilon is {:.6f} to {:.6f}, and force closure needs friction {:.4f}\n", bounds.lower,
               bounds.upper, trueCones.criticalFriction(result.trial.contacts).friction);
    printLoadMargin(job, item, hand, object.model, result.trial);
    fmt::print("the straight approach from outside is {}\n", result.approachClear ? "free" : "blocked by the object");
  }
  if (result.trial.outcome == GraspOutcome::notForceClosed) {
    const auto& d = result.forceClosure.separatingDirection;
    fmt::print(
        "no {} has a positive component along this wrench (force; torque / {:.4f} m): "
        "({:.3f}, {:.3f}, {:.3f}; {:.3f}, {:.3f}, {:.3f})\n",
        hand.torsionRadius > 0 ? "contact force or moment" : "contact force", object.model.mass.radius, d[0], d[1],
        d[2], d[3], d[4], d[5]);
  }
  fmt::print("{} collision tests, {:.2f} ms\n", result.trial.collisionQueries,
             1e3 * (seconds.policy + seconds.forceClosure + seconds.epsilon + seconds.approach));
  return kExitDone;
}

}  // namespace handhold
