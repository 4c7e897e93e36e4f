#pragma once

#include "core/job_system.h"
#include "simulate/grasp_policy.h"

#include <atomic>
#include <memory>

namespace handhold {

/// What the fast policy computes once for a hand (hand_fields.h). Immutable, shared by all objects and workers.
class HandFields;

/// @throws Cancelled  within a second after `cancel` became true
/// @note Takes about a second on one core. Any number of threads makes the same fields.
std::shared_ptr<const HandFields> makeHandFields(const Hand& hand, const std::atomic<bool>* cancel = nullptr,
                                                 const JobSystem& jobs = JobSystem(1));

/// The reference's policy, faster: fields of the hand against points of the object, then exact
/// triangles (README.md). Trials that it cannot settle exactly it hands to the reference and marks `byReference`.
/// `hand`, whose fields these are, and `object` must outlive it.
std::unique_ptr<GraspPolicy> makeFastPolicy(std::shared_ptr<const HandFields> fields, const Hand& hand,
                                            const ObjectModel& object, PolicyKind kind,
                                            const ReferenceSettings& settings = {});

}  // namespace handhold
