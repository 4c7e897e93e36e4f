#include "app/commands.h"

#ifdef HANDHOLD_PHYSICS

#include "build/import_set.h"
#include "core/error.h"
#include "core/file.h"
#include "core/log.h"
#include "physics/calibrate.h"
#include "view/calibration_plot.h"

#include <cmath>
#include <cstdio>
#include <map>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

/// What was drawn of one hand's sets.
struct DrawnHand {
  HoldCalibration calibration;  // of the kind of its first set
  std::vector<LabelledObject> objects;
};

/// Draws and simulates the grasps of all sets, a line a set; nothing when stopped.
std::optional<std::map<std::string, DrawnHand>> drawSets(const PhysicsCommand& command,
                                                         const std::vector<SetFile>& files) {
  const std::atomic<bool>& stop = stopOnSignals();
  const JobSystem jobs(command.threads);
  SetLoader loader(command.friction);
  GraspLabeller labeller;
  std::map<std::string, DrawnHand> hands;
  fmt::print("| object | hand | stored held | trials held |\n|---|---|---|---|\n");
  for (const SetFile& file : files) {
    const std::unique_ptr<SimulatedSet> set = loader.load(file.path);
    if (set->set().policy == kImportedPolicy) {
      logWarning(fmt::format("{}: imported grasps have no trials to draw from, they are left out", file.path.string()));
      continue;
    }
    DrawnHand& hand = hands[file.hand];
    if (hand.objects.empty()) {
      hand.calibration = calibrationOf(*set, command.seed);
      hand.calibration.path = file.path.string();
    }
    requireSameKind(hand.calibration, set->set(), file.path.string());
    auto grasps = labeller.label(*set, command.draw, command.seed, jobs, stop);
    if (!grasps) return std::nullopt;
    hand.objects.push_back({file.object, std::move(*grasps)});
    const HoldCalibration::Object counts = countObject(hand.objects.back());
    fmt::print("| {} | {} | {} of {} | {} of {} |\n", file.object, file.hand, counts.storedHeld, counts.stored,
               counts.trialsHeld, counts.trials);
    std::fflush(stdout);
  }
  return hands;
}

std::string number(double value) { return std::isnan(value) ? "-" : fmt::format("{:.3f}", value); }

void printMeasures(const HoldCalibration& calibration) {
  fmt::print("\n| {}: model | of | grasps | held | AUC | AUC in an object | Brier | log loss | ECE |\n",
             calibration.hand);
  fmt::print("|---|---|---|---|---|---|---|---|---|\n");
  for (const auto& [group, measures] : {std::pair("all", &HoldModel::all), std::pair("stored", &HoldModel::stored)}) {
    for (const HoldModel& model : calibration.models) {
      const HoldMeasures& m = model.*measures;
      fmt::print("| {} | {} | {} | {} | {} | {} | {} | {} | {} |\n", model.name, group, m.grasps, m.held, number(m.auc),
                 number(m.aucInObject), number(m.brier), number(m.logLoss), number(m.calibrationError));
    }
  }
}

ReliabilityPanel panelOf(const std::string& name, const std::vector<Prediction>& predictions) {
  ReliabilityPanel panel{name, {}};
  const auto bins = reliabilityBins(predictions);
  for (std::size_t i = 0; i < bins.size(); ++i) {
    const ReliabilityBin& bin = bins[i];
    if (bin.grasps == 0) continue;
    const Proportion held(static_cast<int>(bin.held), static_cast<int>(bin.grasps));
    const double middle = (static_cast<double>(i) + 0.5) / static_cast<double>(bins.size());
    panel.bins.push_back({middle, bin.meanProbability, held.share, held.lower, held.upper, bin.grasps});
  }
  return panel;
}

/// Both pictures, of what the models said of objects that they had not seen.
void drawPlots(const std::string& hand, const CalibratedHand& calibrated, const fs::path& folder) {
  std::vector<RocSeries> series;
  std::vector<ReliabilityPanel> panels;
  for (std::size_t i = 0; i < calibrated.models.size(); ++i) {
    const HoldModel& model = calibrated.models[i];
    if (model.terms.empty()) continue;  // it ranks nothing
    series.push_back({fmt::format("{}, AUC {:.3f}", model.name, model.all.auc), rocCurve(calibrated.predictions[i])});
    if (model.name != kRankModel && model.name != kSettledModel) continue;
    panels.push_back(
        panelOf(fmt::format("{}, ECE {:.3f}", model.name, model.all.calibrationError), calibrated.predictions[i]));
  }
  replaceContent(folder / fmt::format("roc-{}.svg", hand), rocSvg(fmt::format("Does it hold? {}", hand), series));
  replaceContent(folder / fmt::format("reliability-{}.svg", hand),
                 reliabilitySvg(fmt::format("Probability that a grasp holds, {}", hand), panels));
}

}  // namespace

int runCalibration(const PhysicsCommand& command, const Database& database) {
  const std::vector<SetFile> files = pickedSets(database, command);
  createFolders(command.calibrate);
  const auto hands = drawSets(command, files);
  if (!hands) {
    logWarning("stopped before all sets were simulated, nothing is written");
    return kExitItemFailed;
  }
  bool allDone = true;
  for (const auto& [name, hand] : *hands) {
    if (const std::string why = whyNotCalibrated(hand.objects); !why.empty()) {
      logError(fmt::format("{}: nothing to tell apart: {}; no model is written", name, why));
      allDone = false;
      continue;
    }
    const CalibratedHand calibrated = calibrateHand(hand.objects);
    HoldCalibration calibration = hand.calibration;
    addResults(hand.objects, calibrated, calibration);
    const fs::path path = fs::path(command.calibrate) / fmt::format("calibration-{}.yaml", name);
    writeCalibration(path, calibration);
    drawPlots(name, calibrated, command.calibrate);
    printMeasures(calibration);
    fmt::print("{}\n", path.string());
  }
  return allDone ? kExitDone : kExitItemFailed;
}

}  // namespace handhold

#endif
