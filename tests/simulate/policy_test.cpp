// The reference against brute force, and its properties on shipped hands and objects.
#include "core/random.h"
#include "sample/surface_samples.h"
#include "simulate/collision_models.h"
#include "simulate/grasp_policy.h"
#include "support/brute_force.h"
#include "support/toy_hands.h"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using namespace handhold::testing;

const ReferenceSettings kSettings;

/// A rotation from four numbers of a stream.
Eigen::Quaterniond randomRotation(const RandomStream& stream) {
  Eigen::Quaterniond q(stream.uniform(0) - 0.5, stream.uniform(1) - 0.5, stream.uniform(2) - 0.5,
                       stream.uniform(3) - 0.5);
  return q.normalized();
}

/// Does any of the links, at these joints and this hand pose, cross or lie inside the object?
bool anyTouches(const Hand& hand, const ObjectModel& object, const Isometry3d& X_OH, const Eigen::VectorXd& q,
                const std::vector<bool>& which) {
  const std::vector<Isometry3d> X_HL = forwardKinematics(hand, q);
  for (std::size_t i = 0; i < hand.links.size(); ++i) {
    if (!which[i] || hand.links[i].mesh.triangles.empty()) continue;
    const Isometry3d X_OL = X_OH * X_HL[i];
    if (surfacesCross(object.mesh, hand.links[i].mesh, X_OL)) return true;
    if (windingNumber(X_OL * hand.links[i].mesh.vertices[0], object.mesh) > 0.5) return true;
  }
  return false;
}

/// The definition of the back-off, checked by every triangle pair at every 0.2 mm.
void checkBackoff(const Hand& hand, const ObjectModel& object, const GraspCandidate& candidate,
                  const GraspTrial& trial) {
  const Eigen::VectorXd& q = hand.preshapes[candidate.preshape].jointPosition;
  const std::vector<bool> all(hand.links.size(), true);
  const auto touchesAt = [&](double t) {
    Isometry3d X_OH = trial.X_OH;
    X_OH.translation() += -trial.centering - (t - trial.backoff) * candidate.approach;
    return anyTouches(hand, object, X_OH, q, all);
  };
  EXPECT_FALSE(touchesAt(trial.backoff));
  if (trial.backoff <= kSettings.startBackoff) return;
  EXPECT_TRUE(touchesAt(trial.backoff - 2 * kSettings.linearTolerance));
  for (double t = kSettings.startBackoff; t < trial.backoff - kSettings.linearTolerance; t += 2e-4) {
    EXPECT_TRUE(touchesAt(t)) << "free already at " << t << ", back-off " << trial.backoff;
  }
}

/// The definition of a closing step: free at its stop and everywhere before it, touching just after.
void checkStop(const Hand& hand, const ObjectModel& object, const Isometry3d& X_OH, const ClosingStop& stop,
               const std::vector<bool>& moves, Eigen::VectorXd& q, bool coupled) {
  const double start = q[stop.joint], tolerance = kSettings.angularTolerance;
  const auto touchesAt = [&](double position) {
    q[stop.joint] = position;
    if (coupled) {
      for (const int f : followersOf(hand, stop.joint)) q[f] = hand.joints[f].mimicMultiplier * position;
    }
    return anyTouches(hand, object, X_OH, q, moves);
  };
  const int fine = 60;
  for (int i = 0; i <= fine; ++i) {
    const double position = start + (stop.position - start) * i / fine;
    EXPECT_FALSE(touchesAt(position)) << "touches already at " << position << " of " << stop.position;
  }
  if (stop.links.empty()) {
    EXPECT_EQ(stop.position, hand.joints[stop.joint].upper);
  } else {
    EXPECT_TRUE(touchesAt(stop.position + 2 * tolerance));
  }
  touchesAt(stop.position);
}

// Convex objects have no window that the steps could miss: the definition must hold to the tolerance, always.
TEST(ReferenceAgainstBruteForce, ConvexObjectsAndFingers) {
  const Hand hand = makeFingers(3);
  for (int seed = 0; seed < 12; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const RandomStream stream(seed);
    const Vector3d size(0.02 + 0.06 * stream.uniform(10), 0.02 + 0.06 * stream.uniform(11),
                        0.02 + 0.06 * stream.uniform(12));
    const ObjectModel box = boxObject(size, Isometry3d(randomRotation(stream)));
    const Vector3d onFace = randomRotation(stream) * Vector3d(0.3 * size.x(), -0.2 * size.y(), size.z() / 2);
    const GraspCandidate candidate{onFace, -(randomRotation(stream) * Vector3d::UnitZ()), 6 * stream.uniform(13), 0};
    GraspTrial trial;
    makeReferencePolicy(hand, box, PolicyKind::surfaceNormal)->run(candidate, trial);
    checkBackoff(hand, box, candidate, trial);
    Eigen::VectorXd q = hand.preshapes[0].jointPosition;
    int last = -1;
    for (const ClosingStop& stop : trial.stops) {
      const bool breakaway = last >= 0 && stop.joint == last + 1 && hand.joints[stop.joint].mimicOf == last;
      checkStop(hand, box, trial.X_OH, stop, linksMovedBy(hand, stop.joint, !breakaway), q, !breakaway);
      last = stop.joint;
    }
    EXPECT_NEAR((q - trial.jointPosition).norm(), 0, 1e-12);
  }
}

