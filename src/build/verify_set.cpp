#include "build/verify_set.h"

#include "build/build_set.h"
#include "build/import_set.h"
#include "build/kept_quality.h"
#include "build/stored_set.h"
#include "core/error.h"
#include "core/hash.h"
#include "core/random.h"
#include "store/compare.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

/// The file must lie where its own attributes say.
void requirePlace(const fs::path& path, const GraspSet& set) {
  const fs::path wanted =
      Database(path.parent_path().parent_path().parent_path()).setPath(set.object, set.hand, set.setVersion);
  if (fs::absolute(path).lexically_normal() != fs::absolute(wanted).lexically_normal()) {
    throw InputError(fmt::format("{}: holds {} x {}, version {}, want it at {}", path.string(), set.object, set.hand,
                                 set.setVersion, wanted.string()));
  }
}

/// `count` of the indices below `size`, rising: one at random of each of so many equal parts; all when there are fewer.
std::vector<std::size_t> spreadSample(std::size_t size, std::size_t count, const RandomStream& random) {
  std::vector<std::size_t> chosen;
  count = std::min(count, size);
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t begin = i * size / count, end = (i + 1) * size / count;
    chosen.push_back(begin + static_cast<std::size_t>(random.uniform(i) * static_cast<double>(end - begin)));
  }
  return chosen;
}

/// What is recomputed of one set.
class Recomputation {
 public:
  Recomputation(const GraspSet& set, const Job& job, const Hand& hand, VerifyReport& report)
      : set_(set), job_(job), hand_(hand), report_(report) {
    item_.name = set.object;
    item_.mesh = "the stored mesh";
    item_.friction = set.friction;
    object_ = sampleObject(job_, item_, storedObject(set));
    again_ = emptySet(job_, object_, hand_);
  }

  /// What does not need a policy. False when it differs: then nothing else is comparable.
  bool checkInputs() {
    again_.setVersion = set_.setVersion;
    again_.inputHash = set_.inputHash;
    again_.objectNotes = set_.objectNotes;  // of the file that was loaded
    for (const std::string& dataset : differences(set_, again_)) {
      const auto isBelow = [&](std::string_view folder) { return dataset.starts_with(folder); };
      const bool ofTrials = isBelow("/trials") || isBelow("/grasps") || isBelow("/contacts") ||
                            dataset == "/distance_map/neighbor" || dataset == "/distance_map/weight";
      if (!ofTrials) report_.mismatches.push_back({dataset, "", ""});
    }
    return report_.mismatches.empty();
  }

  /// False when stopped.
  bool run(const std::vector<std::size_t>& rows, const std::vector<std::size_t>& trials,
           const std::shared_ptr<const HandFields>& fields, const std::atomic<bool>& cancel) {
    const auto policy = makePolicy(job_, hand_, object_.model, fields);
    const WrenchModel model = wrenchModel(job_, item_, object_.model, hand_);
    Cones cones(model);
    KeptQuality quality(job_, hand_, model, setKey(set_));
    Evaluation result;
    StageSeconds seconds;
    const auto evaluateTrial = [&](std::size_t trial) {
      evaluate(*policy, candidateAt(job_, object_.samples, hand_, trial), cones, result, seconds);
      compareTrial(trial, result);
    };
    std::vector<KeptGrasp> grasps;
    std::vector<std::size_t> comparable;
    for (const std::size_t row : rows) {
      if (cancel) return false;
      const std::size_t trial = trialOf(set_, row);
      evaluateTrial(trial);
      ++report_.grasps;
      if (result.trial.outcome != GraspOutcome::forceClosed) {
        addOnce(fmt::format("/grasps/trial of grasp {}", row), fmt::format("trial {}, force closed", trial),
                std::string(kOutcomeNames[static_cast<std::size_t>(result.trial.outcome)]));
        continue;
      }
      grasps.push_back(keptGrasp(trial, result));
      quality.compute(row, *policy, grasps.back());
      comparable.push_back(row);
    }
    addGrasps(job_, object_, hand_, grasps, again_);
    for (std::size_t i = 0; i < comparable.size(); ++i) {
      if (const auto difference = firstGraspDifference(set_, comparable[i], again_, i)) {
        addOnce(fmt::format("{} of grasp {}", difference->dataset, comparable[i]), difference->a, difference->b);
      }
    }
    for (const std::size_t trial : trials) {
      if (cancel) return false;
      evaluateTrial(trial);
      ++report_.trials;
    }
    return true;
  }

