// The fast policy against the reference with fine steps, and what it promises: equal trials whoever runs them, contacts
// on both surfaces.
#include "simulate/fast_policy.h"

#include "core/error.h"
#include "core/random.h"
#include "mesh/primitives.h"
#include "sample/surface_samples.h"
#include "support/brute_force.h"
#include "support/sanitized.h"
#include "support/toy_hands.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <map>
#include <memory>
#include <numbers>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>
#include <hwy/targets.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using namespace handhold::testing;

constexpr double kBackoffTolerance = 1e-5;  // m
constexpr double kSlideTolerance =
    5e-5;  // m; a tip that grazes what it left turns 2 um of back-off into ten times that
constexpr double kAngleTolerance = 5e-4;    // rad
constexpr double kAgreeing = 0.97;          // of the trials; windows thinner than a step are missed
constexpr double kAgreeingContacts = 0.85;  // how many there are depends on micrometres

constexpr std::uint64_t kSeed = 1;
constexpr std::size_t kTrials = 12;  // of a hand and an object

struct FieldedHand {
  Hand hand;
  std::shared_ptr<const HandFields> fields;

  explicit FieldedHand(Hand h, int threads = 1)
      : hand(std::move(h)), fields(makeHandFields(hand, nullptr, JobSystem(threads))) {}
};

/// Loaded once for all tests, as their fields take a while.
const FieldedHand& shippedHand(const std::string& folder) {
  static std::map<std::string, std::unique_ptr<const FieldedHand>> loaded;
  auto& hand = loaded[folder];
  if (hand == nullptr) hand = std::make_unique<const FieldedHand>(loadHand(HANDHOLD_SOURCE_DIR "/" + folder));
  return *hand;
}

const ObjectModel& shippedObject(const std::string& file) {
  static std::map<std::string, std::unique_ptr<const ObjectModel>> loaded;
  auto& object = loaded[file];
  if (object == nullptr)
    object = std::make_unique<const ObjectModel>(loadObject(HANDHOLD_SOURCE_DIR "/meshes/" + file, {1, true, "m"}));
  return *object;
}

/// Samples of the object's surface with random rolls and preshapes.
std::vector<GraspCandidate> candidatesOn(const ObjectModel& object, const Hand& hand, std::size_t count,
                                         std::uint64_t seed) {
  const SurfaceSamples samples = sampleSurfaceCount(object, RayScene(object.mesh), count, "object");
  std::vector<GraspCandidate> candidates;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const RandomStream stream = RandomStream(seed).child(i);
    candidates.push_back({samples.point[i].cast<double>(), samples.approach[i].cast<double>().normalized(),
                          2 * std::numbers::pi * stream.uniform(0),
                          static_cast<int>(stream.bits(1) % hand.preshapes.size())});
  }
  return candidates;
}

ReferenceSettings fineSettings() {
  ReferenceSettings settings;
  settings.linearStep = 5e-4;
  settings.angularStep = 0.5 * std::numbers::pi / 180;
  settings.linearTolerance = 1e-6;
  settings.angularTolerance = 1e-5;
  return settings;
}

std::set<int> touchedLinks(const GraspTrial& trial) {
  std::set<int> links;
  for (const ClosingStop& stop : trial.stops) links.insert(stop.links.begin(), stop.links.end());
  return links;
}

std::string described(const GraspTrial& trial) {
  std::ostringstream text;
  text.precision(8);
  text << kOutcomeNames[static_cast<std::size_t>(trial.outcome)] << ", back-off " << trial.backoff << ", hand "
       << trial.X_OH.translation().transpose() << ", joints " << trial.jointPosition.transpose() << ", links";
  for (const int link : touchedLinks(trial)) text << " " << link;
  text << ", " << trial.contacts.size() << " contacts" << (trial.byReference ? ", by reference" : "");
  return text.str();
}

double quantile(std::vector<double> values, double q) {
  if (values.empty()) return 0;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(q * static_cast<double>(values.size() - 1))];
}

/// How far two trials of one candidate are apart.
struct Difference {
  double backoff, pose, angle = 0, slide = 0;

