#include "build/evaluate.h"

#include "quality/true_cone.h"
#include "support/allocations.h"
#include "support/random_contacts.h"

#include <cmath>
#include <vector>

#include <gtest/gtest.h>

namespace handhold {
namespace {

/// Gives the contacts that it was told to; nothing is in the way.
class GivenContacts final : public GraspPolicy {
 public:
  void give(const std::vector<Contact>& contacts) { contacts_ = &contacts; }
  void run(const GraspCandidate&, GraspTrial& trial) override {
    trial.contacts = *contacts_;
    trial.outcome = GraspOutcome::notForceClosed;
  }
  bool closeAt(const Eigen::Isometry3d&, int, GraspTrial& trial) override {
    run({}, trial);
    return true;
  }
  void touchAt(const Eigen::Isometry3d&, const Eigen::VectorXd&, GraspTrial& trial) override { run({}, trial); }
  bool approachIsClear(const GraspCandidate&, const GraspTrial&) override { return true; }
  bool selfCollides(const GraspCandidate&, const GraspTrial&) override { return false; }
  std::unique_ptr<GraspPolicy> clone() const override { return std::make_unique<GivenContacts>(*this); }

 private:
  const std::vector<Contact>* contacts_ = nullptr;
};

// Two opposed contacts of a jaw: too few when they are points, a grasp when they are soft; one is always too few.
TEST(Evaluate, TwoContactsAreEnoughForSoftFingers) {
  const std::vector<Contact> pair = {{{0.03, 0, 0}, {-1, 0, 0}, 0}, {{-0.03, 0, 0}, {1, 0, 0}, 1}};
  const std::vector<Contact> single = {pair[0]};
  const auto run = [](const std::vector<Contact>& contacts, double torsionRadius) {
    GivenContacts policy;
    policy.give(contacts);
    Cones cones({{0, 0, 0}, 0.05, 0.5, 8, torsionRadius});
    Evaluation evaluation;
    StageSeconds seconds;
    evaluate(policy, {}, cones, evaluation, seconds);
    return evaluation;
  };
  EXPECT_EQ(run(pair, 0).trial.outcome, GraspOutcome::tooFewContacts);
  EXPECT_EQ(run(pair, 0).epsilon, 0);
  EXPECT_EQ(run(single, 0.004).trial.outcome, GraspOutcome::tooFewContacts);
  const Evaluation soft = run(pair, 0.004);
  EXPECT_EQ(soft.trial.outcome, GraspOutcome::forceClosed);
  EXPECT_GT(soft.epsilon, 0);
}

// Once a worker has seen the sizes, nothing after the policy comes from the heap, and its memory changes no result.
TEST(Evaluate, SecondPassAllocatesNothing) {
  if (!testing::countsAllocations()) GTEST_SKIP() << "a sanitizer has its own malloc";
  std::vector<std::vector<Contact>> sets;
  for (int seed = 0; seed < 60; ++seed) sets.push_back(testing::randomContacts(seed, 2 + seed % 8, 0.3));
  GivenContacts policy;
  const WrenchModel model = {{0, 0, 0}, 1, 0.5, 8};
  Cones cones(model);
  TrueCones trueCones(model);
  Evaluation evaluation;
  StageSeconds seconds;
  std::vector<double> epsilons[2];  // linearised, and of grasps the three numbers on the true cone
  for (auto& values : epsilons) values.reserve(4 * sets.size());
  int nClosed = 0;
  for (int pass = 0; pass < 2; ++pass) {
    const long before = testing::allocations();
    for (const std::vector<Contact>& contacts : sets) {
      policy.give(contacts);
      evaluate(policy, {}, cones, evaluation, seconds);
      epsilons[pass].push_back(evaluation.epsilon);
      const bool isClosed = evaluation.trial.outcome == GraspOutcome::forceClosed;
      nClosed += isClosed;
      if (!isClosed) continue;
      const EpsilonBounds bounds = trueCones.epsilonBounds(evaluation.trial.contacts);
      // The linearised cone lies inside the true one.
      EXPECT_LE(evaluation.epsilon, bounds.upper + 4 * kEpsilonTolerance);
      const double friction = trueCones.criticalFriction(evaluation.trial.contacts).friction;
      for (const double value : {bounds.lower, bounds.upper, friction}) epsilons[pass].push_back(value);
    }
    if (pass == 1) {
      EXPECT_EQ(testing::allocations() - before, 0);
    }
  }
  EXPECT_EQ(epsilons[0], epsilons[1]);
  EXPECT_GT(nClosed, 20);
  EXPECT_LT(nClosed, 100);
}

}  // namespace
}  // namespace handhold
