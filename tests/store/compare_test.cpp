#include "store/compare.h"

#include "store/database.h"
#include "store/set_size.h"
#include "store/synthetic_set.h"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

template <class Value>
Pair<Value> entryOf(const std::vector<Pair<Value>>& list, const std::string& name) {
  for (const auto& entry : list) {
    if (entry.name == name) return entry;
  }
  ADD_FAILURE() << "no entry " << name;
  return {};
}

TEST(CompareSets, AnEqualSetHasNoDifference) {
  GraspSet a = syntheticSet(), b = a;
  b.setVersion = 7;
  b.generator = "another program";
  b.seconds["sample"] = 99;
  const SetComparison c = compareSets(a, b);
  EXPECT_THAT(c.datasets, IsEmpty());
  EXPECT_EQ(c.common, a.graspCount());
  EXPECT_EQ(c.onlyA + c.onlyB + c.epsilonChanged + c.poseChanged, 0U);
  for (const auto& count : c.counts) EXPECT_EQ(count.a, count.b) << count.name;
  ASSERT_EQ(c.inputs.size(), 1U);
  EXPECT_EQ(c.inputs[0].name, "generator");
}

TEST(Differences, EveryDatasetThatDiffersIsNamedToTheLastBit) {
  GraspSet a = syntheticSet();
  a.contactNormal[5] = 0.0F;
  GraspSet b = a;
  b.epsilon[3] = std::nextafter(b.epsilon[3], 0);
  b.contactNormal[5] = -0.0F;
  b.friction = 0.5;
  b.objectMesh.vertices[0].x() = 0.5;
  b.trialEpsilon[1] = -b.trialEpsilon[1];  // NaN all the same
  EXPECT_THAT(differences(a, b), ElementsAre("/@friction", "/object/vertices", "/grasps/epsilon", "/contacts/normal"));
}

TEST(CompareSets, InputsAreNamedByKey) {
  GraspSet a = syntheticSet();
  a.job =
      "catalog:\n  - {name: cup, mesh: c.stl}\n  - {name: mug, mesh: m.stl, friction: 0.3}\nsampling: {samples: "
      "12}\nseed: 1\n";
  GraspSet b = a;
  b.job =
      "catalog:\n  - {name: bowl, mesh: b.stl}\n  - {name: mug, mesh: m.stl, friction: 0.4}\nsampling: {samples: 12}\n";
  b.config = "urdf: synthetic.urdf\nclosing:\n  - {joint: finger_1, direction: 1}\n";
  b.urdf += "<!-- more -->\n";
  b.objectMesh.vertices[2].x() = 0.001;
  b.linkMeshes[2].triangles.pop_back();
  b.friction = 0.5;
  b.methodVersion = 9;
  const SetComparison c = compareSets(a, b);
  EXPECT_EQ(entryOf(c.inputs, "job catalog[mug].friction").a, "0.3");
  EXPECT_EQ(entryOf(c.inputs, "job catalog[mug].friction").b, "0.4");
  EXPECT_EQ(entryOf(c.inputs, "job seed").b, "(not given)");
  EXPECT_EQ(entryOf(c.inputs, "job catalog").a, "other objects");
  EXPECT_EQ(entryOf(c.inputs, "hand.yaml closing[finger_1].direction").b, "1");
  EXPECT_THAT(entryOf(c.inputs, "urdf").b, HasSubstr("other from line 2"));
  EXPECT_EQ(entryOf(c.inputs, "friction").b, "0.5");
  EXPECT_EQ(entryOf(c.inputs, "method_version").b, "9");
  EXPECT_THAT(entryOf(c.inputs, "object mesh").b, HasSubstr("1 moved, by up to 1 mm"));
  EXPECT_EQ(entryOf(c.inputs, "mesh of link finger/1").a, "4 vertices, 4 triangles");
  EXPECT_THAT(entryOf(c.inputs, "mesh of link finger/1").b, testing::StartsWith("4 vertices, 3 triangles"));
}

// A comment changes the text and nothing that it says.
TEST(CompareSets, TextsThatSayTheSameDifferInALine) {
  const GraspSet a = syntheticSet();
  GraspSet b = a;
  b.job += "# a comment\n";
  const SetComparison c = compareSets(a, b);
  EXPECT_THAT(c.datasets, ElementsAre("/@job"));
  EXPECT_EQ(entryOf(c.inputs, "job").b, "2 lines, other from line 2");
}

