#include "build/build_set.h"

#include "build/keep.h"
#include "core/file.h"
#include "core/hash.h"
#include "simulate/actuation.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <numbers>

#include <fmt/format.h>
#include <unistd.h>

namespace handhold {
namespace {

/// Part of every input hash: to be raised whenever a change of ours changes results.
constexpr int kMethodVersion = 4;

/// The distance map is sampled with this many points for each target point (III-A: "at a finer resolution").
constexpr std::size_t kMapPointsPerSample = 4;

double secondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Seconds that the processor worked for this thread: unlike the wall's they do not count waiting.
double threadSeconds() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

template <class T, class V>
void appendVector(std::vector<T>& array, const V& vector) {
  for (Eigen::Index i = 0; i < vector.size(); ++i) array.push_back(static_cast<T>(vector[i]));
}

void appendPoints(std::vector<float>& array, const std::vector<Eigen::Vector3f>& points) {
  for (const Eigen::Vector3f& point : points) appendVector(array, point);
}

void setObject(const SampledObject& object, GraspSet& set) {
  set.object = object.item->name;
  set.objectMesh = object.model.mesh;
  set.watertight = object.model.watertight;
  set.centerOfMass = object.model.mass.centerOfMass;
  set.objectNotes = object.model.notes;
  set.objectNotes.insert(set.objectNotes.end(), object.model.warnings.begin(), object.model.warnings.end());
  appendPoints(set.samplePoint, object.samples.point);
  appendPoints(set.sampleNormal, object.samples.normal);
  appendPoints(set.mapPoint, object.mapSamples.point);
  appendPoints(set.mapNormal, object.mapSamples.normal);
  set.pitch = object.samples.pitch;
  set.mapPitch = object.mapSamples.pitch;
}

void setHand(const Hand& hand, GraspSet& set) {
  set.hand = hand.name;
  for (const HandJoint& joint : hand.joints) set.jointNames.push_back(joint.name);
  for (const HandLink& link : hand.links) {
    set.linkNames.push_back(link.name);
    set.linkMeshes.push_back(link.mesh);
  }
  for (const Preshape& preshape : hand.preshapes) set.preshapeNames.push_back(preshape.name);
  set.urdf = hand.urdfText;
  set.config = hand.configText;
}

void setParameters(const Job& job, const WrenchModel& model, GraspSet& set) {
  set.job = job.text;
  set.policy = job.policy == PolicyKind::surfaceNormal ? "surface_normal" : "center_of_mass";
  set.friction = model.friction;
  set.torqueScale = model.torqueScale;
  set.coneEdges = model.coneEdges;
  set.torsionRadius = model.torsionRadius;
  set.contactDistance = job.contactDistance;
  set.seed = job.seed;
  set.rolls = job.rolls;
  set.generator = "handhold " HANDHOLD_VERSION;
  for (const std::string_view name : kOutcomeNames) set.outcomeNames.emplace_back(name);
}

void addGrasp(const Job& job, const SampledObject& object, const Hand& hand, const KeptGrasp& grasp, GraspSet& set) {
  const GraspCandidate candidate = candidateAt(job, object.samples, hand, grasp.trial);
  const std::size_t preshapes = hand.preshapes.size();
  const std::size_t sample = grasp.trial / (preshapes * job.rolls);
  set.trial.push_back(static_cast<std::uint32_t>(sample));
  set.trial.push_back(static_cast<std::uint32_t>(grasp.trial / preshapes % job.rolls));
  set.trial.push_back(static_cast<std::uint32_t>(grasp.trial % preshapes));
  appendVector(set.targetPoint, object.samples.point[sample]);
  appendVector(set.approachDirection, object.samples.approach[sample]);
  set.roll.push_back(static_cast<float>(candidate.roll));
  Eigen::Quaterniond q(grasp.X_OH.linear());
  if (q.w() < 0) q.coeffs() = -q.coeffs();  // one of the two quaternions of a rotation
  appendVector(set.handPose, grasp.X_OH.translation());
  appendVector(set.handPose, q.coeffs());
  appendVector(set.jointPosition, grasp.jointPosition);
  appendVector(set.preshapeJointPosition, hand.preshapes[candidate.preshape].jointPosition);
  set.epsilon.push_back(grasp.epsilon);
  set.backoff.push_back(static_cast<float>(grasp.backoff));
  set.approachClear.push_back(grasp.approachClear ? 1 : 0);
  set.epsilonLower.push_back(grasp.epsilonLower);
  set.epsilonUpper.push_back(grasp.epsilonUpper);
  set.criticalFriction.push_back(static_cast<float>(grasp.criticalFriction));
  set.loadMargin.push_back(static_cast<float>(grasp.loadMargin));
  for (const Contact& contact : grasp.contacts) {
    appendVector(set.contactPosition, contact.position);
    appendVector(set.contactNormal, contact.normal);
    set.contactLink.push_back(contact.link);
  }
  set.contactBegin.push_back(static_cast<std::uint32_t>(set.contactLink.size()));
}

/// The k map points around each grasp's target. Grasps that share a sample share the search.
void addNeighbors(const Job& job, const SampledObject& object, GraspSet& set) {
  std::vector<int> rowOfSample(object.samples.size(), -1);
  std::vector<Eigen::Vector3f> points, normals;
  for (std::size_t i = 0; i < set.graspCount(); ++i) {
    int& row = rowOfSample[set.trial[3 * i]];
    if (row >= 0) continue;
    row = static_cast<int>(points.size());
    points.push_back(object.samples.point[set.trial[3 * i]]);
    normals.push_back(object.samples.normal[set.trial[3 * i]]);
  }
  DistanceMapPoints map;
  map.samples = object.mapSamples;
  findNeighbors(map, points, normals, job.mapNeighbors);
  set.neighbors = map.neighborCount;
  for (std::size_t i = 0; i < set.graspCount(); ++i) {
    const std::size_t begin = static_cast<std::size_t>(rowOfSample[set.trial[3 * i]]) * map.neighborCount;
    set.mapNeighbor.insert(set.mapNeighbor.end(), map.neighbor.begin() + begin,
                           map.neighbor.begin() + begin + map.neighborCount);
    set.mapWeight.insert(set.mapWeight.end(), map.weight.begin() + begin,
                         map.weight.begin() + begin + map.neighborCount);
  }
}

/// What one thread needs and adds up, on cache lines of its own.
struct alignas(64) Worker {
  Cones cones;
  std::unique_ptr<GraspPolicy> policy;
  Evaluation evaluation;
  StageSeconds seconds;  // of the processor
  std::uint64_t byReference = 0;
};

/// The trials of one set and where their results go: each sample has slots of its own.
struct TrialRun {
  const Job& job;
  const SampledObject& object;
  const Hand& hand;
  BuildCounters& counters;
  const std::atomic<bool>& cancel;
  GraspSet& set;
  std::vector<std::vector<KeptGrasp>> graspsOfSample;

