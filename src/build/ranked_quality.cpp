#include "build/ranked_quality.h"

#include "build/evaluate.h"
#include "build/timing.h"
#include "simulate/actuation.h"

#include <algorithm>

namespace handhold {

RankedQuality::RankedQuality(const Job& job, const Hand& hand, const WrenchModel& model, std::uint64_t key)
    : job_(job),
      hand_(hand),
      model_(model),
      tasks_(taskWrenches(job)),
      solver_(model),
      cones_(model),
      stream_(RandomStream(job.seed).child(key)),
      loadRows_(hasEffortLimits(hand) ? static_cast<std::size_t>(job.loadMargin.grasps) : 0),
      robustnessRows_(job.robustness.noise.trials > 0 ? static_cast<std::size_t>(job.robustness.grasps) : 0) {}

std::size_t RankedQuality::rows() const { return std::max(loadRows_, robustnessRows_); }

void RankedQuality::compute(std::size_t row, GraspPolicy& policy, KeptGrasp& grasp) {
  const double start = threadSeconds();
  if (row < loadRows_) {
    grasp.loadMargin =
        evaluateLoad(solver_, hand_, grasp.jointPosition, grasp.X_OH, grasp.contacts, model_.centerOfMass, tasks_).load;
  }
  const double middle = threadSeconds();
  if (row < robustnessRows_) {
    const Eigen::Isometry3d X_OH = Eigen::Translation3d(-grasp.centering) * grasp.X_OH;
    const auto preshape = static_cast<int>(grasp.trial % hand_.preshapes.size());
    grasp.robustness = forceClosureUnderNoise(policy, cones_, X_OH, preshape, model_.centerOfMass,
                                              job_.robustness.noise, stream_.child(grasp.trial));
  }
  loadSeconds += middle - start;
  robustnessSeconds += threadSeconds() - middle;
}

}  // namespace handhold
