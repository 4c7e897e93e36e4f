// Times the fast policy beside the reference on the same candidates, and holds both against a finer reference, in one
// run.
//
//     bench_policy [--json [FILE]] [--quick]
//
// Prints tables; `--json` prints JSON instead, `--json FILE` writes it beside the tables. Every timed trial is another
// candidate: a repeated one trains the branch predictor. With HANDHOLD_DATA more hands and OpenRAVE's mug are added.
#include "bench/options.h"
#include "build/build_set.h"
#include "build/evaluate.h"
#include "core/file.h"
#include "store/database.h"
#include "support/brute_force.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <numbers>
#include <numeric>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <fmt/core.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

namespace fs = std::filesystem;
using Eigen::Isometry3d;
using Eigen::Vector3d;
using nlohmann::ordered_json;

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kFriction = 0.5;

struct Sizes {
  std::size_t fast = 4000;          // candidates of a pair, each once
  std::size_t reference = 200;      // of them
  std::size_t accuracy = 1000;      // candidates for the finer references
  std::size_t contacts = 100;       // force-closed trials whose contacts are measured
  std::size_t buildSamples = 2000;  // of a whole build, 0: none
};
constexpr Sizes kQuick = {300, 40, 40, 10, 0};

// --- what is run

double secondsNow() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

struct LoadedHand {
  Hand hand;
  std::shared_ptr<const HandFields> fields;
  double fieldsSeconds = 0;
};

LoadedHand withFields(Hand hand) {
  LoadedHand loaded{std::move(hand), nullptr, 0};
  const double start = secondsNow();
  loaded.fields = makeHandFields(loaded.hand);
  loaded.fieldsSeconds = secondsNow() - start;
  return loaded;
}

/// One hand and one object with all candidates of a job.
struct Setting {
  const Job& job;
  const LoadedHand& hand;
  const SampledObject& object;

  WrenchModel model() const { return wrenchModel(job, *object.item, object.model, hand.hand); }
  std::size_t trials() const { return object.samples.size() * job.rolls * hand.hand.preshapes.size(); }
  std::unique_ptr<GraspPolicy> reference(const ReferenceSettings& settings = {}) const {
    return makeReferencePolicy(hand.hand, object.model, job.policy, settings);
  }
  std::unique_ptr<GraspPolicy> fast() const {
    return makeFastPolicy(hand.fields, hand.hand, object.model, job.policy, policySettings(job));
  }

  /// Candidate `i` of `count` that are spread evenly. The stride has no divisor in common with N*R*M, so that every
  /// roll and preshape occurs; the second half of each stride is for those that must differ from the first's.
  GraspCandidate candidate(std::size_t i, std::size_t count, bool second = false) const {
    const std::size_t all = trials();
    std::size_t stride = std::max<std::size_t>(1, all / count);
    while (std::gcd(stride, all) > 1) --stride;
    return candidateAt(job, object.samples, hand.hand, (i * stride + (second ? stride / 2 : 0)) % all);
  }
};

/// A number of values and their quantiles.
class Sample {
 public:
  void add(double value) { values_.push_back(value); }
  void add(const Sample& other) { values_.insert(values_.end(), other.values_.begin(), other.values_.end()); }
  std::size_t size() const { return values_.size(); }
  double mean() const { return std::accumulate(values_.begin(), values_.end(), 0.0) / static_cast<double>(size()); }
  double quantile(double q) const {
    if (values_.empty()) return std::nan("");
    std::vector<double> sorted = values_;
    const auto at = sorted.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(size() - 1));
    std::nth_element(sorted.begin(), at, sorted.end());
    return *at;
  }
  ordered_json json() const {
    if (values_.empty()) return nullptr;
    return {{"p50", quantile(0.5)}, {"p99", quantile(0.99)}, {"p99.9", quantile(0.999)}, {"max", quantile(1)}};
  }

 private:
  std::vector<double> values_;
};

// --- times

/// What trials of one policy took, each timed on its own, and what came of them.
struct Times {
  Sample policy;  // us
  StageSeconds stages;
  std::size_t closed = 0, byReference = 0;
  Evaluation result;  // of the last trial; its memory is used again, as in a build