 private:
  void compareTrial(std::size_t trial, const Evaluation& result) {
    const std::string& outcome = set_.outcomeNames[set_.outcome[trial]];
    const std::string_view again = kOutcomeNames[static_cast<std::size_t>(result.trial.outcome)];
    if (outcome != again) addOnce(fmt::format("/trials/outcome of trial {}", trial), outcome, std::string(again));
    const float epsilon = set_.trialEpsilon[trial], epsilonAgain = static_cast<float>(result.epsilon);
    const bool equal = std::bit_cast<std::uint32_t>(epsilon) == std::bit_cast<std::uint32_t>(epsilonAgain) ||
                       (std::isnan(epsilon) && std::isnan(epsilonAgain));
    if (!equal) {
      addOnce(fmt::format("/trials/epsilon of trial {}", trial), fmt::format("{}", epsilon),
              fmt::format("{}", epsilonAgain));
    }
  }

  /// A grasp's trial may be in both samples.
  void addOnce(const std::string& where, const std::string& stored, const std::string& recomputed) {
    const bool known = std::any_of(report_.mismatches.begin(), report_.mismatches.end(),
                                   [&](const auto& mismatch) { return mismatch.where == where; });
    if (!known) report_.mismatches.push_back({where, stored, recomputed});
  }

  const GraspSet& set_;
  const Job& job_;
  const Hand& hand_;
  VerifyReport& report_;
  CatalogItem item_;
  SampledObject object_;
  GraspSet again_;
};

}  // namespace

std::optional<VerifyReport> SetVerifier::verify(const fs::path& path, std::size_t sample,
                                                const std::atomic<bool>& cancel) {
  VerifyReport report;
  GraspSet set;
  try {
    set = readGraspSet(path);
    requirePlace(path, set);
  } catch (const InputError& error) {
    report.state = VerifyReport::State::damaged;
    report.reason = error.what();
    return report;
  }
  if (sample == 0) return report;
  if (set.policy == kImportedPolicy) {
    report.state = VerifyReport::State::notRecomputed;
    report.reason = "cannot be recomputed: its grasps were imported";
    return report;
  }
  if (set.methodVersion != kMethodVersion) {
    report.state = VerifyReport::State::notRecomputed;
    report.reason = set.methodVersion == 0
                        ? std::string("cannot be recomputed: made before sets recorded the method's version")
                        : fmt::format("cannot be recomputed: made by version {} of the method, this program has {}",
                                      set.methodVersion, kMethodVersion);
    return report;
  }
  try {
    const Job job = parseJobSettings(set.job, "the stored job");
    const Hand hand = storedHand(set);
    Recomputation again(set, job, hand, report);
    if (again.checkInputs()) {
      const RandomStream random(hashText(fmt::format("{}/{}/{}", set.object, set.hand, set.setVersion)));
      const auto fields = fields_.of(job, hand, cancel);
      if (!again.run(spreadSample(set.graspCount(), sample, random.child(0)),
                     spreadSample(set.trialCount(), sample, random.child(1)), fields, cancel)) {
        return std::nullopt;
      }
    }
  } catch (const Cancelled&) {
    return std::nullopt;
  } catch (const InputError& error) {  // this version of the method made the set, so its record must do
    report.mismatches.push_back({error.what(), "", ""});
  }
  if (!report.mismatches.empty()) report.state = VerifyReport::State::differs;
  return report;
}

}  // namespace handhold
