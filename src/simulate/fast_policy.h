#pragma once

#include "simulate/grasp_policy.h"

#include <atomic>
#include <memory>

namespace handhold {

/// What the fast policy computes once for a hand (hand_fields.h). Immutable, shared by all objects and workers.
class HandFields;

/// @throws Cancelled  within a second after `cancel` became true
/// @note Takes a few seconds on one core.
std::shared_ptr<const HandFields> makeHandFields(const Hand& hand, const std::atomic<bool>* cancel = nullptr);

/// The reference's policy, faster: fields of the hand against points of the object, then exact
/// triangles (README.md). Trials that it cannot settle exactly it hands to the reference and marks `byReference`.
/// `hand`, whose fields these are, and `object` must outlive it.
std::unique_ptr<GraspPolicy> makeFastPolicy(std::shared_ptr<const HandFields> fields, const Hand& hand,
                                            const ObjectModel& object, PolicyKind kind,
                                            const ReferenceSettings& settings = {});

}  // namespace handhold