  double secondsATrial() const {
    return (stages.policy + stages.forceClosure + stages.epsilon + stages.approach) /
           static_cast<double>(policy.size());
  }
  ordered_json json() const {
    const auto n = static_cast<double>(policy.size());
    return {{"trials", policy.size()},
            {"median_us", policy.quantile(0.5)},
            {"p90_us", policy.quantile(0.9)},
            {"mean_us", policy.mean()},
            {"policy_us", 1e6 * stages.policy / n},
            {"force_closure_us", 1e6 * stages.forceClosure / n},
            {"epsilon_us", 1e6 * stages.epsilon / n},
            {"approach_us", 1e6 * stages.approach / n},
            {"trials_per_second", 1 / secondsATrial()},
            {"force_closed_share", static_cast<double>(closed) / n},
            {"grasps_per_second", static_cast<double>(closed) / n / secondsATrial()},
            {"by_reference", byReference}};
  }
};

void timeTrial(GraspPolicy& policy, const GraspCandidate& candidate, Cones& cones, Times& times) {
  StageSeconds seconds;
  evaluate(policy, candidate, cones, times.result, seconds);
  times.policy.add(1e6 * seconds.policy);
  times.stages.add(seconds, 1);
  times.closed += times.result.trial.outcome == GraspOutcome::forceClosed;
  times.byReference += times.result.trial.byReference;
}

/// Trials a second through evaluate() on all cores, on candidates that were not run before.
double trialsPerSecondOnAllCores(const Setting& setting, const GraspPolicy& policy, std::size_t count) {
  struct alignas(64) Worker {
    Cones cones;
    std::unique_ptr<GraspPolicy> policy;
    Evaluation result;
    StageSeconds seconds;
  };
  const JobSystem jobs;
  std::vector<Worker> workers;
  for (int i = 0; i < jobs.threads(); ++i) workers.push_back({Cones(setting.model()), policy.clone(), {}, {}});
  const double start = secondsNow();
  jobs.run(count, 1, [&](int index, std::size_t i) {
    Worker& worker = workers[index];
    evaluate(*worker.policy, setting.candidate(i, count, true), worker.cones, worker.result, worker.seconds);
  });
  return static_cast<double>(count) / (secondsNow() - start);
}

/// The reference on some of the candidates, the fast policy on all, in turns on one core; then each on all cores.
ordered_json benchTimes(const Setting& setting, const Sizes& sizes) {
  const auto reference = setting.reference(policySettings(setting.job)), fast = setting.fast();
  Cones cones(setting.model());
  Times ofReference, ofFast;
  std::size_t every = std::max<std::size_t>(1, sizes.fast / sizes.reference);
  while (std::gcd(every, setting.trials()) > 1) --every;
  for (std::size_t i = 0; i < sizes.fast; ++i) {
    const GraspCandidate candidate = setting.candidate(i, sizes.fast);
    if (i % every == 0) timeTrial(*reference, candidate, cones, ofReference);
    timeTrial(*fast, candidate, cones, ofFast);
  }
  ordered_json result = {{"reference", ofReference.json()}, {"fast", ofFast.json()}};
  result["reference"]["trials_per_second_all_cores"] = trialsPerSecondOnAllCores(setting, *reference, sizes.reference);
  result["fast"]["trials_per_second_all_cores"] = trialsPerSecondOnAllCores(setting, *fast, sizes.fast);
  result["ratio_of_medians"] = ofReference.policy.quantile(0.5) / ofFast.policy.quantile(0.5);
  result["ratio_of_means"] = ofReference.policy.mean() / ofFast.policy.mean();
  return result;
}

// --- accuracy

/// The reference that others are held against, and one at half its steps that tells where it can be trusted.
ReferenceSettings fineSettings(const Job& job, double factor) {
  ReferenceSettings settings = policySettings(job);
  settings.linearStep = factor * 5e-4;
  settings.angularStep = factor * 0.5 * kDegree;
  settings.linearTolerance = 1e-6;
  settings.angularTolerance = 1e-5;
  return settings;
}

constexpr double kSettledMm = 0.1, kSettledDegrees = 0.1;

/// How far two trials of one candidate are apart.
struct Difference {
  double backoffMm = 0, handMm = 0;             // hand: of the root link's origin, centring included
  double revoluteDegrees = 0, prismaticMm = 0;  // of the joint that differs most
  bool sameLinks = false;

