#pragma once

#include "store/grasp_set.h"

#include <cstddef>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace handhold {

/// The datasets and attributes in which two sets differ, bit for bit (any NaN is equal to any), as db/FORMAT.md writes
/// them (`/trials/outcome@names`); /timings, generator and set_version aside.
std::vector<std::string> differences(const GraspSet& a, const GraspSet& b);

/// A number in the record of a grasp that two sets do not share, bit for bit.
struct GraspDifference {
  std::string dataset;  // `/contacts/normal`
  std::string a, b;     // the first element that differs
};

/// The first difference between grasp `rowA` of `a` and grasp `rowB` of `b`, its contacts and neighbours included.
std::optional<GraspDifference> firstGraspDifference(const GraspSet& a, std::size_t rowA, const GraspSet& b,
                                                    std::size_t rowB);

/// Something of two sets side by side.
template <class Value>
struct Pair {
  std::string name;
  Value a{}, b{};
};

/// What changed from one set to another.
struct SetComparison {
  std::vector<std::string> datasets;      // differences(a, b); empty: the sets are equal
  std::vector<Pair<std::string>> inputs;  // what differs of job, hand, object, parameters, program
  std::vector<Pair<std::size_t>> counts;  // trials, every outcome of either set, grasps stored
  std::vector<Pair<double>>
      quality;  // share_force_closed; best_, median_, p90_epsilon of the stored grasps (NaN: none)
  std::size_t common = 0, onlyA = 0, onlyB = 0;     // stored grasps with the same target, approach, roll and preshape
  std::size_t epsilonChanged = 0, poseChanged = 0;  // of the common ones
  double largestEpsilonChange = 0, largestShift = 0, largestTurn = 0;  // of them; m and rad of the hand's root
};

SetComparison compareSets(const GraspSet& a, const GraspSet& b);

}  // namespace handhold