  void runSample(Worker& worker, std::size_t sample);
};

/// The processor's clock is read once a sample; its seconds are dealt to the stages as the wall's clock saw them.
void TrialRun::runSample(Worker& worker, std::size_t sample) {
  const double processorBefore = threadSeconds();
  const auto start = std::chrono::steady_clock::now();
  const std::size_t perSample = set.rolls * set.preshapes, first = sample * perSample;
  StageSeconds seconds;
  std::vector<KeptGrasp> grasps;
  const Evaluation& result = worker.evaluation;
  std::size_t trial = first;
  for (; trial < first + perSample && !cancel; ++trial) {
    evaluate(*worker.policy, candidateAt(job, object.samples, hand, trial), worker.cones, worker.evaluation, seconds);
    set.outcome[trial] = static_cast<std::uint8_t>(result.trial.outcome);
    set.trialEpsilon[trial] = static_cast<float>(result.epsilon);
    if (result.trial.byReference || job.simulation == Simulation::reference) ++worker.byReference;
    if (result.trial.outcome == GraspOutcome::forceClosed) {
      grasps.push_back({trial, result.epsilon, result.trial.X_OH, result.trial.backoff, result.approachClear,
                        result.bounds.lower, result.bounds.upper, result.criticalFriction, result.trial.jointPosition,
                        result.trial.contacts});
    }
  }
  counters.trials += trial - first;
  counters.forceClosed += grasps.size();
  graspsOfSample[sample] = std::move(grasps);
  worker.seconds.add(seconds, (threadSeconds() - processorBefore) / std::max(1e-9, secondsSince(start)));
}

/// The load margin of the first grasps, each in its own row. Nothing where no joint's effort is known.
/// @return seconds of the processor, over all threads
double addLoadMargins(const Job& job, const SampledObject& object, const Hand& hand, const JobSystem& jobs,
                      const std::atomic<bool>& cancel, std::vector<KeptGrasp>& grasps) {
  if (!hasEffortLimits(hand)) return 0;
  const WrenchModel model = wrenchModel(job, *object.item, object.model, hand);
  const TaskWrenches tasks = taskWrenches(job);
  struct alignas(64) LoadWorker {
    LoadMarginSolver solver;
    double seconds = 0;
  };
  std::vector<LoadWorker> workers;
  for (int i = 0; i < jobs.threads(); ++i) workers.push_back({LoadMarginSolver(model)});
  const auto run = [&](int worker, std::size_t i) {
    const double before = threadSeconds();
    KeptGrasp& grasp = grasps[i];
    grasp.loadMargin = evaluateLoad(workers[worker].solver, hand, grasp.jointPosition, grasp.X_OH, grasp.contacts,
                                    model.centerOfMass, tasks)
                           .load;
    workers[worker].seconds += threadSeconds() - before;
  };
  jobs.run(std::min(grasps.size(), static_cast<std::size_t>(job.loadMargin.grasps)), 1, run, &cancel);
  double seconds = 0;
  for (const LoadWorker& worker : workers) seconds += worker.seconds;
  return seconds;
}

void setTimings(const SampledObject& object, const std::vector<Worker>& workers, GraspSet& set) {
  set.seconds.insert(object.seconds.begin(), object.seconds.end());
  for (const Worker& worker : workers) {
    set.seconds["policy"] += worker.seconds.policy;
    set.seconds["force_closure"] += worker.seconds.forceClosure;
    set.seconds["epsilon"] += worker.seconds.epsilon;
    set.seconds["approach"] += worker.seconds.approach;
    set.seconds["bounds"] += worker.seconds.bounds;
  }
  char host[256] = {};
  ::gethostname(host, sizeof host - 1);
  set.host = host;
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  ::gmtime_r(&now, &utc);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &utc);
  set.created = text;
}

}  // namespace