  bool isSettled() const {
    return backoffMm <= kSettledMm && handMm <= kSettledMm && revoluteDegrees <= kSettledDegrees &&
           prismaticMm <= kSettledMm && sameLinks;
  }
};

std::set<int> touchedLinks(const GraspTrial& trial) {
  std::set<int> links;
  for (const ClosingStop& stop : trial.stops) links.insert(stop.links.begin(), stop.links.end());
  return links;
}

Difference differenceOf(const Hand& hand, const GraspTrial& a, const GraspTrial& b) {
  Difference difference;
  difference.backoffMm = 1e3 * std::abs(a.backoff - b.backoff);
  difference.handMm = 1e3 * (a.X_OH.translation() - b.X_OH.translation()).norm();
  for (std::size_t i = 0; i < hand.joints.size(); ++i) {
    const double apart = std::abs(a.jointPosition[i] - b.jointPosition[i]);
    if (hand.joints[i].type == JointType::revolute) {
      difference.revoluteDegrees = std::max(difference.revoluteDegrees, apart / kDegree);
    } else {
      difference.prismaticMm = std::max(difference.prismaticMm, 1e3 * apart);
    }
  }
  difference.sameLinks = touchedLinks(a) == touchedLinks(b);
  return difference;
}

bool isForceClosed(const GraspTrial& trial, const WrenchModel& model) {
  return trial.outcome == GraspOutcome::notForceClosed &&
         testForceClosure(frictionConeWrenches(trial.contacts, model)).verdict == ForceClosure::closed;
}

/// The trials of one policy against those of the fine reference.
struct Accuracy {
  Sample backoff, hand, revolute, prismatic;
  std::size_t trials = 0, sameLinks = 0, sameVerdict = 0;

  void add(const Hand& model, const Difference& difference, bool verdictsAgree) {
    ++trials;
    backoff.add(difference.backoffMm);
    hand.add(difference.handMm);
    const auto isRevolute = [](const Joint& joint) { return joint.type == JointType::revolute; };
    if (std::any_of(model.joints.begin(), model.joints.end(), isRevolute)) revolute.add(difference.revoluteDegrees);
    if (!std::all_of(model.joints.begin(), model.joints.end(), isRevolute)) prismatic.add(difference.prismaticMm);
    sameLinks += difference.sameLinks;
    sameVerdict += verdictsAgree;
  }
  ordered_json json() const {
    const auto n = static_cast<double>(trials);
    return {{"backoff_mm", backoff.json()},
            {"hand_mm", hand.json()},
            {"revolute_degrees", revolute.json()},
            {"prismatic_mm", prismatic.json()},
            {"same_links_share", static_cast<double>(sameLinks) / n},
            {"same_verdict_share", static_cast<double>(sameVerdict) / n}};
  }
};

/// One candidate by all four policies.
struct Comparison {
  Difference settling;  // of the fine reference and the one at half its steps
  Difference fast, reference;
  bool fastVerdict = false, referenceVerdict = false;  // agree with the fine reference's
};

Comparison compare(const Setting& setting, const GraspCandidate& candidate,
                   const std::vector<std::unique_ptr<GraspPolicy>>& policies) {
  GraspTrial trials[4];  // fine, half, fast, reference
  for (std::size_t i = 0; i < 4; ++i) policies[i]->run(candidate, trials[i]);
  const Hand& hand = setting.hand.hand;
  const WrenchModel model = setting.model();
  const bool closed = isForceClosed(trials[0], model);
  return {differenceOf(hand, trials[0], trials[1]), differenceOf(hand, trials[0], trials[2]),
          differenceOf(hand, trials[0], trials[3]), isForceClosed(trials[2], model) == closed,
          isForceClosed(trials[3], model) == closed};
}

