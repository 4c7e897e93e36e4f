#include "simulate/contacts.h"

#include "core/random.h"
#include "simulate/contacts_reference.h"
#include "simulate/triangle_pairs.h"
#include "support/allocations.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Vector3d;
using testing::kContactDistance;
using testing::kPairNames;
using testing::PairKind;
using testing::randomPoint;
using testing::trianglePair;

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

void addContactCandidates(const Corners& object, const Corners& link, double contactDistance, bool twoSided,
                          std::vector<ContactCandidate>& candidates) {
  handhold::addContactCandidates(contactTriangle(object), contactTriangle(link), contactDistance, twoSided, candidates);
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

void expectEqual(const std::vector<ContactCandidate>& fast, const std::vector<ContactCandidate>& slow) {
  ASSERT_EQ(fast.size(), slow.size());
  for (std::size_t i = 0; i < slow.size(); ++i) {
    ASSERT_EQ(fast[i].position, slow[i].position);
    ASSERT_EQ(fast[i].normal, slow[i].normal);
    ASSERT_EQ(fast[i].gap, slow[i].gap);
    ASSERT_EQ(fast[i].facing, slow[i].facing);
  }
}

// What is ruled out early has no candidate: bit for bit what comes out when every pair of features is measured.
TEST(ContactCandidatesProperty, EqualTheReference) {
  constexpr int kSeeds = 20000;
  for (int kind = 0; kind < static_cast<int>(PairKind::count); ++kind) {
    std::size_t nCandidates = 0, nPairsWith = 0;
    for (int seed = 0; seed < kSeeds; ++seed) {
      SCOPED_TRACE(std::string(kPairNames[kind]) + " " + std::to_string(seed));
      const auto [a, b] = trianglePair(static_cast<PairKind>(kind), static_cast<std::uint64_t>(seed));
      std::vector<ContactCandidate> fast, slow;
      addContactCandidates(a, b, kContactDistance, seed % 2 == 1, fast);
      reference::addContactCandidates(a, b, kContactDistance, seed % 2 == 1, slow);
      ASSERT_NO_FATAL_FAILURE(expectEqual(fast, slow));
      nCandidates += slow.size();
      nPairsWith += !slow.empty();
    }
    EXPECT_GT(nPairsWith, kSeeds / 100) << kPairNames[kind];
    EXPECT_GT(nCandidates, nPairsWith) << kPairNames[kind];
  }
}

// What is said to be close is measured, nothing else: the candidates of each pair of features, taken alone, are
// together those of all.
TEST(ContactCandidatesProperty, AreThoseOfTheFeaturesSaidToBeClose) {
  constexpr int kSeeds = 1000;
  for (int kind = 0; kind < static_cast<int>(PairKind::count); ++kind) {
    for (int seed = 0; seed < kSeeds; ++seed) {
      SCOPED_TRACE(std::string(kPairNames[kind]) + " " + std::to_string(seed));
      const auto [a, b] = trianglePair(static_cast<PairKind>(kind), static_cast<std::uint64_t>(seed));
      const ContactTriangle object = contactTriangle(a), link = contactTriangle(b);
      std::vector<ContactCandidate> oneByOne, slow;
      for (std::size_t i = 0; i < reference::closestPairs(a, b).size(); ++i) {
        const std::size_t before = oneByOne.size();
        addContactCandidates(object, link, FeaturePairs{1} << i, kContactDistance, false, oneByOne);
        ASSERT_LE(oneByOne.size(), before + 1);
      }
      reference::addContactCandidates(a, b, kContactDistance, false, slow);
      ASSERT_NO_FATAL_FAILURE(expectEqual(oneByOne, slow));
    }
  }
}

/// Candidates of which many share a place, a gap or a direction, as where flat faces lie on a mesh's.
std::vector<ContactCandidate> crowdedCandidates(std::uint64_t seed) {
  const RandomStream stream(seed);
  const int n = static_cast<int>(80 * stream.uniform(0));
  std::vector<ContactCandidate> candidates;
  for (int i = 0; i < n; ++i) {
    const auto whole = [&](int k, int steps) { return std::floor(steps * stream.uniform(8 * i + k + 1)); };
    ContactCandidate c;
    c.position = 5e-4 * Vector3d(whole(0, 5), whole(1, 5), whole(2, 2) - 1);
    c.position.x() += whole(3, 2) * 4e-8 * stream.uniform(8 * i + 8);  // elsewhere in the same place
    c.normal = Vector3d::Unit(static_cast<int>(whole(4, 3)));
    c.gap = 1e-5 * whole(5, 3);
    c.facing = -0.5 - 0.1 * whole(6, 3);
    candidates.push_back(c);
  }
  return candidates;
}

// One scratch for all sets, of many sizes; and neither way depends on the order in which candidates were added.
TEST(SelectContactsProperty, EqualsTheReferenceInAnyOrder) {
  ContactScratch scratch;
  for (std::uint64_t seed = 0; seed < 5000; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::vector<ContactCandidate> candidates = crowdedCandidates(seed);
    std::vector<Contact> fast, backwards, slow;
    selectContacts(candidates, 4, 1e-3, 3, scratch, fast);
    std::reverse(candidates.begin(), candidates.end());
    selectContacts(candidates, 4, 1e-3, 3, scratch, backwards);
    reference::selectContacts(candidates, 4, 1e-3, 3, slow);
    ASSERT_EQ(fast.size(), slow.size());
    ASSERT_EQ(backwards.size(), slow.size());
    for (std::size_t i = 0; i < slow.size(); ++i) {
      ASSERT_EQ(fast[i].position, slow[i].position);
      ASSERT_EQ(fast[i].normal, slow[i].normal);
      ASSERT_EQ(fast[i].link, slow[i].link);
      ASSERT_EQ(backwards[i].position, slow[i].position);
      ASSERT_EQ(backwards[i].normal, slow[i].normal);
    }
  }
}

// Once it has seen the sizes, a worker's scratch takes nothing from the heap.
TEST(Contacts, SecondPassAllocatesNothing) {
  if (!testing::countsAllocations()) GTEST_SKIP() << "a sanitizer has its own malloc";
  ContactScratch scratch;
  std::vector<ContactCandidate> candidates;
  std::vector<Contact> contacts;
  for (int pass = 0; pass < 2; ++pass) {
    const long before = testing::allocations();
    for (int seed = 0; seed < 100; ++seed) {
      candidates.clear();
      contacts.clear();
      for (int i = 0; i < 40; ++i) {
        const auto [a, b] = trianglePair(PairKind::flush, static_cast<std::uint64_t>(40 * seed + i));
        addContactCandidates(a, b, kContactDistance, false, candidates);
      }
      selectContacts(candidates, 4, 1e-3, 0, scratch, contacts);
    }
    if (pass == 1) {
      EXPECT_EQ(testing::allocations() - before, 0);
    } else {
      EXPECT_GT(testing::allocations() - before, 0);
    }
  }
}

TEST(SelectContacts, TakesTheClosestThenTheFarthest) {
  std::vector<ContactCandidate> candidates;
  for (int i = 0; i <= 10; ++i) {
    candidates.push_back({Vector3d(0.01 * i, 0, 0), Vector3d::UnitZ(), i == 2 ? 0.0 : 1e-5, -1});
  }
  std::vector<Contact> contacts;
  ContactScratch scratch;
  selectContacts(candidates, 3, 1e-3, 7, scratch, contacts);
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
  ContactScratch scratch;
  selectContacts(candidates, 4, 1e-3, 0, scratch, contacts);
  EXPECT_EQ(contacts.size(), 1U);
}

// At a sharp edge both faces offer the same point: the normal that opposes the link's most is the contact's.
TEST(SelectContacts, PrefersTheOpposedNormalAtOnePlace) {
  std::vector<ContactCandidate> candidates = {{Vector3d::Zero(), Vector3d::UnitX(), 0, -0.1},
                                              {Vector3d::Zero(), Vector3d::UnitZ(), 0, -0.9}};
  std::vector<Contact> contacts;
  ContactScratch scratch;
  selectContacts(candidates, 4, 1e-3, 0, scratch, contacts);
  ASSERT_EQ(contacts.size(), 1U);
  EXPECT_EQ(contacts[0].normal, -Vector3d::UnitZ());
}

TEST(SelectContacts, GivesNothingForNothing) {
  std::vector<ContactCandidate> candidates;
  std::vector<Contact> contacts;
  ContactScratch scratch;
  selectContacts(candidates, 4, 1e-3, 0, scratch, contacts);
  EXPECT_TRUE(contacts.empty());
}

}  // namespace
}  // namespace handhold
