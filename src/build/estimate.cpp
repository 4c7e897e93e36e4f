#include "build/estimate.h"

#include "core/error.h"
#include "core/log.h"
#include "store/set_size.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

namespace handhold {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kSetsToLearnFrom = 20;
constexpr std::array<std::string_view, 4> kTrialStages = {"policy", "force_closure", "epsilon", "approach"};
constexpr std::string_view kGraspStage = "bounds";  // of every grasp that is kept

/// Without a set to learn from: means over the sets of jobs/demo.yaml, as this prints them when they are there
///     handhold build jobs/demo.yaml && handhold build jobs/demo.yaml --force --dry-run --format json
/// For the reference: the same with `simulation: reference` in the job.
CostRates defaultRates(Simulation simulation) {
  CostRates rates;
  rates.secondsPerSet = 0.16;
  rates.secondsPerTrial = simulation == Simulation::fast ? 1.8e-4 : 3e-3;
  rates.secondsPerGrasp = 1.9e-4;
  rates.secondsOnce = simulation == Simulation::fast ? 1 : 0;
  rates.shareForceClosed = 0.08;
  rates.bytesPerSet = 2.2e5;
  rates.bytesPerSample = 120;
  rates.bytesPerTrial = 5;
  rates.bytesPerGrasp = 460;
  return rates;
}

/// The newest set of each object in this hand, at most so many, spread over them.
std::vector<fs::path> setsOfHand(const std::vector<fs::path>& files, const std::string& hand) {
  std::vector<fs::path> newest;
  for (const fs::path& path : files) {  // versions rise within a folder
    if (path.parent_path().filename() != hand) continue;
    if (!newest.empty() && newest.back().parent_path() == path.parent_path()) newest.pop_back();
    newest.push_back(path);
  }
  std::vector<fs::path> some;
  const std::size_t count = std::min(newest.size(), kSetsToLearnFrom);
  for (std::size_t i = 0; i < count; ++i) some.push_back(newest[i * newest.size() / count]);
  return some;
}

std::size_t forceClosedTrials(const GraspSet& set) {
  const auto name = std::find(set.outcomeNames.begin(), set.outcomeNames.end(), "force_closed");
  const auto index = static_cast<std::uint8_t>(name - set.outcomeNames.begin());
  return static_cast<std::size_t>(std::count(set.outcome.begin(), set.outcome.end(), index));
}

/// Sums over sets; rates() divides them.
class Learner {
 public:
  explicit Learner(const Job& job) : job_(job) {}

  void add(const GraspSet& set, std::size_t bytes) {
    const bool byReference = set.trialsByReference == set.trialCount();
    if (set.trialCount() == 0 || byReference != (job_.simulation == Simulation::reference)) return;
    ++sets_;
    trials_ += static_cast<double>(set.trialCount());
    closed_ += static_cast<double>(forceClosedTrials(set));
    for (const auto& [stage, seconds] : set.seconds) {
      if (stage == "fields") {
        once_ = std::max(once_, seconds);
      } else if (stage == kGraspStage) {
        graspSeconds_ += seconds;
      } else if (std::find(kTrialStages.begin(), kTrialStages.end(), stage) != kTrialStages.end()) {
        trialSeconds_ += seconds;
      } else {
        setSeconds_ += seconds;
      }
    }
    const SetSize size = sizeOf(set, bytes);
    fixed_ += size.fixed;
    samples_ += static_cast<double>(set.samples);
    sampleBytes_ += size.perSample * static_cast<double>(set.samples);
    trialBytes_ += size.perTrial * static_cast<double>(set.trialCount());
    grasps_ += static_cast<double>(set.graspCount());
    graspBytes_ += size.perGrasp * static_cast<double>(set.graspCount());
    if (job_.pitch > 0 && set.pitch == job_.pitch) samplesAtPitch_ += static_cast<double>(set.samples), ++setsAtPitch_;
  }