ordered_json benchAccuracy(const Setting& setting, const Sizes& sizes) {
  const JobSystem jobs;
  std::vector<std::vector<std::unique_ptr<GraspPolicy>>> policies(jobs.threads());
  policies[0].push_back(setting.reference(fineSettings(setting.job, 1)));
  policies[0].push_back(setting.reference(fineSettings(setting.job, 0.5)));
  policies[0].push_back(setting.fast());
  policies[0].push_back(setting.reference(policySettings(setting.job)));
  for (std::size_t worker = 1; worker < policies.size(); ++worker) {
    for (std::size_t i = 0; i < 4; ++i) policies[worker].push_back(policies[0][i]->clone());
  }
  std::vector<Comparison> comparisons(sizes.accuracy);
  jobs.run(sizes.accuracy, 1, [&](int worker, std::size_t i) {
    comparisons[i] = compare(setting, setting.candidate(i, sizes.accuracy), policies[worker]);
  });
  Accuracy fast, reference;
  for (const Comparison& comparison : comparisons) {
    if (!comparison.settling.isSettled()) continue;
    fast.add(setting.hand.hand, comparison.fast, comparison.fastVerdict);
    reference.add(setting.hand.hand, comparison.reference, comparison.referenceVerdict);
  }
  const std::size_t apart = sizes.accuracy - fast.trials;
  return {{"trials", sizes.accuracy},
          {"set_apart", apart},
          {"set_apart_share", static_cast<double>(apart) / static_cast<double>(sizes.accuracy)},
          {"fast", fast.json()},
          {"reference", reference.json()}};
}

// --- contacts

struct ContactErrors {
  std::size_t trials = 0, contacts = 0;
  double toObject = 0, toLink = 0, angle = 0;  // largest, m and rad
};

/// The angle between a contact's normal and the inward normal of the object's triangle there; on an edge, of the one
/// that fits best. On open objects a normal may have either sign.
double normalAngle(const Contact& contact, const ObjectModel& object, double distance) {
  constexpr double kSamePlace = 1e-7;  // m
  double best = std::numbers::pi;
  for (std::size_t i = 0; i < object.mesh.triangles.size(); ++i) {
    const Vector3d closest = closestPointOnTriangle(contact.position, object.mesh.corners(i));
    if ((closest - contact.position).norm() > distance + kSamePlace) continue;
    const Vector3d normal = object.mesh.normal(i);
    double cosine = -normal.dot(contact.normal);
    if (!object.watertight) cosine = std::abs(cosine);
    best = std::min(best, std::atan2(normal.cross(contact.normal).norm(), cosine));
  }
  return best;
}

void measureContacts(const Setting& setting, const GraspTrial& trial, ContactErrors& errors) {
  const Hand& hand = setting.hand.hand;
  const std::vector<Isometry3d> X_HL = forwardKinematics(hand, trial.jointPosition);
  ++errors.trials;
  for (const Contact& contact : trial.contacts) {
    ++errors.contacts;
    const double toObject = testing::distanceTo(contact.position, setting.object.model.mesh);
    const Isometry3d X_LO = (trial.X_OH * X_HL[contact.link]).inverse();
    errors.toObject = std::max(errors.toObject, toObject);
    errors.toLink =
        std::max(errors.toLink, testing::distanceTo(X_LO * contact.position, hand.links[contact.link].mesh));
    errors.angle = std::max(errors.angle, normalAngle(contact, setting.object.model, toObject));
  }
}

/// Contacts of force-closed trials of the fast policy, as they would be stored, against every triangle.
ordered_json benchContacts(const Setting& setting, const Sizes& sizes) {
  const auto policy = setting.fast();
  Cones cones(setting.model());
  ContactErrors errors;
  Evaluation result;
  StageSeconds seconds;
  for (std::size_t i = 0; i < sizes.fast && errors.trials < sizes.contacts; ++i) {
    evaluate(*policy, setting.candidate(i, sizes.fast), cones, result, seconds);
    if (result.trial.outcome == GraspOutcome::forceClosed) measureContacts(setting, result.trial, errors);
  }
  return {{"trials", errors.trials},
          {"contacts", errors.contacts},
          {"largest_to_object_mm", 1e3 * errors.toObject},
          {"largest_to_link_mm", 1e3 * errors.toLink},
          {"largest_normal_degrees", errors.angle / kDegree}};
}

// --- whole builds

struct BuildRun {
  std::string simulation;
  int threads;
};