// A non-convex object (an L): windows thinner than a step may be missed, and must stay rare.
TEST(ReferenceAgainstBruteForce, BackoffOnANonConvexObject) {
  TriangleMesh mesh;
  append(mesh, boxMesh({0.1, 0.03, 0.03}), Isometry3d::Identity());
  append(mesh, boxMesh({0.03, 0.03, 0.08}), Isometry3d(Eigen::Translation3d(0.034, 0.002, 0.055)));
  const ObjectModel ell = makeObject(std::move(mesh));
  const RayScene scene(ell.mesh);
  const SurfaceSamples samples = sampleSurfaceCount(ell, scene, 10, "ell");
  const Hand hand = makeFingers(2);
  const auto policy = makeReferencePolicy(hand, ell, PolicyKind::surfaceNormal);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    SCOPED_TRACE("sample " + std::to_string(i));
    const GraspCandidate candidate{samples.point[i].cast<double>(), samples.approach[i].cast<double>().normalized(),
                                   0.7 * static_cast<double>(i), 0};
    GraspTrial trial;
    policy->run(candidate, trial);
    checkBackoff(hand, ell, candidate, trial);
  }
}

// FCL's own error, measured: a tilted box comes down on a plate; it touches when its lowest vertex is at the surface.
TEST(ThirdParty, TriangleTestsAreExactToANanometre) {
  const ObjectModel plate = boxObject({1, 1, 0.02}, Isometry3d(Eigen::Translation3d(0, 0, -0.01)));
  Hand hand;
  addBoxLink(hand, "probe", -1, -1, {0.02, 0.03, 0.04}, {0, 0, 0});
  const CollisionModels models(hand, plate);
  for (int seed = 0; seed < 200; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const RandomStream stream(seed);
    Isometry3d X(randomRotation(stream));
    double lowest = 1;
    for (const Vector3d& v : hand.links[0].mesh.vertices) lowest = std::min(lowest, (X * v).z());
    X.translation() = Vector3d(0.3 * stream.uniform(5), 0.3 * stream.uniform(6), -lowest + 1e-9);
    EXPECT_FALSE(models.surfacesTouch(0, X));
    X.translation().z() -= 2e-9;
    EXPECT_TRUE(models.surfacesTouch(0, X));
  }
}

/// The shipped Barrett hand on the shipped mug, a few dozen trials.
class ShippedTrials : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    hand_ = new Hand(loadHand(HANDHOLD_SOURCE_DIR "/hands/barrett"));
    object_ = new ObjectModel(loadObject(HANDHOLD_SOURCE_DIR "/meshes/mug.obj", {1, true, "m"}));
    const SurfaceSamples samples = sampleSurfaceCount(*object_, RayScene(object_->mesh), 24, "mug");
    for (std::size_t i = 0; i < samples.size(); ++i) {
      candidates_.push_back({samples.point[i].cast<double>(), samples.approach[i].cast<double>().normalized(),
                             2 * std::numbers::pi * static_cast<double>(i % 5) / 5,
                             static_cast<int>(i % hand_->preshapes.size())});
    }
  }
  static void TearDownTestSuite() {
    delete hand_;
    delete object_;
  }

  static inline Hand* hand_ = nullptr;
  static inline ObjectModel* object_ = nullptr;
  static inline std::vector<GraspCandidate> candidates_;
};

