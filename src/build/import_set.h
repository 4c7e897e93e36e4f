#pragma once

#include "build/build_set.h"
#include "hand/given_grasp.h"

#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace handhold {

/// GraspSet::policy of sets whose grasps were planned elsewhere.
inline constexpr std::string_view kImportedPolicy = "imported";
/// An outcome that only these sets have: the hand in its preshape touches the object at the given pose.
inline constexpr std::string_view kPreshapeTouches = "preshape_touches";

/// The settings of an import, and what the set records as its job.
/// @param provenance  one line: file, format, hash
Job importJob(const std::string& provenance, double friction, double contactDistance);

/// inputHash() for a set of given grasps.
std::string importHash(const Job& job, const CatalogItem& item, const std::string& meshHash, const Hand& hand,
                       const std::vector<GivenGrasp>& grasps);

/// A set of given grasps: N of them, one roll, the hand's preshapes; a trial that was not asked for is `not_run`.
/// A grasp without joint positions is closed by the policy from its preshape, which moves the hand when a jaw centres
/// itself. One with joint positions is taken as it is: links within the contact distance of the object touch it.
/// Contacts, force closure and epsilon are those of a build; what ends otherwise than force closed is an outcome, and
/// no row.
///
/// The target point is where the palm's approach direction first meets the object; where it misses, the point of the
/// distance map nearest to the tool centre point. The distance map is that of a build.
///
/// @param object  loadSampledObject(job, item): its samples give way to the target points
/// @param fields  as makePolicy has them
/// @return nothing when `cancel` became true
std::optional<GraspSet> importSet(const Job& job, SampledObject object, const Hand& hand,
                                  const std::vector<GivenGrasp>& grasps, const std::string& inputHash,
                                  const std::shared_ptr<const HandFields>& fields, const JobSystem& jobs,
                                  const std::atomic<bool>& cancel);

}  // namespace handhold