/// Builds the mug with the Barrett hand's first four preshapes by the `handhold` program beside this one.
ordered_json runBuild(const BuildRun& run, const Sizes& sizes, const fs::path& folder) {
  const Hand hand = loadHand(HANDHOLD_SOURCE_DIR "/hands/barrett");
  std::string preshapes;
  for (std::size_t i = 0; i < 4; ++i) preshapes += (i > 0 ? ", " : "") + hand.preshapes[i].name;
  const fs::path job = folder / fmt::format("{}_{}.yaml", run.simulation, run.threads);
  std::ofstream(job) << "catalog:\n  - {name: mug, mesh: " HANDHOLD_SOURCE_DIR "/meshes/mug.obj, unit: m}\n"
                     << "hands: [" HANDHOLD_SOURCE_DIR "/hands/barrett]\n"
                     << fmt::format("sampling: {{samples: {}, rolls: 16, preshapes: [{}]}}\n", sizes.buildSamples,
                                    preshapes)
                     << "simulation: " << run.simulation << "\nquality: {friction: " << kFriction << "}\n";
  const fs::path database = folder / job.stem();
  const std::string command = fmt::format("'{}' build '{}' --db '{}' --threads {} --progress none > '{}' 2>&1",
                                          (programFolder() / "handhold").string(), job.string(), database.string(),
                                          run.threads, (folder / "output.txt").string());
  const double start = secondsNow();
  if (std::system(command.c_str()) != 0) return {{"failed", readFile(folder / "output.txt")}};
  const double seconds = secondsNow() - start;
  const GraspSetSummary summary = readSummary(Database(database).setPath("mug", "barrett", 1));
  ordered_json stages;
  for (const auto& [stage, duration] : summary.seconds) stages[stage] = duration;
  const std::size_t trials = summary.samples * summary.rolls * summary.preshapes;
  return {{"simulation", run.simulation},
          {"threads", run.threads},
          {"trials", trials},
          {"wall_seconds", seconds},
          {"trials_per_second", static_cast<double>(trials) / seconds},
          {"stages", stages},
          {"force_closed_share", static_cast<double>(summary.outcomes[0].second) / static_cast<double>(trials)},
          {"grasps", summary.grasps},
          {"by_reference", summary.trialsByReference}};
}

ordered_json benchBuilds(const Sizes& sizes) {
  ordered_json results = ordered_json::array();
  if (sizes.buildSamples == 0) return results;
  std::string name = (fs::temp_directory_path() / "bench-policy-XXXXXX").string();
  const fs::path folder = ::mkdtemp(name.data());
  for (const BuildRun& run : {BuildRun{"fast", 1}, BuildRun{"fast", 2}, BuildRun{"reference", 2}}) {
    results.push_back(runBuild(run, sizes, folder));
  }
  fs::remove_all(folder);
  return results;
}

// --- OpenRAVE's own test

constexpr double kOpenRaveTrialsPerSecond = 19.3, kOpenRaveClosedShare = 0.176;
constexpr const char* kOpenRaveReasons[] = {
    "Equal: the object, the kind of hand, 20 mm grids, 4 rolls, 1 preshape, 2 standoffs (0, 25 mm), friction 0.3, 8 "
    "edges.",
    "Rays: OpenRAVE casts them from the box grown by 10 mm (138 hits), and its hand model and preshape are its own.",
    "Standoffs: its palm comes from outside in steps of 10 mm and retreats in steps of 50 mm before the standoff is "
    "added; "
    "ours takes the first free place from the surface on, and from the standoff behind it on.",
    "Contacts: those that the ODE checker reports after closing in steps of 0.1 rad; ours are pairs of points at most "
    "0.1 mm apart.",
    "Force closure: its torques are about the origin of the mesh file, without a length; the verdict is the same in "
    "theory.",
    "OpenRAVE was timed on one thread, earlier and not in this run: 64 % of its time is Qhull, the rest its policy."};