// What is stored as a contact lies on the object, within the contact distance of the link, its normal is the surface's.
TEST_F(ShippedTrials, ContactsAreOnBothSurfaces) {
  const auto policy = makeReferencePolicy(*hand_, *object_, PolicyKind::surfaceNormal);
  std::size_t contacts = 0;
  for (const GraspCandidate& candidate : candidates_) {
    GraspTrial trial;
    policy->run(candidate, trial);
    const std::vector<Isometry3d> X_HL = forwardKinematics(*hand_, trial.jointPosition);
    for (const Contact& contact : trial.contacts) {
      ++contacts;
      EXPECT_LT(distanceTo(contact.position, object_->mesh), 1e-9);
      const Vector3d p_L = (trial.X_OH * X_HL[contact.link]).inverse() * contact.position;
      EXPECT_LE(distanceTo(p_L, hand_->links[contact.link].mesh), kSettings.contactDistance + 1e-9);
      EXPECT_NEAR(contact.normal.norm(), 1, 1e-12);
      // The normal belongs to a triangle at that point.
      double best = 2;
      for (std::size_t t = 0; t < object_->mesh.triangles.size(); ++t) {
        const Corners corners = object_->mesh.corners(t);
        if ((closestPointOnTriangle(contact.position, corners) - contact.position).norm() > 1e-9) continue;
        best = std::min(best, (object_->mesh.normal(t) + contact.normal).norm());
      }
      EXPECT_LT(best, 1e-9);
    }
  }
  EXPECT_GT(contacts, 50U);
}

// A link that stopped a joint is in contact in the end, and no link is inside the object.
TEST_F(ShippedTrials, StoppingLinksTouchAndNoneIsInside) {
  const auto policy = makeReferencePolicy(*hand_, *object_, PolicyKind::surfaceNormal);
  const CollisionModels models(*hand_, *object_);
  for (const GraspCandidate& candidate : candidates_) {
    GraspTrial trial;
    policy->run(candidate, trial);
    const std::vector<Isometry3d> X_HL = forwardKinematics(*hand_, trial.jointPosition);
    for (std::size_t i = 0; i < hand_->links.size(); ++i) {
      EXPECT_FALSE(models.surfacesTouch(static_cast<int>(i), trial.X_OH * X_HL[i])) << hand_->links[i].name;
      EXPECT_FALSE(models.isContained(static_cast<int>(i), trial.X_OH * X_HL[i])) << hand_->links[i].name;
    }
    for (const ClosingStop& stop : trial.stops) {
      if (stop.links.empty()) continue;
      const bool inContact = std::any_of(trial.contacts.begin(), trial.contacts.end(), [&](const Contact& contact) {
        return std::find(stop.links.begin(), stop.links.end(), contact.link) != stop.links.end();
      });
      EXPECT_TRUE(inContact) << hand_->joints[stop.joint].name;
    }
  }
}

TEST_F(ShippedTrials, AreEqualOnRepeatAndOnAClone) {
  const auto policy = makeReferencePolicy(*hand_, *object_, PolicyKind::surfaceNormal);
  const auto clone = policy->clone();
  GraspTrial first, second;
  for (std::size_t i = 0; i < candidates_.size(); ++i) {
    policy->run(candidates_[i], first);
    clone->run(candidates_[candidates_.size() - 1 - i], second);  // another history
    clone->run(candidates_[i], second);
    EXPECT_TRUE(first.X_OH.matrix() == second.X_OH.matrix());
    EXPECT_TRUE(first.jointPosition == second.jointPosition);
    ASSERT_EQ(first.contacts.size(), second.contacts.size());
    for (std::size_t c = 0; c < first.contacts.size(); ++c) {
      EXPECT_TRUE(first.contacts[c].position == second.contacts[c].position);
    }
  }
}

// Moving object and candidate together moves the grasp with them. The roll's reference direction turns too, so the
// object is turned about z only, which keeps it.
TEST_F(ShippedTrials, MoveWithTheObject) {
  Isometry3d X = Isometry3d::Identity();
  X.rotate(Eigen::AngleAxisd(1.1, Vector3d::UnitZ()));
  X.pretranslate(Vector3d(0.3, -0.2, 0.1));
  TriangleMesh movedMesh;
  append(movedMesh, object_->mesh, X);
  const ObjectModel movedObject = makeObject(std::move(movedMesh));
  const auto policy = makeReferencePolicy(*hand_, *object_, PolicyKind::surfaceNormal);
  const auto movedPolicy = makeReferencePolicy(*hand_, movedObject, PolicyKind::surfaceNormal);
  int compared = 0;
  for (const GraspCandidate& candidate : candidates_) {
    if (std::abs(candidate.approach.z()) >= 0.9) continue;  // the reference direction is x there
    GraspTrial here, there;
    policy->run(candidate, here);
    movedPolicy->run({X * candidate.targetPoint, X.linear() * candidate.approach, candidate.roll, candidate.preshape},
                     there);
    // Coordinates are rounded to floats anew: a few 1e-8 m, far below the tolerance of a stop.
    EXPECT_NEAR(here.backoff, there.backoff, 2 * kSettings.linearTolerance);
    EXPECT_LT((here.jointPosition - there.jointPosition).cwiseAbs().maxCoeff(), 2e-3);
    ++compared;
  }
  EXPECT_GE(compared, 8);
}

}  // namespace
}  // namespace handhold
