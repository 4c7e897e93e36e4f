#include "build/kept_quality.h"

#include "build/evaluate.h"
#include "build/timing.h"
#include "simulate/actuation.h"

namespace handhold {

KeptQuality::KeptQuality(const Job& job, const Hand& hand, const WrenchModel& model, std::uint64_t key)
    : job_(job),
      hand_(hand),
      model_(model),
      tasks_(taskWrenches(job)),
      trueCones_(model),
      solver_(model),
      cones_(model),
      stream_(RandomStream(job.seed).child(key)),
      loadRows_(hasEffortLimits(hand) ? static_cast<std::size_t>(job.loadMargin.grasps) : 0),
      robustnessRows_(job.robustness.noise.trials > 0 ? static_cast<std::size_t>(job.robustness.grasps) : 0) {}

void KeptQuality::compute(std::size_t row, GraspPolicy& policy, KeptGrasp& grasp) {
  const double start = threadSeconds();
  const EpsilonBounds bounds = trueCones_.epsilonBounds(grasp.contacts);
  grasp.epsilonLower = bounds.lower;
  grasp.epsilonUpper = bounds.upper;
  grasp.criticalFriction = trueCones_.criticalFriction(grasp.contacts).friction;
  const double afterBounds = threadSeconds();
  boundsSeconds += afterBounds - start;
  double afterLoad = afterBounds;
  if (row < loadRows_) {
    grasp.loadMargin =
        evaluateLoad(solver_, hand_, grasp.jointPosition, grasp.X_OH, grasp.contacts, model_.centerOfMass, tasks_).load;
    afterLoad = threadSeconds();
    loadSeconds += afterLoad - afterBounds;
  }
  if (row < robustnessRows_) {
    const Eigen::Isometry3d X_OH = Eigen::Translation3d(-grasp.centering) * grasp.X_OH;
    const auto preshape = static_cast<int>(grasp.trial % hand_.preshapes.size());
    grasp.robustness = forceClosureUnderNoise(policy, cones_, X_OH, preshape, model_.centerOfMass,
                                              job_.robustness.noise, stream_.child(grasp.trial));
    robustnessSeconds += threadSeconds() - afterLoad;
  }
}

}  // namespace handhold