/// OpenRAVE 0.149.1, its Barrett hand and script on its mug: 1104 trials, 19.3 a second, 17.6 % force closed.
ordered_json benchOpenRave(const fs::path& data) {
  Job job;
  job.pitch = 0.02;
  job.rolls = 4;
  job.friction = 0.3;
  CatalogItem item;
  item.name = "mug1";
  item.mesh = (data / "meshes/openrave/mug1.dae").string();
  item.unit = {1, true, "m"};
  item.friction = job.friction;
  const SampledObject object = loadSampledObject(job, item);
  Hand barrett = loadHand(HANDHOLD_SOURCE_DIR "/hands/barrett");
  const auto chosen = std::find_if(barrett.preshapes.begin(), barrett.preshapes.end(),
                                   [](const Preshape& preshape) { return preshape.name == "spread_60"; });
  const Preshape at0 = *chosen;
  Preshape at25 = at0;
  at25.standoff = 0.025;
  barrett.preshapes = {at0, at25};
  const LoadedHand hand = withFields(std::move(barrett));
  const Setting setting{job, hand, object};
  const auto reference = setting.reference(), fast = setting.fast();
  Cones cones(setting.model());
  Times ofReference, ofFast;
  for (std::size_t trial = 0; trial < setting.trials(); ++trial) {
    const GraspCandidate candidate = candidateAt(job, object.samples, hand.hand, trial);
    timeTrial(*reference, candidate, cones, ofReference);
    timeTrial(*fast, candidate, cones, ofFast);
  }
  return {{"samples", object.samples.size()},
          {"trials", setting.trials()},
          {"fast", ofFast.json()},
          {"reference", ofReference.json()},
          {"openrave", {{"trials_per_second", kOpenRaveTrialsPerSecond}, {"force_closed_share", kOpenRaveClosedShare}}},
          {"ratio_of_rates", 1 / ofFast.secondsATrial() / kOpenRaveTrialsPerSecond},
          {"reasons", kOpenRaveReasons}};
}

// --- the report

std::string cpuModel() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  }
  return "unknown";
}

/// Median seconds between two readings of the clock; part of every stage's time.
double clockCost() {
  Sample costs;
  for (int i = 0; i < 2000; ++i) {
    const double before = secondsNow();
    costs.add(secondsNow() - before);
  }
  return costs.quantile(0.5);
}

ordered_json machine() {
  return {{"cpu", cpuModel()},
          {"cores", std::thread::hardware_concurrency()},
          {"compiler", __VERSION__},
          {"build_type", HANDHOLD_BUILD_TYPE},
          {"clock_us", 1e6 * clockCost()},
          {"friction", kFriction},
          {"cone_edges", Job{}.coneEdges}};
}

SampledObject loadShipped(const Job& job, CatalogItem& item, const std::string& file) {
  item.name = fs::path(file).stem().string();
  item.mesh = HANDHOLD_SOURCE_DIR "/meshes/" + file;
  item.unit = {1, true, "m"};
  item.friction = job.friction;
  return loadSampledObject(job, item);
}

ordered_json benchPair(const Setting& setting, const Sizes& sizes) {
  fmt::print(stderr, "{} x {}\n", setting.object.item->name, setting.hand.hand.name);
  ordered_json result = {{"hand", setting.hand.hand.name}, {"object", setting.object.item->name}};
  result["fields_seconds"] = setting.hand.fieldsSeconds;
  result["times"] = benchTimes(setting, sizes);
  result["accuracy"] = benchAccuracy(setting, sizes);
  result["contacts"] = benchContacts(setting, sizes);
  return result;
}

ordered_json benchAll(const Sizes& sizes) {
  Job job;
  job.samples = 2000;
  job.friction = kFriction;
  const std::vector<std::string> files = {"mug.obj", "t_bar.ply", "bottle.stl"};
  std::vector<CatalogItem> items(files.size());
  std::vector<SampledObject> objects;
  for (std::size_t i = 0; i < files.size(); ++i) objects.push_back(loadShipped(job, items[i], files[i]));

  ordered_json report = {{"machine", machine()}, {"pairs", ordered_json::array()}};
  for (const char* name : {"barrett", "hrp2", "jaw"}) {
    const LoadedHand hand = withFields(loadHand(std::string(HANDHOLD_SOURCE_DIR "/hands/") + name));
    for (const SampledObject& object : objects) report["pairs"].push_back(benchPair({job, hand, object}, sizes));
  }
  const char* data = std::getenv("HANDHOLD_DATA");
  if (data != nullptr) {
    for (const char* name : {"barrett_bh280", "robotiq_2f85", "allegro_right", "franka_hand"}) {
      const LoadedHand hand = withFields(loadHand(std::string(HANDHOLD_SOURCE_DIR "/tests/data/hands/") + name));
      report["pairs"].push_back(benchPair({job, hand, objects[0]}, sizes));
    }
    report["openrave"] = benchOpenRave(data);
  }
  report["builds"] = benchBuilds(sizes);
  return report;
}

// --- tables

/// A number at a path inside JSON, "-" where there is none.
std::string cell(const ordered_json& value, int decimals) {
  return value.is_number() ? fmt::format("{:.{}f}", value.get<double>(), decimals) : "-";
}