  Difference(const Hand& hand, const GraspTrial& a, const GraspTrial& b)
      : backoff(std::abs(a.backoff - b.backoff)),
        pose((a.X_OH.matrix() - b.X_OH.matrix()).cwiseAbs().maxCoeff()),
        sameLinks(touchedLinks(a) == touchedLinks(b)),
        sameOutcome(a.outcome == b.outcome),
        sameContacts(a.contacts.size() == b.contacts.size()) {
    for (std::size_t i = 0; i < hand.joints.size(); ++i) {
      double& largest = hand.joints[i].type == JointType::revolute ? angle : slide;
      largest = std::max(largest, std::abs(a.jointPosition[i] - b.jointPosition[i]));
    }
  }
  bool isClose() const {
    return backoff <= kBackoffTolerance && pose <= kSlideTolerance && slide <= kSlideTolerance &&
           angle <= kAngleTolerance;
  }

  bool sameLinks, sameOutcome, sameContacts;
};

/// How far the fast policy's trials are from the fine reference's.
class Agreement {
 public:
  /// Where a hand 2 um farther back ends elsewhere (a tip that slides along what it has just left), no two policies
  /// agree: such trials are set apart.
  void compare(const std::string& name, const FieldedHand& fielded, const ObjectModel& object, PolicyKind kind,
               const std::vector<GraspCandidate>& candidates) {
    const auto& [hand, fields] = fielded;
    Hand farther = hand;
    for (Preshape& preshape : farther.preshapes) preshape.standoff += 2e-6;
    const auto fast = makeFastPolicy(fields, hand, object, kind);
    const auto fine = makeReferencePolicy(hand, object, kind, fineSettings());
    const auto fineFarther = makeReferencePolicy(farther, object, kind, fineSettings());
    // A sanitizer looks at memory, not at agreement.
    const std::size_t compared = kSanitized ? std::min<std::size_t>(candidates.size(), 3) : candidates.size();
    for (std::size_t i = 0; i < compared; ++i) {
      const GraspCandidate& candidate = candidates[i];
      GraspTrial ofFast, ofFine, ofFarther;
      fast->run(candidate, ofFast);
      fine->run(candidate, ofFine);
      fineFarther->run(candidate, ofFarther);
      const Difference settling(hand, ofFine, ofFarther);
      if (settling.isClose() && settling.sameLinks && settling.sameOutcome) {
        add(name, hand, candidate, ofFast, ofFine);
      } else {
        ++setApart;
      }
    }
  }

  /// At least `agreeing` of the trials do.
  void expect(double agreeing = kAgreeing, double agreeingContacts = kAgreeingContacts) const {
    if (!kSanitized) {  // which leaves too few trials for shares
      EXPECT_LE(setApart, trials / 4);
      EXPECT_GE(share(agree), agreeing);
      EXPECT_GE(share(agreeOnLinks), agreeing);
      EXPECT_GE(share(agreeOnOutcome), agreeing);
      EXPECT_GE(share(agreeOnContacts), agreeingContacts);
    }
    if (::testing::Test::HasFailure()) std::cout << report();
  }

  void add(const std::string& name, const Hand& hand, const GraspCandidate& candidate, const GraspTrial& fast,
           const GraspTrial& fine) {
    ++trials;
    byReference += fast.byReference;
    const Difference difference(hand, fast, fine);
    backoffs.push_back(difference.backoff);
    poses.push_back(difference.pose);
    angles.push_back(difference.angle);
    slides.push_back(difference.slide);
    agree += difference.isClose();
    agreeOnLinks += difference.sameLinks;
    agreeOnOutcome += difference.sameOutcome;
    agreeOnContacts += difference.sameContacts;
    if (difference.isClose() && difference.sameLinks && difference.sameOutcome) return;
    differences << name << ": point " << candidate.targetPoint.transpose() << ", approach "
                << candidate.approach.transpose() << ", roll " << candidate.roll << ", preshape " << candidate.preshape
                << "\n    fast " << described(fast) << "\n    fine " << described(fine) << "\n";
  }

  double share(std::size_t count) const { return static_cast<double>(count) / static_cast<double>(trials); }

  std::string report() const {
    std::ostringstream text;
    text << trials << " trials, " << setApart << " others set apart, " << byReference << " by reference; agree "
         << share(agree) << ", on links " << share(agreeOnLinks) << ", outcome " << share(agreeOnOutcome)
         << ", contacts " << share(agreeOnContacts) << "\n";
    for (const auto& [name, values] : {std::pair("back-off [m]", &backoffs), std::pair("hand [m]", &poses),
                                       std::pair("angles [rad]", &angles), std::pair("slides [m]", &slides)}) {
      text << name << ": p50 " << quantile(*values, 0.5) << ", p90 " << quantile(*values, 0.9) << ", p97 "
           << quantile(*values, 0.97) << ", largest " << quantile(*values, 1) << "\n";
    }
    return text.str() + differences.str();
  }