TEST(CompareSets, CountsAndQuality) {
  const GraspSet a = syntheticSet();
  GraspSet b = a;
  b.outcome[1] = b.outcome[2] = 1;  // were 3
  for (double& epsilon : b.epsilon) epsilon *= 2;
  const SetComparison c = compareSets(a, b);
  EXPECT_EQ(entryOf(c.counts, "not_force_closed").a, 0U);
  EXPECT_EQ(entryOf(c.counts, "not_force_closed").b, 2U);
  EXPECT_EQ(entryOf(c.counts, "blocked_centering").b + 2, entryOf(c.counts, "blocked_centering").a);
  EXPECT_EQ(entryOf(c.counts, "grasps").a, a.graspCount());
  EXPECT_EQ(entryOf(c.quality, "best_epsilon").a, a.epsilon.front());
  EXPECT_EQ(entryOf(c.quality, "best_epsilon").b, 2 * a.epsilon.front());
  EXPECT_EQ(entryOf(c.quality, "median_epsilon").a, a.epsilon[8]);  // of 17, the ninth
  EXPECT_EQ(entryOf(c.quality, "p90_epsilon").a, a.epsilon[1]);     // 15.3 of 17, the 16th from below
  EXPECT_NEAR(entryOf(c.quality, "share_force_closed").a, 17.0 / 96, 1e-12);
  EXPECT_EQ(c.epsilonChanged, a.graspCount());
  EXPECT_DOUBLE_EQ(c.largestEpsilonChange, a.epsilon.front());
}

TEST(CompareSets, AGraspIsFoundAgainWhereverItStands) {
  const GraspSet a = syntheticSet();
  GraspSet b = a;
  std::swap(b.trial[0], b.trial[3]);  // another place in the table
  b.targetPoint[3 * 4] += 1;          // another target
  b.handPose[7 * 2] += 0.003;
  b.handPose[7 * 5 + 5] = 0.8;  // 2 asin(0.6) becomes 2 asin(0.8) about z
  b.handPose[7 * 5 + 6] = 0.6;
  const SetComparison c = compareSets(a, b);
  EXPECT_EQ(c.common, a.graspCount() - 1);
  EXPECT_EQ(c.onlyA, 1U);
  EXPECT_EQ(c.onlyB, 1U);
  EXPECT_EQ(c.poseChanged, 2U);
  EXPECT_NEAR(c.largestShift, 0.003, 1e-12);
  EXPECT_NEAR(c.largestTurn, 2 * (std::asin(0.8) - std::asin(0.6)), 1e-9);
}

TEST(FirstGraspDifference, NamesDatasetAndBothValues) {
  const GraspSet a = syntheticSet();
  EXPECT_FALSE(firstGraspDifference(a, 3, a, 3));
  GraspSet b = a;
  const std::size_t contact = b.contactBegin[3];
  b.contactPosition[3 * contact + 1] = 0.25F;
  const auto inContact = firstGraspDifference(a, 3, b, 3);
  ASSERT_TRUE(inContact);
  EXPECT_EQ(inContact->dataset, "/contacts/position");
  EXPECT_EQ(inContact->b, "0.25");
  EXPECT_FALSE(firstGraspDifference(a, 2, b, 2));
  b.jointPosition[3 * 3 + 2] = 7.5F;  // the first in the file's order
  EXPECT_EQ(firstGraspDifference(a, 3, b, 3)->dataset, "/grasps/joint_position");
  b.mapWeight[5 * 6] = 0.5F;
  EXPECT_EQ(firstGraspDifference(a, 6, b, 6)->dataset, "/distance_map/weight");
  EXPECT_EQ(firstGraspDifference(a, 0, b, 1)->dataset, "/grasps/contact_begin");  // 2 contacts and 3
}

// The parts add up to the file, for sets of other sizes too.
TEST(SetSizes, GrowWithSamplesTrialsAndGrasps) {
  const TestFolder folder;
  const Database database(folder.path());
  const auto sizeAndBytes = [&](const SyntheticSizes& sizes) {
    const std::filesystem::path path = database.write(syntheticSet(sizes));
    const std::size_t bytes = std::filesystem::file_size(path);
    return std::pair(sizeOf(readGraspSet(path), bytes), static_cast<double>(bytes));
  };
  const auto [small, smallBytes] = sizeAndBytes({.samples = 100, .rolls = 4, .preshapes = 2, .grasps = 200});
  const auto [large, largeBytes] = sizeAndBytes({.samples = 400, .rolls = 4, .preshapes = 2, .grasps = 1600});
  EXPECT_EQ(small.perTrial, 5);
  const double estimated = small.fixed + 400 * small.perSample + 3200 * small.perTrial + 1600 * small.perGrasp;
  EXPECT_NEAR(estimated / largeBytes, 1, 0.02);
  EXPECT_NEAR(large.perGrasp, small.perGrasp, 1);
  EXPECT_LT(small.fixed, smallBytes);
}

}  // namespace
}  // namespace handhold