std::string percent(const ordered_json& share, int decimals = 1) {
  return share.is_number() ? fmt::format("{:.{}f}", 100 * share.get<double>(), decimals) : "-";
}

std::string nameOf(const ordered_json& pair) {
  return fmt::format("{:<14} {:<7}", pair["hand"].get<std::string>(), pair["object"].get<std::string>());
}

void printTimes(const ordered_json& pairs) {
  fmt::print("\nPolicy alone, one core: microseconds a trial, every trial another candidate\n");
  fmt::print("{:<22} {:>8} {:>9} {:>9} {:>9} {:>8} {:>9} {:>9} {:>9} {:>9} {:>10} {:>11} {:>10}\n", "hand, object",
             "ref n", "ref med", "ref p90", "ref mean", "fast n", "fast med", "fast p90", "fast mean", "ratio med",
             "ratio mean", "handed on %", "fields [s]");
  for (const ordered_json& pair : pairs) {
    const ordered_json &reference = pair["times"]["reference"], &fast = pair["times"]["fast"];
    const double handedOn = fast["by_reference"].get<double>() / fast["trials"].get<double>();
    fmt::print("{:<22} {:>8} {:>9} {:>9} {:>9} {:>8} {:>9} {:>9} {:>9} {:>9} {:>10} {:>11} {:>10}\n", nameOf(pair),
               cell(reference["trials"], 0), cell(reference["median_us"], 1), cell(reference["p90_us"], 1),
               cell(reference["mean_us"], 1), cell(fast["trials"], 0), cell(fast["median_us"], 1),
               cell(fast["p90_us"], 1), cell(fast["mean_us"], 1), cell(pair["times"]["ratio_of_medians"], 1),
               cell(pair["times"]["ratio_of_means"], 1), fmt::format("{:.2f}", 100 * handedOn),
               cell(pair["fields_seconds"], 2));
  }
}

void printRates(const ordered_json& pairs) {
  fmt::print("\nPolicy, force closure, epsilon, approach: rates, and microseconds a trial by stage (mean)\n");
  fmt::print("{:<22} {:<9} {:>13} {:>14} {:>8} {:>11} {:>9} {:>13} {:>8} {:>9}\n", "hand, object", "policy",
             "trials/s core", "trials/s cores", "FC %", "FC grasps/s", "policy", "force closure", "epsilon",
             "approach");
  for (const ordered_json& pair : pairs) {
    for (const char* policy : {"reference", "fast"}) {
      const ordered_json& times = pair["times"][policy];
      fmt::print("{:<22} {:<9} {:>13} {:>14} {:>8} {:>11} {:>9} {:>13} {:>8} {:>9}\n", nameOf(pair), policy,
                 cell(times["trials_per_second"], 0), cell(times["trials_per_second_all_cores"], 0),
                 percent(times["force_closed_share"]), cell(times["grasps_per_second"], 0), cell(times["policy_us"], 1),
                 cell(times["force_closure_us"], 2), cell(times["epsilon_us"], 2), cell(times["approach_us"], 2));
    }
  }
}

std::string quantiles(const ordered_json& sample) {
  if (sample.is_null()) return "-";
  return fmt::format("{} {} {} {}", cell(sample["p50"], 3), cell(sample["p99"], 3), cell(sample["p99.9"], 3),
                     cell(sample["max"], 3));
}

void printAccuracy(const ordered_json& pairs) {
  fmt::print(
      "\nAgainst the reference at 0.5 mm and 0.5 degrees: p50 p99 p99.9 max of the difference; joints: the one "
      "that differs most.\nSet apart, not counted: where that reference at half its steps differs from it by "
      "more than {} mm, {} degrees, or in links.\n",
      kSettledMm, kSettledDegrees);
  fmt::print("{:<22} {:<9} {:>6} {:>11} {:>28} {:>28} {:>28} {:>28} {:>7} {:>9}\n", "hand, object", "policy", "trials",
             "apart (%)", "back-off [mm]", "hand [mm]", "revolute [degrees]", "prismatic [mm]", "links %", "verdict %");
  for (const ordered_json& pair : pairs) {
    for (const char* policy : {"reference", "fast"}) {
      const ordered_json &all = pair["accuracy"], &one = all[policy];
      fmt::print(
          "{:<22} {:<9} {:>6} {:>11} {:>28} {:>28} {:>28} {:>28} {:>7} {:>9}\n", nameOf(pair), policy,
          cell(all["trials"], 0), fmt::format("{} ({})", cell(all["set_apart"], 0), percent(all["set_apart_share"])),
          quantiles(one["backoff_mm"]), quantiles(one["hand_mm"]), quantiles(one["revolute_degrees"]),
          quantiles(one["prismatic_mm"]), percent(one["same_links_share"], 2), percent(one["same_verdict_share"], 2));
    }
  }
}