  std::size_t trials = 0, setApart = 0, byReference = 0, agree = 0, agreeOnLinks = 0, agreeOnOutcome = 0,
              agreeOnContacts = 0;
  std::vector<double> backoffs, poses, angles, slides;
  std::ostringstream differences;
};

std::vector<GraspTrial> runAll(GraspPolicy& policy, const std::vector<GraspCandidate>& candidates) {
  std::vector<GraspTrial> trials(candidates.size());
  for (std::size_t i = 0; i < candidates.size(); ++i) policy.run(candidates[i], trials[i]);
  return trials;
}

/// To the last bit.
void expectEqual(const GraspTrial& a, const GraspTrial& b) {
  EXPECT_EQ(a.outcome, b.outcome);
  EXPECT_EQ(a.backoff, b.backoff);
  EXPECT_EQ(a.byReference, b.byReference);
  EXPECT_TRUE(a.X_OH.matrix() == b.X_OH.matrix());
  EXPECT_TRUE(a.centering == b.centering);
  EXPECT_TRUE(a.jointPosition == b.jointPosition);
  ASSERT_EQ(a.stops.size(), b.stops.size());
  for (std::size_t i = 0; i < a.stops.size(); ++i) {
    EXPECT_EQ(a.stops[i].joint, b.stops[i].joint);
    EXPECT_EQ(a.stops[i].position, b.stops[i].position);
    EXPECT_EQ(a.stops[i].links, b.stops[i].links);
  }
  ASSERT_EQ(a.contacts.size(), b.contacts.size());
  for (std::size_t i = 0; i < a.contacts.size(); ++i) {
    EXPECT_TRUE(a.contacts[i].position == b.contacts[i].position);
    EXPECT_TRUE(a.contacts[i].normal == b.contacts[i].normal);
    EXPECT_EQ(a.contacts[i].link, b.contacts[i].link);
  }
}

void expectFinite(const GraspTrial& trial) {
  EXPECT_TRUE(std::isfinite(trial.backoff));
  EXPECT_TRUE(trial.X_OH.matrix().allFinite());
  EXPECT_TRUE(trial.centering.allFinite());
  EXPECT_TRUE(trial.jointPosition.allFinite());
  for (const Contact& contact : trial.contacts) {
    EXPECT_TRUE(contact.position.allFinite());
    EXPECT_NEAR(contact.normal.norm(), 1, 1e-9);
  }
}

/// What is stored as a contact lies on the object and within the contact distance of the link, and its normal is that
/// of a triangle there.
void expectContactsOnBothSurfaces(const Hand& hand, const ObjectModel& object, const GraspTrial& trial) {
  const std::vector<Isometry3d> X_HL = forwardKinematics(hand, trial.jointPosition);
  for (const Contact& contact : trial.contacts) {
    EXPECT_LT(distanceTo(contact.position, object.mesh), 1e-9);
    const Vector3d p_L = (trial.X_OH * X_HL[contact.link]).inverse() * contact.position;
    EXPECT_LE(distanceTo(p_L, hand.links[contact.link].mesh), ReferenceSettings().contactDistance + 1e-9);
    double best = 2;
    for (std::size_t t = 0; t < object.mesh.triangles.size(); ++t) {
      if ((closestPointOnTriangle(contact.position, object.mesh.corners(t)) - contact.position).norm() > 1e-9) continue;
      best = std::min(best, (object.mesh.normal(t) + contact.normal).norm());
      if (!object.watertight) best = std::min(best, (object.mesh.normal(t) - contact.normal).norm());
    }
    EXPECT_LT(best, 1e-9);
  }
}

/// No link cuts through the object's surface: moved by 4 um to one side or another it is free.
void expectNothingCrosses(const Hand& hand, const ObjectModel& object, const GraspTrial& trial) {
  const std::vector<Isometry3d> X_HL = forwardKinematics(hand, trial.jointPosition);
  for (std::size_t i = 0; i < hand.links.size(); ++i) {
    const auto crossesAt = [&](const Vector3d& shift) {
      return surfacesCross(object.mesh, hand.links[i].mesh, Eigen::Translation3d(shift) * trial.X_OH * X_HL[i]);
    };
    bool crosses = crossesAt(Vector3d::Zero());
    for (int k = 0; crosses && k < 6; ++k) crosses = crossesAt((k % 2 == 0 ? 4e-6 : -4e-6) * Vector3d::Unit(k / 2));
    EXPECT_FALSE(crosses) << hand.links[i].name << ": " << described(trial);
  }
}