  CostRates rates() const {
    CostRates rates = defaultRates(job_.simulation);
    if (sets_ == 0) return rates;
    rates.sets = sets_;
    const auto sets = static_cast<double>(sets_);
    rates.secondsPerSet = setSeconds_ / sets;
    rates.secondsPerTrial = trialSeconds_ / trials_;
    if (once_ > 0) rates.secondsOnce = once_;
    rates.shareForceClosed = closed_ / trials_;
    rates.bytesPerSet = fixed_ / sets;
    rates.bytesPerSample = sampleBytes_ / samples_;
    rates.bytesPerTrial = trialBytes_ / trials_;
    if (grasps_ > 0) {
      rates.secondsPerGrasp = graspSeconds_ / grasps_;
      rates.bytesPerGrasp = graspBytes_ / grasps_;
    }
    if (setsAtPitch_ > 0) rates.samples = samplesAtPitch_ / static_cast<double>(setsAtPitch_);
    return rates;
  }

 private:
  const Job& job_;
  std::size_t sets_ = 0, setsAtPitch_ = 0;
  double trials_ = 0, closed_ = 0, samples_ = 0, grasps_ = 0, samplesAtPitch_ = 0;
  double trialSeconds_ = 0, graspSeconds_ = 0, setSeconds_ = 0, once_ = 0;
  double fixed_ = 0, sampleBytes_ = 0, trialBytes_ = 0, graspBytes_ = 0;
};

CostRates learnRates(const Job& job, const std::vector<fs::path>& files, const std::string& hand) {
  Learner learner(job);
  for (const fs::path& path : setsOfHand(files, hand)) {
    try {
      learner.add(readGraspSet(path), fs::file_size(path));
    } catch (const InputError& error) {
      logWarning(error.what());
    }
  }
  return learner.rates();
}

/// Adds one set that is to be built.
void addSet(const Job& job, const PlannedSet& set, std::size_t preshapes, HandEstimate& estimate) {
  const CostRates& rates = estimate.rates;
  const double perSample = static_cast<double>(job.rolls) * static_cast<double>(preshapes);
  const double trials = set.trials > 0 ? static_cast<double>(set.trials) : rates.samples * perSample;
  if (trials == 0) {
    ++estimate.unknownSets;
    return;
  }
  double grasps = trials * rates.shareForceClosed;
  if (job.keepTop > 0) grasps = std::min(grasps, static_cast<double>(job.keepTop));
  estimate.trials += trials;
  estimate.coreHours += (rates.secondsPerSet + trials * rates.secondsPerTrial + grasps * rates.secondsPerGrasp) / 3600;
  estimate.gigabytes += (rates.bytesPerSet + trials / perSample * rates.bytesPerSample + trials * rates.bytesPerTrial +
                         grasps * rates.bytesPerGrasp) /
                        1e9;
}

}  // namespace

std::vector<HandEstimate> estimateCost(const Job& job, const std::vector<Hand>& hands, const Database& database,
                                       const std::vector<PlannedSet>& plan) {
  using State = PlannedSet::State;
  const std::vector<fs::path> files = database.files();
  std::vector<HandEstimate> estimates;
  for (const Hand& hand : hands) {
    HandEstimate estimate;
    estimate.hand = hand.name;
    estimate.rates = learnRates(job, files, hand.name);
    bool isSelected = false;
    for (const PlannedSet& set : plan) {
      if (set.hand != hand.name) continue;
      isSelected = true;
      ++(set.state == State::missing   ? estimate.missing
         : set.state == State::changed ? estimate.changed
         : set.state == State::done    ? estimate.done
         : set.state == State::failed  ? estimate.failed
                                       : estimate.unreadable);
      if (set.toBuild()) addSet(job, set, hand.preshapes.size(), estimate);
    }
    if (estimate.trials > 0) estimate.coreHours += estimate.rates.secondsOnce / 3600;
    if (isSelected) estimates.push_back(std::move(estimate));
  }
  return estimates;
}

}  // namespace handhold