SampledObject loadSampledObject(const Job& job, const CatalogItem& item, const std::atomic<bool>* cancel) {
  SampledObject object;
  object.item = &item;
  auto start = std::chrono::steady_clock::now();
  ImportLimits limits;
  limits.cancel = cancel;
  object.model = loadObject(item.mesh, item.unit, limits);
  object.seconds["load"] = secondsSince(start);
  start = std::chrono::steady_clock::now();
  const RayScene scene(object.model.mesh);
  if (job.policy == PolicyKind::centerOfMass) {
    object.samples = sampleSphere(object.model, scene, job.samples, item.mesh);
  } else if (job.pitch > 0) {
    object.samples = sampleSurface(object.model, scene, job.pitch, item.mesh);
  } else {
    object.samples = sampleSurfaceCount(object.model, scene, job.samples, item.mesh);
  }
  object.mapSamples = sampleSurfaceCount(object.model, scene, kMapPointsPerSample * object.samples.size(), item.mesh);
  object.seconds["sample"] = secondsSince(start);
  return object;
}

std::string meshHash(const CatalogItem& item) {
  const std::string content = readFile(item.mesh);
  return hashBytes(content.data(), content.size());
}

std::string inputHash(const Job& job, const CatalogItem& item, const std::string& meshHash, const Hand& hand) {
  ContentHash hash;
  hash.addNumber(kMethodVersion);
  hash.addText(meshHash);
  hash.addNumber(item.unit.scale);
  hash.addNumber(item.unit.written ? 1 : 0);
  hash.addText(hand.contentHash);
  for (const Preshape& preshape : hand.preshapes) hash.addText(preshape.name);
  for (const double number :
       {static_cast<double>(job.policy), static_cast<double>(job.samples), job.pitch, static_cast<double>(job.rolls),
        item.friction, static_cast<double>(job.coneEdges), job.contactDistance, static_cast<double>(job.mapNeighbors),
        static_cast<double>(job.keepTop), static_cast<double>(job.keepDiverse), static_cast<double>(job.seed),
        static_cast<double>(job.simulation), static_cast<double>(job.loadMargin.grasps)}) {
    hash.addNumber(number);
  }
  if (job.loadMargin.grasps > 0) {
    const TaskWrenches tasks = taskWrenches(job);
    for (const double number : tasks.reshaped()) hash.addNumber(number);
  }
  return hash.hex();
}