/// An L without small triangles.
ObjectModel ellObject() {
  TriangleMesh mesh;
  append(mesh, boxMesh({0.1, 0.03, 0.03}), Isometry3d::Identity());
  append(mesh, boxMesh({0.03, 0.03, 0.08}), Isometry3d(Eigen::Translation3d(0.034, 0.002, 0.055)));
  return makeObject(std::move(mesh));
}

/// The object with a hole: one triangle is missing.
ObjectModel punched(const ObjectModel& object) {
  TriangleMesh mesh = object.mesh;
  mesh.triangles.erase(mesh.triangles.begin() + static_cast<std::ptrdiff_t>(mesh.triangles.size() / 3));
  return makeObject(std::move(mesh));
}

/// The upper half of a sphere, a sheet.
ObjectModel dome(double radius) {
  TriangleMesh mesh = sphereMesh(radius);
  std::erase_if(mesh.triangles, [&](const auto& t) {
    return mesh.vertices[t[0]].z() + mesh.vertices[t[1]].z() + mesh.vertices[t[2]].z() < 0;
  });
  return makeObject(std::move(mesh));
}

class ShippedHand : public ::testing::TestWithParam<const char*> {
 protected:
  std::string name() const { return GetParam(); }
  const FieldedHand& fielded() const { return shippedHand("hands/" + name()); }
};
INSTANTIATE_TEST_SUITE_P(Shipped, ShippedHand, ::testing::Values("barrett", "hrp2", "jaw"),
                         [](const auto& item) { return std::string(item.param); });

TEST_P(ShippedHand, AgreesWithTheFineReference) {
  Agreement agreement;
  for (const char* file : {"mug.obj", "t_bar.ply", "bottle.stl", "box.stl"}) {
    const ObjectModel& object = shippedObject(file);
    agreement.compare(name() + " on " + file, fielded(), object, PolicyKind::surfaceNormal,
                      candidatesOn(object, fielded().hand, kTrials, kSeed));
  }
  agreement.expect();
  EXPECT_LE(agreement.share(agreement.byReference), 0.1);
}

// Twelve large triangles, tilted against all axes, and an L of two such boxes.
// A trial of the reference takes as long as thirty. Jaws that slide along the object, microns apart, were most of them.
TEST_P(ShippedHand, HandsFewTrialsToTheReference) {
  const ObjectModel& object = shippedObject("mug.obj");
  const auto policy = makeFastPolicy(fielded().fields, fielded().hand, object, PolicyKind::surfaceNormal, {});
  const auto candidates = candidatesOn(object, fielded().hand, 300, kSeed);
  GraspTrial trial;
  const auto handedOn = std::count_if(candidates.begin(), candidates.end(), [&](const GraspCandidate& candidate) {
    policy->run(candidate, trial);
    return trial.byReference;
  });
  EXPECT_LE(static_cast<double>(handedOn), 0.01 * static_cast<double>(candidates.size()));
}

TEST_P(ShippedHand, AgreesOnLargeTriangles) {
  Agreement agreement;
  Isometry3d X(Eigen::AngleAxisd(0.6, Vector3d(1, -2, 3).normalized()));
  const ObjectModel box = boxObject({0.06, 0.1, 0.16}, X), ell = ellObject();
  for (const ObjectModel* object : {&box, &ell}) {
    agreement.compare(name() + (object == &box ? " on a tilted box" : " on an L"), fielded(), *object,
                      PolicyKind::surfaceNormal, candidatesOn(*object, fielded().hand, kTrials, kSeed));
  }
  agreement.expect();
}

TEST_P(ShippedHand, AgreesWhenItComesFromOutside) {
  Agreement agreement;
  for (const char* file : {"mug.obj", "t_bar.ply"}) {
    const ObjectModel& object = shippedObject(file);
    agreement.compare(name() + " from outside on " + file, fielded(), object, PolicyKind::centerOfMass,
                      candidatesOn(object, fielded().hand, kTrials, kSeed + 1));
  }
  agreement.expect();
}

// Targets below the surface: the hand starts inside the object and backs out.
TEST_P(ShippedHand, AgreesWhenItStartsInside) {
  Agreement agreement;
  for (const char* file : {"mug.obj", "bottle.stl"}) {
    const ObjectModel& object = shippedObject(file);
    std::vector<GraspCandidate> candidates = candidatesOn(object, fielded().hand, kTrials, kSeed + 2);
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      candidates[i].targetPoint += 0.03 * RandomStream(31).uniform(i) * candidates[i].approach;
    }
    agreement.compare(name() + " from inside " + file, fielded(), object, PolicyKind::surfaceNormal, candidates);
  }
  agreement.expect();
}

