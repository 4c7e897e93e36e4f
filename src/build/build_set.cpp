#include "build/build_set.h"

#include "build/kept_quality.h"
#include "build/timing.h"
#include "core/hash.h"
#include "core/log.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <ctime>
#include <numbers>

#include <fmt/format.h>
#include <unistd.h>

namespace handhold {
namespace {

/// The distance map is sampled with this many points for each target point (III-A: "at a finer resolution").
constexpr std::size_t kMapPointsPerSample = 4;

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
  for (const Joint& joint : hand.joints) set.jointNames.push_back(joint.name);
  for (const Link& link : hand.links) {
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
  set.robustnessTrials = job.robustness.noise.trials;
  set.robustnessPosition = job.robustness.noise.position;
  set.robustnessRotation = job.robustness.noise.rotation;
  set.contactDistance = job.contactDistance;
  set.seed = job.seed;
  set.rolls = job.rolls;
  set.generator = "handhold " HANDHOLD_VERSION;
  set.methodVersion = kMethodVersion;
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
  set.robustness.push_back(static_cast<float>(grasp.robustness.share));
  set.robustnessLower.push_back(static_cast<float>(grasp.robustness.lower));
  set.robustnessUpper.push_back(static_cast<float>(grasp.robustness.upper));
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

/// The trials of one set and where their results go: each sample has a slot of its own.
class TrialRun {
 public:
  TrialRun(const Job& job, const SampledObject& object, const Hand& hand, const Checkpoint& checkpoint,
           BuildCounters& counters, const std::atomic<bool>& cancel, std::size_t samples)
      : job_(job),
        object_(object),
        hand_(hand),
        checkpoint_(checkpoint),
        counters_(counters),
        cancel_(cancel),
        perSample_(static_cast<std::size_t>(job.rolls) * hand.preshapes.size()),
        samplesPerChunk_(std::max<std::size_t>(1, checkpoint.trialsPerChunk() / perSample_)),
        results_(samples),
        done_((samples + samplesPerChunk_ - 1) / samplesPerChunk_) {}

  /// Takes over the chunks that an earlier run finished. Returns how many.
  std::size_t resume();
  void runSample(SetWorker& worker, std::size_t sample);
  std::vector<SampleResults>& results() { return results_; }

 private:
  std::span<SampleResults> samplesOf(std::size_t chunk) {
    const std::size_t begin = chunk * samplesPerChunk_;
    return std::span(results_).subspan(begin, std::min(samplesPerChunk_, results_.size() - begin));
  }

  const Job& job_;
  const SampledObject& object_;
  const Hand& hand_;
  const Checkpoint& checkpoint_;
  BuildCounters& counters_;
  const std::atomic<bool>& cancel_;
  std::size_t perSample_, samplesPerChunk_;
  std::vector<SampleResults> results_;
  std::vector<std::atomic<std::size_t>> done_;  // samples of each chunk
};

std::size_t TrialRun::resume() {
  std::size_t resumed = 0;
  for (std::size_t chunk = 0; chunk < done_.size(); ++chunk) {
    const std::span<SampleResults> samples = samplesOf(chunk);
    if (!checkpoint_.read(chunk, perSample_, samples)) continue;
    ++resumed;
    done_[chunk] = samples.size();
    for (const SampleResults& sample : samples) {
      counters_.trials += perSample_;
      counters_.forceClosed += sample.grasps.size();
    }
  }
  return resumed;
}

/// The processor's clock is read once a sample; its seconds are dealt to the stages as the wall's clock saw them.
void TrialRun::runSample(SetWorker& worker, std::size_t sample) {
  const std::size_t chunk = sample / samplesPerChunk_;
  SampleResults& results = results_[sample];
  if (!results.outcome.empty()) return;  // taken over
  const double processorBefore = threadSeconds();
  const auto start = std::chrono::steady_clock::now();
  const std::size_t first = sample * perSample_;
  StageSeconds seconds;
  const Evaluation& result = worker.evaluation;
  for (std::size_t trial = first; trial < first + perSample_; ++trial) {
    if (cancel_) return;
    evaluate(*worker.policy, candidateAt(job_, object_.samples, hand_, trial), worker.cones, worker.evaluation,
             seconds);
    results.outcome.push_back(static_cast<std::uint8_t>(result.trial.outcome));
    results.epsilon.push_back(static_cast<float>(result.epsilon));
    if (result.trial.byReference || job_.simulation == Simulation::reference) ++results.byReference;
    if (result.trial.outcome == GraspOutcome::forceClosed) results.grasps.push_back(keptGrasp(trial, result));
  }
  counters_.trials += perSample_;
  counters_.forceClosed += results.grasps.size();
  results.seconds.add(seconds, (threadSeconds() - processorBefore) / std::max(1e-9, secondsSince(start)));
  // A set of one chunk is done when the chunk is.
  if (++done_[chunk] == samplesOf(chunk).size() && done_.size() > 1) checkpoint_.write(chunk, samplesOf(chunk));
}

/// What kept grasps alone have, one grasp a work item.
void completeGrasps(const Job& job, const Hand& hand, const WrenchModel& model, const JobSystem& jobs,
                    const std::atomic<bool>& cancel, std::vector<SetWorker>& workers, std::vector<KeptGrasp>& grasps,
                    GraspSet& set) {
  std::vector<KeptQuality> qualities;
  for (std::size_t i = 0; i < workers.size(); ++i) qualities.emplace_back(job, hand, model, setKey(set));
  jobs.run(
      grasps.size(), 1,
      [&](int worker, std::size_t row) { qualities[worker].compute(row, *workers[worker].policy, grasps[row]); },
      &cancel);
  for (const KeptQuality& quality : qualities) {
    set.seconds["bounds"] += quality.boundsSeconds;
    set.seconds["load_margin"] += quality.loadSeconds;
    set.seconds["robustness"] += quality.robustnessSeconds;
  }
}

void setTimings(const SampledObject& object, const StageSeconds& seconds, GraspSet& set) {
  set.seconds.insert(object.seconds.begin(), object.seconds.end());
  set.seconds["policy"] = seconds.policy;
  set.seconds["force_closure"] = seconds.forceClosure;
  set.seconds["epsilon"] = seconds.epsilon;
  set.seconds["approach"] = seconds.approach;
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
  const auto start = std::chrono::steady_clock::now();
  ImportLimits limits;
  limits.cancel = cancel;
  ObjectModel model = loadObject(item.mesh, item.unit, limits);
  const double seconds = secondsSince(start);
  SampledObject object = sampleObject(job, item, std::move(model));
  object.seconds["load"] = seconds;
  return object;
}

SampledObject sampleObject(const Job& job, const CatalogItem& item, ObjectModel model) {
  SampledObject object;
  object.item = &item;
  object.model = std::move(model);
  const auto start = std::chrono::steady_clock::now();
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
  const PoseNoise& noise = job.robustness.noise;
  if (noise.trials > 0) {
    for (const double number : {static_cast<double>(job.robustness.grasps), static_cast<double>(noise.trials),
                                noise.position, noise.rotation})
      hash.addNumber(number);
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

GraspSet emptySet(const Job& job, const SampledObject& object, const Hand& hand) {
  GraspSet set;
  setObject(object, set);
  setHand(hand, set);
  setParameters(job, wrenchModel(job, *object.item, object.model, hand), set);
  set.samples = object.samples.size();
  set.preshapes = hand.preshapes.size();
  return set;
}

std::uint64_t setKey(const GraspSet& set) { return hashText(set.object + "/" + set.hand); }

KeptGrasp keptGrasp(std::size_t trial, const Evaluation& evaluation) {
  return {trial,
          evaluation.epsilon,
          evaluation.trial.X_OH,
          evaluation.trial.backoff,
          evaluation.approachClear,
          evaluation.trial.jointPosition,
          evaluation.trial.contacts,
          evaluation.trial.centering};
}

void addGrasps(const Job& job, const SampledObject& object, const Hand& hand, const std::vector<KeptGrasp>& grasps,
               GraspSet& set) {
  for (const KeptGrasp& grasp : grasps) addGrasp(job, object, hand, grasp, set);
  addNeighbors(job, object, set);
}

std::vector<SetWorker> makeWorkers(const Job& job, const SampledObject& object, const Hand& hand,
                                   const std::shared_ptr<const HandFields>& fields, const JobSystem& jobs) {
  const WrenchModel model = wrenchModel(job, *object.item, object.model, hand);
  std::vector<SetWorker> workers;
  for (int i = 0; i < jobs.threads(); ++i) workers.push_back({Cones(model), nullptr, {}});
  workers[0].policy = makePolicy(job, hand, object.model, fields);
  for (SetWorker& worker : workers) {
    if (!worker.policy) worker.policy = workers[0].policy->clone();
  }
  return workers;
}

bool finishSet(const Job& job, const SampledObject& object, const Hand& hand, std::vector<KeptGrasp> grasps,
               const StageSeconds& seconds, const JobSystem& jobs, const std::atomic<bool>& cancel,
               std::vector<SetWorker>& workers, GraspSet& set) {
  auto start = std::chrono::steady_clock::now();
  sortGrasps(grasps);
  keepGrasps(grasps, job.keepTop, job.keepDiverse, object.model.mass.radius);
  set.seconds["table"] += secondsSince(start);
  completeGrasps(job, hand, wrenchModel(job, *object.item, object.model, hand), jobs, cancel, workers, grasps, set);
  if (cancel) return false;
  start = std::chrono::steady_clock::now();
  addGrasps(job, object, hand, grasps, set);
  set.seconds["table"] += secondsSince(start);
  setTimings(object, seconds, set);
  return true;
}

std::optional<GraspSet> buildSet(const Job& job, const SampledObject& object, const Hand& hand,
                                 const std::string& inputHash, const std::shared_ptr<const HandFields>& fields,
                                 const Checkpoint& checkpoint, const JobSystem& jobs, BuildCounters& counters,
                                 const std::atomic<bool>& cancel) {
  GraspSet set = emptySet(job, object, hand);
  set.inputHash = inputHash;

  auto start = std::chrono::steady_clock::now();
  std::vector<SetWorker> workers = makeWorkers(job, object, hand, fields, jobs);
  set.seconds["prepare"] = secondsSince(start);
  TrialRun run(job, object, hand, checkpoint, counters, cancel, set.samples);
  if (const std::size_t resumed = run.resume(); resumed > 0) {
    logInfo(fmt::format("{} x {}: {} finished chunks of trials are taken over from an earlier run", set.object,
                        set.hand, resumed));
  }
  jobs.run(
      set.samples, 1, [&](int worker, std::size_t sample) { run.runSample(workers[worker], sample); }, &cancel);
  if (cancel) return std::nullopt;

  start = std::chrono::steady_clock::now();
  StageSeconds seconds;
  std::vector<KeptGrasp> grasps;
  for (SampleResults& sample : run.results()) {
    set.outcome.insert(set.outcome.end(), sample.outcome.begin(), sample.outcome.end());
    set.trialEpsilon.insert(set.trialEpsilon.end(), sample.epsilon.begin(), sample.epsilon.end());
    set.trialsByReference += sample.byReference;
    seconds.add(sample.seconds, 1);
    std::move(sample.grasps.begin(), sample.grasps.end(), std::back_inserter(grasps));
  }
  set.seconds["table"] = secondsSince(start);
  if (!finishSet(job, object, hand, std::move(grasps), seconds, jobs, cancel, workers, set)) return std::nullopt;
  return set;
}

}  // namespace handhold
