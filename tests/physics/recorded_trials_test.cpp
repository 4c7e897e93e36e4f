#include "physics/recorded_trials.h"

#include "build/import_set.h"
#include "store/synthetic_set.h"

#include <algorithm>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

TEST(DrawGrasps, DependsOnNameAndSeedAlone) {
  GraspSet set = syntheticSet({.grasps = 40}, 1);
  const DrawnGrasps drawn = drawGrasps(set, 30, 50, 7);
  EXPECT_EQ(drawGrasps(set, 30, 50, 7).rows, drawn.rows);
  EXPECT_EQ(drawGrasps(set, 30, 50, 7).trials, drawn.trials);
  EXPECT_NE(drawGrasps(set, 30, 50, 8).rows, drawn.rows);
  // Fewer are the first of more.
  const DrawnGrasps fewer = drawGrasps(set, 5, 6, 7);
  EXPECT_TRUE(std::equal(fewer.rows.begin(), fewer.rows.end(), drawn.rows.begin()));
  EXPECT_TRUE(std::equal(fewer.trials.begin(), fewer.trials.end(), drawn.trials.begin()));
  set.object += "_2";
  EXPECT_NE(drawGrasps(set, 30, 50, 7).trials, drawn.trials);
}

TEST(DrawGrasps, RowsAreDifferentAndTrialsAreOfTheSet) {
  GraspSet set = syntheticSet({.grasps = 17}, 1);
  const DrawnGrasps drawn = drawGrasps(set, 100, 200, 1);
  EXPECT_EQ(std::set<std::size_t>(drawn.rows.begin(), drawn.rows.end()).size(), 17u);
  EXPECT_EQ(*std::max_element(drawn.rows.begin(), drawn.rows.end()), 16u);
  ASSERT_EQ(drawn.trials.size(), 200u);
  EXPECT_LT(*std::max_element(drawn.trials.begin(), drawn.trials.end()), set.trialCount());
  EXPECT_GT(*std::max_element(drawn.trials.begin(), drawn.trials.end()), set.trialCount() / 2);
  set.policy = kImportedPolicy;
  EXPECT_THAT(drawGrasps(set, 3, 10, 1).trials, testing::IsEmpty());
}

}  // namespace
}  // namespace handhold
