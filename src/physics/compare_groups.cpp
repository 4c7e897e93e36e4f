#include "physics/compare_groups.h"

#include "build/import_set.h"

#include <algorithm>
#include <numbers>

namespace handhold {
namespace {

constexpr double kNearContact = 3e-3;       // m
constexpr std::size_t kDrawsPerOpen = 100;  // trials drawn for each open one wanted

FailureCause causeOf(const TestResult& result, const PhysicsSettings& settings) {
  for (const DirectionResult& direction : result.directions) {
    if (direction.outcome == PhysicsOutcome::inside) return FailureCause::inside;
    if (direction.outcome == PhysicsOutcome::unstable) return FailureCause::unstable;
  }
  const SettledResult& settled = result.settled;
  const auto isOther = [&](const Contact& contact) { return contact.link != settled.contacts.front().link; };
  if (std::none_of(settled.contacts.begin(), settled.contacts.end(), isOther)) return FailureCause::lost;
  const double turn = settings.largestTurn * std::numbers::pi / 180;
  if (settled.displacement >= settings.largestMove || settled.rotation >= turn) return FailureCause::displaced;
  return settled.closed ? FailureCause::slipped : FailureCause::notClosed;
}

void count(const TestResult& result, const PhysicsSettings& settings, GroupResult& group) {
  const bool held = isHeld(result);
  group.grasps += 1;
  group.settledClosed += result.settled.closed ? 1 : 0;
  group.heldClosed += held && result.settled.closed ? 1 : 0;
  if (held) {
    group.held += 1;
  } else {
    group.causes[static_cast<std::size_t>(causeOf(result, settings))] += 1;
  }
}

/// The postures of all groups, group after group.
std::vector<const GraspPosture*> inARow(const std::array<std::vector<GraspPosture>, kGraspGroupNames.size()>& groups) {
  std::vector<const GraspPosture*> postures;
  for (const auto& group : groups) {
    for (const GraspPosture& posture : group) postures.push_back(&posture);
  }
  return postures;
}

/// The pull of every posture, in their order.
std::vector<TestResult> pullAll(const PhysicsModel& model, const std::vector<const GraspPosture*>& postures,
                                const JobSystem& jobs, const std::atomic<bool>& cancel) {
  std::vector<TestResult> results(postures.size());
  std::vector<GraspSimulator> simulators;
  simulators.reserve(static_cast<std::size_t>(jobs.threads()));
  for (int i = 0; i < jobs.threads(); ++i) simulators.emplace_back(model);
  jobs.run(
      postures.size(), 1,
      [&](int worker, std::size_t i) { results[i] = simulators[worker].run(*postures[i], PhysicsTest::pull); },
      &cancel);
  return results;
}

}  // namespace

std::array<std::vector<GraspPosture>, kGraspGroupNames.size()> GroupComparer::draw(
    const SimulatedSet& set, const std::array<std::size_t, kGraspGroupNames.size()>& counts, std::uint64_t seed,
    const std::atomic<bool>& cancel) {
  const GraspSet& stored = set.set();
  std::array<std::vector<GraspPosture>, kGraspGroupNames.size()> groups;
  for (std::size_t row = 0; row < std::min(counts[0], stored.graspCount()); ++row) {
    groups[0].push_back(set.posture(row));
  }
  const DrawnGrasps drawn = drawGrasps(stored, counts[1], counts[2], seed);
  for (const std::size_t row : drawn.rows) groups[1].push_back(set.posture(row));
  if (stored.policy == kImportedPolicy) return groups;
  const RecordedTrials trials(set, fields_, cancel);
  SetWorker worker = std::move(trials.makeWorkers(JobSystem(1)).front());
  const auto postureOf = [&](std::size_t trial) {
    const GraspCandidate candidate = trials.candidate(trial);
    worker.policy->run(candidate, worker.evaluation.trial);
    return trials.posture(candidate, worker.evaluation.trial);
  };
  for (const std::size_t trial : drawn.trials) groups[2].push_back(postureOf(trial));
  const RandomStream random = drawStream(stored, seed).child(3);
  const auto all = static_cast<double>(stored.trialCount());
  for (std::size_t i = 0; groups[3].size() < counts[3] && i < kDrawsPerOpen * counts[3] && !cancel; ++i) {
    GraspPosture posture = postureOf(static_cast<std::size_t>(random.uniform(i) * all));
    const std::vector<Contact> contacts = set.model().contactsWithin(posture, kNearContact);
    if (!contacts.empty() && !set.model().closes(contacts)) groups[3].push_back(std::move(posture));
  }
  return groups;
}

std::optional<GroupTable> GroupComparer::compare(const SimulatedSet& set, std::size_t count, std::uint64_t seed,
                                                 const JobSystem& jobs, const std::atomic<bool>& cancel) {
  const auto groups = draw(set, {count, count, count, count}, seed, cancel);
  const std::vector<const GraspPosture*> postures = inARow(groups);
  const std::vector<TestResult> results = pullAll(set.model(), postures, jobs, cancel);
  if (cancel) return std::nullopt;
  GroupTable table;
  std::size_t i = 0;
  for (std::size_t g = 0; g < groups.size(); ++g) {
    for (std::size_t k = 0; k < groups[g].size(); ++k, ++i) handhold::count(results[i], set.settings(), table[g]);
  }
  return table;
}

std::optional<ShapeAgreement> GroupComparer::compareShapes(const SimulatedSet& set, std::size_t count,
                                                           std::uint64_t seed, const JobSystem& jobs,
                                                           const std::atomic<bool>& cancel) {
  const auto groups = draw(set, {0, (count + 1) / 2, count / 2, 0}, seed, cancel);
  const std::vector<const GraspPosture*> postures = inARow(groups);
  const std::vector<TestResult> byField = pullAll(set.model(), postures, jobs, cancel);
  const std::vector<TestResult> byPieces = pullAll(set.pieceModel(), postures, jobs, cancel);
  if (cancel) return std::nullopt;
  ShapeAgreement agreement;
  for (std::size_t i = 0; i < postures.size(); ++i) {
    const bool field = isHeld(byField[i]), pieces = isHeld(byPieces[i]);
    agreement.grasps += 1;
    agreement.agree += field == pieces ? 1 : 0;
    agreement.heldByField += field ? 1 : 0;
    agreement.heldByPieces += pieces ? 1 : 0;
  }
  return agreement;
}

}  // namespace handhold