// One triangle is missing, or the lower half of the object.
TEST_P(ShippedHand, AgreesOnOpenMeshes) {
  Agreement agreement;
  const ObjectModel mug = punched(shippedObject("mug.obj")), half = dome(0.04);
  ASSERT_FALSE(mug.watertight);
  ASSERT_FALSE(half.watertight);
  for (const ObjectModel* object : {&mug, &half}) {
    agreement.compare(name() + (object == &mug ? " on an open mug" : " on a dome"), fielded(), *object,
                      PolicyKind::surfaceNormal, candidatesOn(*object, fielded().hand, kTrials, kSeed + 3));
  }
  agreement.expect();
}

TEST_P(ShippedHand, AgreesOnALargeObject) {
  Agreement agreement;
  const ObjectModel block = boxObject({0.5, 0.4, 0.35});
  agreement.compare(name() + " on a block", fielded(), block, PolicyKind::surfaceNormal,
                    candidatesOn(block, fielded().hand, 2 * kTrials, kSeed + 4));
  agreement.expect();
}

TEST_P(ShippedHand, AgreesOnTinyObjects) {
  Agreement agreement;
  const ObjectModel cube = boxObject({0.005, 0.005, 0.005}), pea = sphereObject(0.0025);
  for (const ObjectModel* object : {&cube, &pea}) {
    agreement.compare(name() + (object == &cube ? " on a cube of 5 mm" : " on a pea"), fielded(), *object,
                      PolicyKind::surfaceNormal, candidatesOn(*object, fielded().hand, kTrials, kSeed + 4));
  }
  agreement.expect(0.95);  // flush contacts of a few millimetres come and go with a micrometre
}

// A millimetre behind the back-off and a little aside; a millimetre before it the hand may touch.
TEST_P(ShippedHand, ClosesFromAGivenPoseAsTheReferenceDoes) {
  const auto& [hand, fields] = fielded();
  const ObjectModel& mug = shippedObject("mug.obj");
  const auto fast = makeFastPolicy(fields, hand, mug, PolicyKind::surfaceNormal);
  const auto fine = makeReferencePolicy(hand, mug, PolicyKind::surfaceNormal, fineSettings());
  Agreement agreement;
  std::size_t free = 0, touching = 0;
  for (const GraspCandidate& candidate : candidatesOn(mug, hand, kSanitized ? 3 : 2 * kTrials, kSeed + 11)) {
    GraspTrial trial, ofFast, ofFine;
    fast->run(candidate, trial);
    for (const double behind : {1e-3, -1e-3}) {
      const Vector3d moved =
          -trial.centering - behind * candidate.approach + 4e-4 * candidate.approach.unitOrthogonal();
      const Isometry3d X_OH = Eigen::Translation3d(moved) * trial.X_OH;
      const bool isFree = fast->closeAt(X_OH, candidate.preshape, ofFast);
      ASSERT_EQ(isFree, fine->closeAt(X_OH, candidate.preshape, ofFine)) << described(trial);
      ++(isFree ? free : touching);
      if (isFree) agreement.add(name() + " at a given pose", hand, candidate, ofFast, ofFine);
    }
    // What ended free backs off no farther.
    ASSERT_TRUE(fast->closeAt(Eigen::Translation3d(-trial.centering) * trial.X_OH, candidate.preshape, ofFast));
    EXPECT_TRUE(ofFast.X_OH.isApprox(trial.X_OH, 1e-9) || ofFast.byReference != trial.byReference);
    EXPECT_LT((ofFast.jointPosition - trial.jointPosition).cwiseAbs().maxCoeff(), 1e-9);
  }
  EXPECT_GT(free, 0U);
  EXPECT_GT(touching, 0U);
  agreement.expect(0.9);
}

