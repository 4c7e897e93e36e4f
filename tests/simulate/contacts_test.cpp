#include "simulate/contacts.h"

#include "core/random.h"

#include <algorithm>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Vector3d;

Vector3d randomPoint(const RandomStream& stream, int i) {
  return {stream.uniform(3 * i) - 0.5, stream.uniform(3 * i + 1) - 0.5, stream.uniform(3 * i + 2) - 0.5};
}

// Against a fine sampling of the triangle: no sampled point is closer.
TEST(ClosestPoint, IsNoFartherThanAnySampledPoint) {
  for (int seed = 0; seed < 300; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const RandomStream stream(seed);
    const Corners t = {randomPoint(stream, 0), randomPoint(stream, 1), randomPoint(stream, 2)};
    const Vector3d p = 2 * randomPoint(stream, 3);
    const double found = (closestPointOnTriangle(p, t) - p).norm();
    double sampled = 1e9;
    constexpr int kSteps = 40;
    for (int i = 0; i <= kSteps; ++i) {
      for (int j = 0; i + j <= kSteps; ++j) {
        const double u = static_cast<double>(i) / kSteps, v = static_cast<double>(j) / kSteps;
        sampled = std::min(sampled, ((1 - u - v) * t[0] + u * t[1] + v * t[2] - p).norm());
      }
    }
    EXPECT_LE(found, sampled + 1e-12);
    EXPECT_GE(found, sampled - 0.05);  // the sampling's own coarseness: edges up to 1.7 / 40
  }
}

Corners square(double size, double z, bool up) {
  const double s = size / 2;
  Corners t = {Vector3d(-s, -s, z), Vector3d(s, -s, z), Vector3d(s, s, z)};
  if (!up) std::swap(t[1], t[2]);
  return t;
}

// A small face flush on a large one: the corners of the overlap are found, on the object, with the object's normal.
TEST(ContactCandidates, HoldTheCornersOfAFlushOverlap) {
  std::vector<ContactCandidate> candidates;
  addContactCandidates(square(0.1, 0, true), square(0.02, 5e-5, false), 1e-4, false, candidates);
  for (const Vector3d& corner : {Vector3d(-0.01, -0.01, 0), Vector3d(0.01, -0.01, 0), Vector3d(0.01, 0.01, 0)}) {
    EXPECT_TRUE(std::any_of(candidates.begin(), candidates.end(),
                            [&](const auto& c) { return (c.position - corner).norm() < 1e-12; }));
  }
  for (const ContactCandidate& c : candidates) {
    EXPECT_NEAR(c.position.z(), 0, 1e-15);
    EXPECT_NEAR(c.gap, 5e-5, 1e-12);
    EXPECT_EQ(c.normal, Vector3d::UnitZ());
  }
}

TEST(ContactCandidates, AreNoneBeyondTheContactDistance) {
  std::vector<ContactCandidate> candidates;
  addContactCandidates(square(0.1, 0, true), square(0.02, 1.01e-4, false), 1e-4, false, candidates);
  EXPECT_TRUE(candidates.empty());
}

// The back of a thin wall lies within the contact distance but faces the same way as the link: no contact.
TEST(ContactCandidates, NeedSurfacesThatFaceEachOther) {
  std::vector<ContactCandidate> candidates;
  addContactCandidates(square(0.1, 0, false), square(0.02, 5e-5, false), 1e-4, false, candidates);
  EXPECT_TRUE(candidates.empty());
  addContactCandidates(square(0.1, 0, false), square(0.02, 5e-5, false), 1e-4, true, candidates);
  ASSERT_FALSE(candidates.empty());  // an open surface is touched from both sides
  EXPECT_EQ(candidates[0].normal, Vector3d::UnitZ());
}

// Two crossed edges touch at one point, which only the edge pairs know.
TEST(ContactCandidates, KnowCrossedEdges) {
  const Corners ridge = {Vector3d(-1, 0, 0), Vector3d(1, 0, 0), Vector3d(0, 1, -1)};
  const Corners blade = {Vector3d(0, -1, 5e-5), Vector3d(1, 0, 1), Vector3d(0, 1, 5e-5)};
  std::vector<ContactCandidate> candidates;
  addContactCandidates(ridge, blade, 1e-4, true, candidates);
  ASSERT_FALSE(candidates.empty());
  EXPECT_LT(candidates[0].position.norm(), 1e-4);
}

TEST(SelectContacts, TakesTheClosestThenTheFarthest) {
  std::vector<ContactCandidate> candidates;
  for (int i = 0; i <= 10; ++i) {
    candidates.push_back({Vector3d(0.01 * i, 0, 0), Vector3d::UnitZ(), i == 2 ? 0.0 : 1e-5, -1});
  }
  std::vector<Contact> contacts;
  selectContacts(candidates, 3, 1e-3, 7, contacts);
  ASSERT_EQ(contacts.size(), 3U);
  EXPECT_NEAR(contacts[0].position.x(), 0.02, 1e-15);  // the smallest gap
  EXPECT_NEAR(contacts[1].position.x(), 0.10, 1e-15);  // 80 mm from it
  EXPECT_NEAR(contacts[2].position.x(), 0.06, 1e-15);  // 40 mm from both
  for (const Contact& contact : contacts) {
    EXPECT_EQ(contact.normal, -Vector3d::UnitZ());  // into the object
    EXPECT_EQ(contact.link, 7);
  }
}

TEST(SelectContacts, LeavesOutWhatIsTooClose) {
  std::vector<ContactCandidate> candidates;
  for (int i = 0; i < 5; ++i) candidates.push_back({Vector3d(2e-4 * i, 0, 0), Vector3d::UnitZ(), 0, -1});
  std::vector<Contact> contacts;
  selectContacts(candidates, 4, 1e-3, 0, contacts);
  EXPECT_EQ(contacts.size(), 1U);
}

// At a sharp edge both faces offer the same point: the normal that opposes the link's most is the contact's.
TEST(SelectContacts, PrefersTheOpposedNormalAtOnePlace) {
  std::vector<ContactCandidate> candidates = {{Vector3d::Zero(), Vector3d::UnitX(), 0, -0.1},
                                              {Vector3d::Zero(), Vector3d::UnitZ(), 0, -0.9}};
  std::vector<Contact> contacts;
  selectContacts(candidates, 4, 1e-3, 0, contacts);
  ASSERT_EQ(contacts.size(), 1U);
  EXPECT_EQ(contacts[0].normal, -Vector3d::UnitZ());
}

TEST(SelectContacts, GivesNothingForNothing) {
  std::vector<ContactCandidate> candidates;
  std::vector<Contact> contacts;
  selectContacts(candidates, 4, 1e-3, 0, contacts);
  EXPECT_TRUE(contacts.empty());
}

}  // namespace
}  // namespace handhold
