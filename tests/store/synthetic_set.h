#pragma once

#include "core/random.h"
#include "simulate/grasp_policy.h"
#include "store/grasp_set.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <numeric>
#include <string>

namespace handhold {

/// A folder of its own for a test, removed at the end.
class TestFolder {
 public:
  TestFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "handhold-store-XXXXXX").string();
    path_ = ::mkdtemp(name.data());
  }
  ~TestFolder() { std::filesystem::remove_all(path_); }
  TestFolder(const TestFolder&) = delete;
  TestFolder& operator=(const TestFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

inline std::string bytesOf(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

inline void writeBytes(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

/// Fills arrays of a synthetic set: numbers in (-1, 1) that depend on the seed alone.
class SyntheticNumbers {
 public:
  explicit SyntheticNumbers(std::uint64_t seed) : stream_(seed) {}
  double next() { return 2 * stream_.uniform(counter_++) - 1; }
  template <class T>
  void fill(std::vector<T>& values, std::size_t count) {
    values.resize(count);
    for (T& value : values) value = static_cast<T>(next());
  }
  /// Unit vectors.
  void fillDirections(std::vector<float>& values, std::size_t rows) {
    for (std::size_t i = 0; i < rows; ++i) {
      const Eigen::Vector3f v = Eigen::Vector3d(next(), next(), 1.5 + next()).normalized().cast<float>();
      values.insert(values.end(), v.begin(), v.end());
    }
  }

 private:
  RandomStream stream_;
  std::uint64_t counter_ = 0;
};

struct SyntheticSizes {
  std::size_t samples = 12, rolls = 4, preshapes = 2, grasps = 17;
};

inline TriangleMesh tetrahedron(float size) {
  return {{{0, 0, 0}, {size, 0, 0}, {0, size, 0}, {0, 0, size}}, {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}};
}

inline void addSyntheticHand(GraspSet& set, std::size_t preshapes) {
  set.jointNames = {"spread", "finger_1", "finger_2"};
  // One link without geometry, and names that HDF5 would read as paths.
  set.linkNames = {"hand_base", "wrist_flange", "finger/1", "finger%2F1", "."};
  set.linkMeshes = {tetrahedron(0.08f), {}, tetrahedron(0.03f), tetrahedron(0.02f), tetrahedron(0.01f)};
  for (std::size_t i = 0; i < preshapes; ++i) set.preshapeNames.push_back("spread_" + std::to_string(i));
  set.preshapes = preshapes;
  set.urdf = "<robot name=\"synthetic\"/>\n";
  set.config = "urdf: synthetic.urdf\n";
}

/// Grasps at trials spread evenly over the table, by falling epsilon with a tie at the end.
inline void addSyntheticGrasps(GraspSet& set, std::size_t n, SyntheticNumbers& numbers) {
  const auto nTrials = set.trialCount();
  for (std::size_t row = 0; row < n; ++row) {
    const std::size_t index = row * nTrials / n;
    const std::size_t trial[] = {index / (set.rolls * set.preshapes), index / set.preshapes % set.rolls,
                                 index % set.preshapes};
    for (const std::size_t part : trial) set.trial.push_back(static_cast<std::uint32_t>(part));
    set.epsilon.push_back(0.3 / static_cast<double>(1 + std::min(row, n - 2)));
    set.outcome[index] = 0;
    set.trialEpsilon[index] = static_cast<float>(set.epsilon.back());
    set.handPose.insert(set.handPose.end(), {numbers.next(), numbers.next(), numbers.next(), 0, 0, 0.6, 0.8});
    const std::size_t nContacts = 2 + row % 3;
    for (std::size_t i = 0; i < nContacts; ++i) set.contactLink.push_back(static_cast<std::uint16_t>(i));
    set.contactBegin.push_back(static_cast<std::uint32_t>(set.contactLink.size()));
    for (int i = 0; i < set.neighbors; ++i) {
      set.mapNeighbor.push_back(static_cast<std::uint32_t>((row + static_cast<std::size_t>(i)) % 20));
      set.mapWeight.push_back(1.0f / static_cast<float>(set.neighbors));
    }
    set.approachClear.push_back(row % 2 == 0 ? 1 : 0);
    // The last grasp has no bounds, as when rounding stopped them.
    const double unknown = std::numeric_limits<double>::quiet_NaN();
    set.epsilonLower.push_back(row + 1 < n ? 1.01 * set.epsilon.back() : unknown);
    set.epsilonUpper.push_back(row + 1 < n ? 1.0101 * set.epsilon.back() : unknown);
    // Known for the better half only; the second has no limit.
    const double margin = row == 1 ? std::numeric_limits<double>::infinity() : 3 + 0.5 * static_cast<double>(row);
    set.loadMargin.push_back(static_cast<float>(row < n / 2 ? margin : unknown));
    const double robustness = row < n / 3 ? 0.5 + 0.02 * static_cast<double>(row % 20) : unknown;
    set.robustness.push_back(static_cast<float>(robustness));
    set.robustnessLower.push_back(static_cast<float>(robustness - 0.1));
    set.robustnessUpper.push_back(static_cast<float>(robustness + 0.1));
    set.criticalFriction.push_back(static_cast<float>(row + 1 < n ? 0.1 + 0.01 * static_cast<double>(row) : unknown));
  }
  numbers.fill(set.targetPoint, 3 * n);
  numbers.fillDirections(set.approachDirection, n);
  numbers.fill(set.roll, n);
  numbers.fill(set.jointPosition, n * set.jointNames.size());
  numbers.fill(set.preshapeJointPosition, n * set.jointNames.size());
  numbers.fill(set.backoff, n);
  numbers.fill(set.contactPosition, 3 * set.contactLink.size());
  numbers.fillDirections(set.contactNormal, set.contactLink.size());
}

/// A whole set with made-up numbers that every check of the reader accepts.
inline GraspSet syntheticSet(const SyntheticSizes& sizes = {}, std::uint64_t seed = 1) {
  SyntheticNumbers numbers(seed);
  GraspSet set;
  set.object = "mug";
  set.hand = "three-finger";
  set.inputHash = "00112233445566778899aabbccddeeff";
  set.generator = "handhold test";
  set.methodVersion = 3;
  set.job = "seed: 1  # \xc3\xa9\n";
  set.policy = "surface_normal";
  set.friction = 0.4;
  set.torqueScale = 0.06;
  set.torsionRadius = 0.004;
  set.robustnessTrials = 100;
  set.robustnessPosition = 0.003;
  set.robustnessRotation = 0.05;
  set.pitch = 0.004;
  set.mapPitch = 0.002;
  set.coneEdges = 8;
  set.contactDistance = 1e-4;
  set.seed = 0xfedcba9876543210ULL;
  set.objectMesh = tetrahedron(0.1f);
  set.watertight = true;
  set.centerOfMass = {0.025, 0.025, 0.025};
  set.objectNotes = {"2 vertices were welded"};
  addSyntheticHand(set, sizes.preshapes);
  set.samples = sizes.samples;
  set.rolls = sizes.rolls;
  numbers.fill(set.samplePoint, 3 * sizes.samples);
  numbers.fillDirections(set.sampleNormal, sizes.samples);
  for (const std::string_view name : kOutcomeNames) set.outcomeNames.emplace_back(name);
  set.outcome.assign(set.trialCount(), 3);
  set.trialEpsilon.assign(set.trialCount(), std::numeric_limits<float>::quiet_NaN());
  set.trialsByReference = set.samples;
  numbers.fill(set.mapPoint, 3 * 20);
  numbers.fillDirections(set.mapNormal, 20);
  set.neighbors = 5;
  addSyntheticGrasps(set, sizes.grasps, numbers);
  set.seconds = {{"sample", 0.25}, {"simulate", 12.5}};
  set.host = "builder";
  set.created = "2024-01-01T00:00:00Z";
  return set;
}

}  // namespace handhold