TEST_P(ShippedHand, GivesEqualTrialsInAnyOrderAndFromAClone) {
  const auto& [hand, fields] = fielded();
  const ObjectModel& object = shippedObject("mug.obj");
  const auto candidates = candidatesOn(object, hand, 40, kSeed + 5);
  const auto policy = makeFastPolicy(fields, hand, object, PolicyKind::surfaceNormal);
  const auto trials = runAll(*policy, candidates);
  std::vector<GraspCandidate> backwards(candidates.rbegin(), candidates.rend());
  auto again = runAll(*policy, backwards);
  std::reverse(again.begin(), again.end());
  const auto ofClone = runAll(*policy->clone(), candidates);
  const auto ofAnother = runAll(*makeFastPolicy(fields, hand, object, PolicyKind::surfaceNormal), candidates);
  for (std::size_t i = 0; i < trials.size(); ++i) {
    SCOPED_TRACE("candidate " + std::to_string(i));
    expectEqual(trials[i], again[i]);
    expectEqual(trials[i], ofClone[i]);
    expectEqual(trials[i], ofAnother[i]);
  }
}

// A finger that starts where it did in the trial before is not closed again: that must not show.
TEST_P(ShippedHand, PreshapesOneAfterTheOtherGiveWhatEachGivesAlone) {
  const auto& [hand, fields] = fielded();
  const ObjectModel& object = shippedObject("mug.obj");
  const auto policy = makeFastPolicy(fields, hand, object, PolicyKind::surfaceNormal);
  const auto preshapes = static_cast<int>(hand.preshapes.size());
  int sameBackoff = 0;
  for (GraspCandidate candidate : candidatesOn(object, hand, 60, kSeed + 6)) {
    double before = -1;
    for (int k = 0; k < 2 * preshapes; ++k) {  // each twice: the second time nothing has changed
      candidate.preshape = k / 2;
      const GraspTrial inARow = runAll(*policy, {candidate})[0];
      const GraspTrial alone = runAll(*policy->clone(), {candidate})[0];
      expectEqual(inARow, alone);
      sameBackoff += inARow.backoff == before;
      before = inARow.backoff;
    }
  }
  EXPECT_GE(sameBackoff, 60 * preshapes);
}

TEST(FastPolicy, FieldsMadeAgainByMoreThreadsGiveEqualTrials) {
  const FieldedHand once(makeFingers(3)), again(makeFingers(3), 3);
  const ObjectModel& object = shippedObject("mug.obj");
  const auto candidates = candidatesOn(object, once.hand, 40, kSeed + 5);
  const auto first = runAll(*makeFastPolicy(once.fields, once.hand, object, PolicyKind::surfaceNormal), candidates);
  const auto second = runAll(*makeFastPolicy(again.fields, again.hand, object, PolicyKind::surfaceNormal), candidates);
  for (std::size_t i = 0; i < first.size(); ++i) expectEqual(first[i], second[i]);
}

TEST(FastPolicy, FieldsStopWhenCancelled) {
  const std::atomic<bool> cancel = true;
  EXPECT_THROW(makeHandFields(makeJaw(false), &cancel), Cancelled);
}

GraspTrial runFromAbove(const Hand& hand, const ObjectModel& object, double height) {
  GraspTrial trial;
  makeFastPolicy(makeHandFields(hand), hand, object, PolicyKind::surfaceNormal)
      ->run({Vector3d(0, 0, height), -Vector3d::UnitZ(), 0, 0}, trial);
  return trial;
}

// Inside counts as touching: a hand that starts wholly inside a large block must come out of it.
TEST(FastPolicy, AHandInsideTheObjectBacksOut) {
  const GraspTrial trial = runFromAbove(makeJaw(false), boxObject({0.4, 0.4, 0.4}), 0.1);
  EXPECT_NEAR(trial.backoff, 0.2 - 0.1 + 0.04, kBackoffTolerance);  // the pads' tips, 40 mm before the palm
}

// The palm is outside, both pads are inside a plate, their surfaces apart from its surface by more than a millimetre.
TEST(FastPolicy, APieceInsideTheObjectTouches) {
  const GraspTrial trial =
      runFromAbove(makeJaw(false), boxObject({0.2, 0.2, 0.024}, Isometry3d(Eigen::Translation3d(0, 0, -0.03))), 0.0003);
  EXPECT_TRUE(trial.byReference);
  EXPECT_NEAR(trial.backoff, 0.04 - 0.018 - 0.0003, 1e-5);  // the reference's own tolerance
}

// The object inside the hand's own solid counts as touching too.
TEST(FastPolicy, AnObjectInsideALinkTouches) {
  const GraspTrial trial = runFromAbove(makeJaw(false), sphereObject(0.003), -0.013);
  EXPECT_NEAR(trial.backoff, 0.013 + 0.003, 6e-5);  // the chord error of the sphere
}

