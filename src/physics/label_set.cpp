#include "physics/label_set.h"

#include "core/error.h"
#include "core/file.h"
#include "core/hash.h"
#include "core/log.h"

#include <algorithm>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

/// Rises with every change of ours that changes results.
constexpr int kPhysicsVersion = 1;
constexpr std::size_t kGraspsPerChunk = 64;  // some ten seconds on one core

bool isComplete(const PhysicsSet& chunk, std::size_t begin, std::size_t end) {
  return chunk.graspCount() == end - begin && chunk.grasp.front() == begin && chunk.grasp.back() == end - 1;
}

/// The chunks of one set and settings, complete or absent.
class Chunks {
 public:
  Chunks(const fs::path& folder, const PhysicsSet& empty) : empty_(empty) {
    const std::string key = empty.inputHash + empty.settings;
    folder_ = folder / (std::string(kChunksPrefix) + "physics-" + hashBytes(key.data(), key.size()));
  }

  std::optional<PhysicsSet> read(std::size_t chunk, std::size_t begin, std::size_t end) const {
    std::error_code error;
    if (!fs::exists(path(chunk), error)) return std::nullopt;
    try {
      PhysicsSet physics = readPhysics(path(chunk));
      const bool isOurs = physics.settings == empty_.settings && physics.inputHash == empty_.inputHash;
      if (isOurs && isComplete(physics, begin, end)) return physics;
    } catch (const InputError&) {  // damaged: simulated again
    }
    return std::nullopt;
  }

  void write(std::size_t chunk, const PhysicsSet& physics) const {
    std::error_code error;
    fs::create_directory(folder_, error);  // the set's folder is there, unless its database has vanished
    try {
      writePhysics(path(chunk), physics);
    } catch (const SystemError& failure) {
      logWarning(fmt::format("{}: a run that is stopped begins anew", failure.what()));
    }
  }

  void remove() const {
    std::error_code error;
    fs::remove_all(folder_, error);
  }

 private:
  fs::path path(std::size_t chunk) const { return folder_ / fmt::format("{:06}", chunk); }

  const PhysicsSet& empty_;
  fs::path folder_;
};

/// Adds the rows of `part` after those of `whole`.
void appendRows(const PhysicsSet& part, PhysicsSet& whole) {
  forEachPhysicsArray([&](const char*, auto member, std::string_view) {
    (whole.*member).insert((whole.*member).end(), (part.*member).begin(), (part.*member).end());
  });
}

/// The rows [begin, end) of results that have them all; nothing else.
std::optional<PhysicsSet> takeRows(const PhysicsSet& from, const PhysicsSet& empty, std::size_t begin,
                                   std::size_t end) {
  const auto first = std::lower_bound(from.grasp.begin(), from.grasp.end(), begin);
  const auto at = static_cast<std::size_t>(first - from.grasp.begin());
  if (at + (end - begin) > from.graspCount() || from.grasp[at] != begin || from.grasp[at + end - begin - 1] != end - 1)
    return std::nullopt;
  PhysicsSet part = empty;
  forEachPhysicsArray([&](const char*, auto member, std::string_view) {
    const std::size_t width = (from.*member).size() / from.graspCount();
    const auto row = (from.*member).begin() + static_cast<std::ptrdiff_t>(at * width);
    (part.*member).assign(row, row + static_cast<std::ptrdiff_t>((end - begin) * width));
  });
  return part;
}

std::string engineText() { return fmt::format("version {}\nmujoco {}", kPhysicsVersion, mujocoVersion()); }

std::string worldText(const PhysicsSettings& s) {
  std::string text = fmt::format("time_step {}\nfriction {} {} {}\n", s.world.timeStep, s.world.friction,
                                 s.world.torsionFriction, s.world.rollFriction);
  text += fmt::format("close {}\nsqueeze {} s {} N\npull {} s {} N {} kg\nlift {} m {} s\n", s.closeSeconds,
                      s.squeezeSeconds, s.squeezeForce, s.pullSeconds, s.pullForce, s.pullMass, s.liftHeight,
                      s.liftSeconds);
  text += fmt::format("held {} m {} deg\n", s.largestMove, s.largestTurn);
  return text;
}

}  // namespace

std::string protocolText(const PhysicsSettings& settings) { return engineText() + "\n" + worldText(settings); }