std::unique_ptr<GraspPolicy> makePolicy(const Job& job, const Hand& hand, const ObjectModel& object,
                                        const std::shared_ptr<const HandFields>& fields) {
  return job.simulation == Simulation::reference
             ? makeReferencePolicy(hand, object, job.policy, policySettings(job))
             : makeFastPolicy(fields, hand, object, job.policy, policySettings(job));
}

WrenchModel wrenchModel(const Job& job, const CatalogItem& item, const ObjectModel& object, const Hand& hand) {
  return {object.mass.centerOfMass, object.mass.radius, item.friction, job.coneEdges, hand.torsionRadius};
}

GraspCandidate candidateAt(const Job& job, const SurfaceSamples& samples, const Hand& hand, std::size_t trial) {
  const std::size_t preshapes = hand.preshapes.size();
  const std::size_t sample = trial / (preshapes * job.rolls);
  GraspCandidate candidate;
  candidate.targetPoint = samples.point[sample].cast<double>();
  candidate.approach = samples.approach[sample].cast<double>().normalized();
  candidate.roll = 2 * std::numbers::pi * static_cast<double>(trial / preshapes % job.rolls) / job.rolls;
  candidate.preshape = static_cast<int>(trial % preshapes);
  return candidate;
}

std::optional<GraspSet> buildSet(const Job& job, const SampledObject& object, const Hand& hand,
                                 const std::string& inputHash, const std::shared_ptr<const HandFields>& fields,
                                 const JobSystem& jobs, BuildCounters& counters, const std::atomic<bool>& cancel) {
  GraspSet set;
  const WrenchModel model = wrenchModel(job, *object.item, object.model, hand);
  setObject(object, set);
  setHand(hand, set);
  setParameters(job, model, set);
  set.inputHash = inputHash;
  set.samples = object.samples.size();
  set.preshapes = hand.preshapes.size();
  set.outcome.assign(set.trialCount(), static_cast<std::uint8_t>(GraspOutcome::notRun));
  set.trialEpsilon.assign(set.trialCount(), std::nanf(""));

  auto start = std::chrono::steady_clock::now();
  std::vector<Worker> workers;
  for (int i = 0; i < jobs.threads(); ++i) workers.push_back({Cones(model), nullptr, {}, {}});
  workers[0].policy = makePolicy(job, hand, object.model, fields);
  for (Worker& worker : workers) {
    if (!worker.policy) worker.policy = workers[0].policy->clone();
  }
  set.seconds["prepare"] = secondsSince(start);
  TrialRun run{job, object, hand, counters, cancel, set, std::vector<std::vector<KeptGrasp>>(set.samples)};
  jobs.run(
      set.samples, 1, [&](int worker, std::size_t sample) { run.runSample(workers[worker], sample); }, &cancel);
  if (cancel) return std::nullopt;

  start = std::chrono::steady_clock::now();
  std::vector<KeptGrasp> grasps;
  for (auto& some : run.graspsOfSample) std::move(some.begin(), some.end(), std::back_inserter(grasps));
  sortGrasps(grasps);
  keepGrasps(grasps, job.keepTop, job.keepDiverse, object.model.mass.radius);
  const double tableSeconds = secondsSince(start);
  set.seconds["load_margin"] = addLoadMargins(job, object, hand, jobs, cancel, grasps);
  if (cancel) return std::nullopt;

  start = std::chrono::steady_clock::now();
  for (const KeptGrasp& grasp : grasps) addGrasp(job, object, hand, grasp, set);
  addNeighbors(job, object, set);
  for (const Worker& worker : workers) set.trialsByReference += worker.byReference;
  set.seconds["table"] = tableSeconds + secondsSince(start);
  setTimings(object, workers, set);
  return set;
}

}  // namespace handhold