TEST_P(ShippedHand, StopsOutsideWithContactsOnBothSurfaces) {
  const auto& [hand, fields] = fielded();
  std::size_t contacts = 0;
  for (const char* file : {"mug.obj", "bottle.stl"}) {
    const ObjectModel& object = shippedObject(file);
    const auto policy = makeFastPolicy(fields, hand, object, PolicyKind::surfaceNormal);
    for (const GraspCandidate& candidate : candidatesOn(object, hand, name() == "barrett" ? 4 : 16, kSeed + 6)) {
      GraspTrial trial;
      policy->run(candidate, trial);
      expectFinite(trial);
      expectContactsOnBothSurfaces(hand, object, trial);
      if (trial.outcome != GraspOutcome::blockedCentering) expectNothingCrosses(hand, object, trial);
      contacts += trial.contacts.size();
    }
  }
  EXPECT_GT(contacts, 15U);
}

TEST_P(ShippedHand, GivesEqualBitsWithAvx2AndAvx512) {
  if ((hwy::SupportedTargets() & HWY_AVX2) == 0 || (hwy::SupportedTargets() & HWY_AVX3) == 0)
    GTEST_SKIP() << "this machine does not have both AVX2 and AVX-512";
  const auto& [hand, fields] = fielded();
  for (const char* file : {"mug.obj", "box.stl"}) {
    const ObjectModel& object = shippedObject(file);
    const auto candidates = candidatesOn(object, hand, 40, kSeed + 7);
    const auto policy = makeFastPolicy(fields, hand, object, PolicyKind::surfaceNormal);
    hwy::SetSupportedTargetsForTest(HWY_AVX3);
    const auto wide = runAll(*policy, candidates);
    hwy::SetSupportedTargetsForTest(HWY_AVX2);
    const auto narrow = runAll(*policy, candidates);
    hwy::SetSupportedTargetsForTest(0);
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      SCOPED_TRACE(std::string(file) + ", candidate " + std::to_string(i));
      expectEqual(wide[i], narrow[i]);
    }
  }
}

TEST_P(ShippedHand, GivesNearlyEqualTrialsWithPlainCode) {
  const auto& [hand, fields] = fielded();
  std::size_t trials = 0, agree = 0;
  std::ostringstream differences;
  for (const char* file : {"mug.obj", "box.stl"}) {
    const ObjectModel& object = shippedObject(file);
    const auto candidates = candidatesOn(object, hand, 40, kSeed + 7);
    const auto policy = makeFastPolicy(fields, hand, object, PolicyKind::surfaceNormal);
    const auto widest = runAll(*policy, candidates);
    hwy::SetSupportedTargetsForTest(HWY_STATIC_TARGET);  // what the compiler's own flags give
    const auto plain = runAll(*policy, candidates);
    hwy::SetSupportedTargetsForTest(0);
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      ++trials;
      const double pose = (widest[i].X_OH.matrix() - plain[i].X_OH.matrix()).cwiseAbs().maxCoeff();
      bool close = pose <= 1e-5 && std::abs(widest[i].backoff - plain[i].backoff) <= 1e-5;
      for (std::size_t j = 0; j < hand.joints.size(); ++j) {
        const double tolerance = hand.joints[j].type == JointType::revolute ? 1e-4 : 1e-5;
        close = close && std::abs(widest[i].jointPosition[j] - plain[i].jointPosition[j]) <= tolerance;
      }
      agree += close;
      if (!close)
        differences << file << " " << i << "\n    " << described(widest[i]) << "\n    " << described(plain[i]) << "\n";
    }
  }
  EXPECT_GE(static_cast<double>(agree), kAgreeing * static_cast<double>(trials)) << differences.str();
}

// --- toy hands: every kind of closing step

/// Two prismatic fingers and a revolute one, each on its own, with a distal link that mimics it without a clutch.
Hand makeMixedHand() {
  Hand hand = makeFingers(3);
  for (ClosingJoint& closing : hand.closing) closing.breakawayJoint = -1;
  for (int i = 0; i < 2; ++i) {
    Joint& joint = hand.joints[2 * i];
    joint.type = JointType::prismatic;
    joint.axis = -Vector3d::UnitX();
    joint.lower = -0.01;
    joint.upper = 0.045;
    hand.joints[2 * i + 1].mimicMultiplier = 25;  // rad per m
    hand.joints[2 * i + 1].mimicOffset = 0.1;
    hand.preshapes[0].jointPosition[2 * i] = -0.008;
  }
  hand.preshapes[0].jointPosition = followMimics(hand, hand.preshapes[0].jointPosition);
  return hand;
}