void printContacts(const ordered_json& pairs) {
  fmt::print(
      "\nStored contacts of force-closed trials of the fast policy against every triangle: the largest of each\n");
  fmt::print("{:<22} {:>7} {:>9} {:>17} {:>13} {:>17}\n", "hand, object", "trials", "contacts", "to object [mm]",
             "to link [mm]", "normal [degrees]");
  for (const ordered_json& pair : pairs) {
    const ordered_json& contacts = pair["contacts"];
    fmt::print("{:<22} {:>7} {:>9} {:>17} {:>13} {:>17}\n", nameOf(pair), cell(contacts["trials"], 0),
               cell(contacts["contacts"], 0), cell(contacts["largest_to_object_mm"], 6),
               cell(contacts["largest_to_link_mm"], 4), cell(contacts["largest_normal_degrees"], 4));
  }
}

void printBuilds(const ordered_json& builds) {
  if (builds.empty()) return;
  fmt::print("\nWhole builds by the program: mug, Barrett hand, four preshapes\n");
  fmt::print("{:<10} {:>7} {:>7} {:>9} {:>10} {:>7} {:>7} {:>12}  {}\n", "simulation", "threads", "trials", "wall [s]",
             "trials/s", "FC %", "ratio", "by reference", "stages, core seconds");
  const ordered_json& slowest = builds.back();
  for (const ordered_json& build : builds) {
    if (build.contains("failed")) {
      fmt::print("failed: {}\n", build["failed"].get<std::string>());
      continue;
    }
    std::string stages;
    for (const auto& [stage, seconds] : build["stages"].items())
      stages += fmt::format("{} {} ", stage, cell(seconds, 3));
    const double ratio = slowest.value("wall_seconds", std::nan("")) / build["wall_seconds"].get<double>();
    fmt::print("{:<10} {:>7} {:>7} {:>9} {:>10} {:>7} {:>7.2f} {:>12}  {}\n", build["simulation"].get<std::string>(),
               cell(build["threads"], 0), cell(build["trials"], 0), cell(build["wall_seconds"], 2),
               cell(build["trials_per_second"], 0), percent(build["force_closed_share"], 2), ratio,
               cell(build["by_reference"], 0), stages);
  }
  fmt::print("ratio: wall seconds of the last line to this one's\n");
}

void printOpenRave(const ordered_json& result) {
  fmt::print("\nOpenRAVE's mug1: {} samples, {} trials, one core\n", cell(result["samples"], 0),
             cell(result["trials"], 0));
  fmt::print("{:<10} {:>9} {:>7}\n", "", "trials/s", "FC %");
  for (const char* who : {"openrave", "reference", "fast"}) {
    fmt::print("{:<10} {:>9} {:>7}\n", who, cell(result[who]["trials_per_second"], 1),
               percent(result[who]["force_closed_share"]));
  }
  for (const ordered_json& reason : result["reasons"]) fmt::print("- {}\n", reason.get<std::string>());
}

void printTables(const ordered_json& report) {
  fmt::print("{}\n", report["machine"].dump());
  printTimes(report["pairs"]);
  printRates(report["pairs"]);
  printAccuracy(report["pairs"]);
  printContacts(report["pairs"]);
  printBuilds(report["builds"]);
  if (report.contains("openrave")) printOpenRave(report["openrave"]);
}

int run(int argc, char** argv) {
  const auto options = bench::parseOptions(argc, argv, "bench_policy");
  if (!options) return 2;
  const Sizes sizes = options->quick ? kQuick : Sizes{};
  const ordered_json report = benchAll(sizes);
  if (bench::writeReport(report, *options)) printTables(report);
  return 0;
}

}  // namespace
}  // namespace handhold

int main(int argc, char** argv) { return handhold::run(argc, argv); }