std::string settingsText(const SimulatedSet& set, const std::vector<PhysicsTest>& tests) {
  std::string text = fmt::format("{}\nmass {}\ntests", engineText(), set.mass());
  for (const PhysicsTest test : tests) text += fmt::format(" {}", kPhysicsTestNames[static_cast<std::size_t>(test)]);
  return text + "\n" + worldText(set.settings());
}

PhysicsSet emptyPhysics(const SimulatedSet& set, const std::vector<PhysicsTest>& tests) {
  PhysicsSet physics;
  physics.object = set.set().object;
  physics.hand = set.set().hand;
  physics.inputHash = set.set().inputHash;
  physics.setVersion = set.set().setVersion;
  physics.settings = settingsText(set, tests);
  physics.generator = set.set().generator;
  physics.friction = set.settings().world.friction;
  physics.mass = set.mass();
  physics.shapeP95 = set.shapeError().p95;
  physics.shapeMost = set.shapeError().largest;
  for (const std::string_view name : kPhysicsOutcomeNames) physics.outcomeNames.emplace_back(name);
  for (const PhysicsTest test : tests) {
    const std::string name(kPhysicsTestNames[static_cast<std::size_t>(test)]);
    physics.testNames.push_back(name);
    if (test == PhysicsTest::lift) {
      physics.directionNames.push_back(name);
    } else {
      for (const std::string_view way : kPullNames) physics.directionNames.push_back(fmt::format("{} {}", name, way));
    }
  }
  return physics;
}

void addResults(std::uint32_t row, const std::vector<TestResult>& results, PhysicsSet& physics) {
  physics.grasp.push_back(row);
  for (const TestResult& result : results) {
    const SettledResult& settled = result.settled;
    physics.settledClosed.push_back(settled.closed ? 1 : 0);
    physics.settledContacts.push_back(static_cast<std::uint16_t>(settled.contacts.size()));
    physics.settledDisplacement.push_back(static_cast<float>(settled.displacement));
    physics.settledRotation.push_back(static_cast<float>(settled.rotation));
    physics.settledPenetration.push_back(static_cast<float>(settled.penetration));
    physics.squeeze.push_back(static_cast<float>(settled.squeeze));
    for (const DirectionResult& direction : result.directions) {
      physics.outcome.push_back(static_cast<std::uint8_t>(direction.outcome));
      physics.displacement.push_back(static_cast<float>(direction.displacement));
      physics.rotation.push_back(static_cast<float>(direction.rotation));
      physics.fallSeconds.push_back(static_cast<float>(direction.fallSeconds));
      physics.penetration.push_back(static_cast<float>(direction.penetration));
    }
  }
}

std::optional<PhysicsSet> labelSet(const SimulatedSet& set, const LabelRequest& request,
                                   const std::optional<PhysicsSet>& known, const fs::path& folder,
                                   const JobSystem& jobs, BuildCounters& counters, const std::atomic<bool>& cancel) {
  const std::size_t count = std::min(request.top.value_or(set.set().graspCount()), set.set().graspCount());
  PhysicsSet whole = emptyPhysics(set, request.tests);
  const PhysicsSet empty = whole;
  const Chunks chunks(folder, empty);
  const bool isKnown = known && known->settings == empty.settings && known->inputHash == empty.inputHash;
  std::vector<GraspSimulator> simulators;
  simulators.reserve(static_cast<std::size_t>(jobs.threads()));
  for (int i = 0; i < jobs.threads(); ++i) simulators.emplace_back(set.model());
  for (std::size_t begin = 0, chunk = 0; begin < count; begin += kGraspsPerChunk, ++chunk) {
    const std::size_t end = std::min(count, begin + kGraspsPerChunk);
    std::optional<PhysicsSet> part;
    if (isKnown) part = takeRows(*known, empty, begin, end);
    if (!part) part = chunks.read(chunk, begin, end);
    if (!part) {
      std::vector<std::vector<TestResult>> results(end - begin);
      jobs.run(
          results.size(), 1,
          [&](int worker, std::size_t i) {
            const GraspPosture posture = set.posture(begin + i);
            for (const PhysicsTest test : request.tests) results[i].push_back(simulators[worker].run(posture, test));
            ++counters.trials;
            if (isHeld(results[i].front())) ++counters.forceClosed;
          },
          &cancel);
      if (cancel) return std::nullopt;
      part = empty;
      for (std::size_t i = 0; i < results.size(); ++i)
        addResults(static_cast<std::uint32_t>(begin + i), results[i], *part);
      chunks.write(chunk, *part);
    }
    appendRows(*part, whole);
  }
  chunks.remove();
  return whole;
}

}  // namespace handhold