struct Toy {
  const char* name;
  Hand (*make)();

  friend void PrintTo(const Toy& toy, std::ostream* out) { *out << toy.name; }
};

Hand withStandoff(Hand hand, double standoff) {
  hand.preshapes[0].standoff = standoff;
  return hand;
}

/// The jaw's first pad closes towards the other, which is fixed at its place in the preshape.
Hand makeFixedJaw() {
  Hand hand = makeJaw(false);
  hand.closing.pop_back();
  hand.closing[0].selfCentering = true;
  return hand;
}

class ToyHand : public ::testing::TestWithParam<Toy> {
 protected:
  static const FieldedHand& fielded() {
    static std::map<std::string, std::unique_ptr<const FieldedHand>> made;
    auto& hand = made[GetParam().name];
    if (hand == nullptr) hand = std::make_unique<const FieldedHand>(GetParam().make());
    return *hand;
  }
};
INSTANTIATE_TEST_SUITE_P(
    All, ToyHand,
    ::testing::Values(Toy{"jaw", [] { return makeJaw(false); }}, Toy{"coupled_jaw", [] { return makeJaw(true); }},
                      Toy{"fixed_jaw", makeFixedJaw}, Toy{"two_fingers", [] { return makeFingers(2); }},
                      Toy{"three_fingers", [] { return makeFingers(3); }}, Toy{"mixed", makeMixedHand},
                      Toy{"jaw_with_standoff", [] { return withStandoff(makeJaw(true), 0.012); }},
                      Toy{"fingers_with_standoff", [] { return withStandoff(makeFingers(3), 0.03); }}),
    [](const auto& item) { return std::string(item.param.name); });

TEST_P(ToyHand, AgreesWithTheFineReference) {
  const ObjectModel box = boxObject({0.05, 0.03, 0.06}, Isometry3d(Eigen::AngleAxisd(0.4, Vector3d::UnitY())));
  const ObjectModel sphere = sphereObject(0.025), cylinder = makeObject(cylinderMesh(0.02, 0.1)), ell = ellObject();
  Agreement agreement;
  for (const auto& [what, object] : {std::pair(" on a box", &box), std::pair(" on a sphere", &sphere),
                                     std::pair(" on a cylinder", &cylinder), std::pair(" on an L", &ell)}) {
    for (const PolicyKind kind : {PolicyKind::surfaceNormal, PolicyKind::centerOfMass}) {
      agreement.compare(GetParam().name + std::string(what), fielded(), *object, kind,
                        candidatesOn(*object, fielded().hand, kTrials / 2, kSeed + 8));
    }
  }
  agreement.expect();
}

TEST_P(ToyHand, StopsOutsideWithContactsOnBothSurfaces) {
  const ObjectModel ell = ellObject();
  const auto policy = makeFastPolicy(fielded().fields, fielded().hand, ell, PolicyKind::surfaceNormal);
  for (const GraspCandidate& candidate : candidatesOn(ell, fielded().hand, 40, kSeed + 9)) {
    GraspTrial trial;
    policy->run(candidate, trial);
    expectFinite(trial);
    expectContactsOnBothSurfaces(fielded().hand, ell, trial);
    if (trial.outcome != GraspOutcome::blockedCentering) expectNothingCrosses(fielded().hand, ell, trial);
  }
}

// --- real hands, where HANDHOLD_DATA names the collection of URDFs

class OtherHand : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(Data, OtherHand,
                         ::testing::Values("barrett_bh280", "robotiq_2f85", "allegro_right", "franka_hand"),
                         [](const auto& item) { return std::string(item.param); });

TEST_P(OtherHand, AgreesWithTheFineReference) {
  if (std::getenv("HANDHOLD_DATA") == nullptr) GTEST_SKIP() << "HANDHOLD_DATA does not name the collection of URDFs";
  const FieldedHand& fielded = shippedHand(std::string("tests/data/hands/") + GetParam());
  const ObjectModel& mug = shippedObject("mug.obj");
  const auto candidates = candidatesOn(mug, fielded.hand, 12, kSeed + 10);
  for (const GraspTrial& trial :
       runAll(*makeFastPolicy(fielded.fields, fielded.hand, mug, PolicyKind::surfaceNormal), candidates)) {
    expectFinite(trial);
  }
  Agreement agreement;
  agreement.compare(GetParam(), fielded, mug, PolicyKind::surfaceNormal, candidates);
  agreement.expect(0.9, 0.75);
}

}  // namespace
}  // namespace handhold
