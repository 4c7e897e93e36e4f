// Makes a large set of a small one: its samples, trials and grasps again and again, as those of a finer sampling.
// With 0 grasps: a set without any, and all its samples.
// Usage: repeat_grasps SET GRASPS DATABASE
#include "store/database.h"

#include <algorithm>
#include <cstdlib>
#include <iostream>

namespace handhold {
namespace {

/// Appends `times` copies of what is there.
template <class T>
void repeat(std::vector<T>& values, std::size_t times) {
  const std::vector<T> once = values;
  for (std::size_t i = 0; i < times; ++i) values.insert(values.end(), once.begin(), once.end());
}

template <class T>
void appendRows(const std::vector<T>& from, std::size_t row, std::size_t width, std::vector<T>& to) {
  const auto begin = from.begin() + static_cast<std::ptrdiff_t>(row * width);
  to.insert(to.end(), begin, begin + static_cast<std::ptrdiff_t>(width));
}

/// Rows stay in the order of falling epsilon: all copies of the first, then of the second.
GraspSet repeated(const GraspSet& set, std::size_t grasps) {
  const std::size_t n = set.graspCount(), copies = std::max<std::size_t>(1, (grasps + n - 1) / n);
  GraspSet large = set;
  large.object += "_repeated";
  large.samples *= copies;
  for (auto* array : {&large.samplePoint, &large.sampleNormal, &large.trialEpsilon}) repeat(*array, copies - 1);
  repeat(large.outcome, copies - 1);

  const auto repeatRows = [&](auto column, std::size_t width) {
    (large.*column).clear();
    for (std::size_t i = 0; i < grasps; ++i) appendRows(set.*column, i / copies, width, large.*column);
  };
  const std::size_t nJoints = set.jointNames.size();
  const auto neighbors = static_cast<std::size_t>(set.neighbors);
  for (const auto column : {&GraspSet::targetPoint, &GraspSet::approachDirection}) repeatRows(column, 3);
  for (const auto column : {&GraspSet::jointPosition, &GraspSet::preshapeJointPosition}) repeatRows(column, nJoints);
  for (const auto column : {&GraspSet::roll, &GraspSet::backoff, &GraspSet::criticalFriction, &GraspSet::loadMargin,
                            &GraspSet::robustness, &GraspSet::robustnessLower, &GraspSet::robustnessUpper}) {
    repeatRows(column, 1);
  }
  for (const auto column : {&GraspSet::epsilon, &GraspSet::epsilonLower, &GraspSet::epsilonUpper})
    repeatRows(column, 1);
  repeatRows(&GraspSet::handPose, 7);
  repeatRows(&GraspSet::approachClear, 1);
  repeatRows(&GraspSet::mapNeighbor, neighbors);
  repeatRows(&GraspSet::mapWeight, neighbors);
  repeatRows(&GraspSet::trial, 3);

  large.contactPosition.clear(), large.contactNormal.clear(), large.contactLink.clear();
  large.contactBegin = {0};
  for (std::size_t i = 0; i < grasps; ++i) {
    large.trial[3 * i] += static_cast<std::uint32_t>(i % copies * set.samples);
    for (std::size_t c = set.contactBegin[i / copies]; c < set.contactBegin[i / copies + 1]; ++c) {
      appendRows(set.contactPosition, c, 3, large.contactPosition);
      appendRows(set.contactNormal, c, 3, large.contactNormal);
      appendRows(set.contactLink, c, 1, large.contactLink);
    }
    large.contactBegin.push_back(static_cast<std::uint32_t>(large.contactLink.size()));
  }
  return large;
}

}  // namespace
}  // namespace handhold

int main(int argc, char** argv) {
  if (argc != 4) {
    std::cerr << "usage: repeat_grasps SET GRASPS DATABASE\n";
    return 2;
  }
  const handhold::GraspSet set = handhold::readGraspSet(argv[1]);
  handhold::Database(argv[3]).write(handhold::repeated(set, std::strtoul(argv[2], nullptr, 10)));
}
