#include "store/refusal.h"

#include "core/hash.h"
#include "store/database.h"
#include "store/layout.h"
#include "store/synthetic_set.h"

#include <cstdlib>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using testing::HasSubstr;
using testing::StartsWith;
namespace fs = std::filesystem;

constexpr int kFlips = 50;

/// Reading `bytes` as a file, by all three readers; `hashToo` is false where the damage lies beyond what the fast one
/// reads.
void expectRefusal(const std::string& bytes, const std::string& wanted, bool hashToo) {
  const TestFolder folder;
  const fs::path path = folder.path() / "v0001.h5";
  writeBytes(path, bytes);
  const auto matcher = testing::AllOf(StartsWith(path.string() + ": "), HasSubstr(wanted));
  EXPECT_THAT(refusalOf([&] { readGraspSet(path); }), matcher);
  EXPECT_THAT(refusalOf([&] { readSummary(path); }), matcher);
  if (hashToo) {
    EXPECT_THAT(refusalOf([&] { readInputHash(path); }), matcher);
  }
}

std::string goodBytes() {
  GraspSet set = syntheticSet();
  set.setVersion = 1;
  return encodeGraspSet(set);
}

TEST(Refusal, MissingFile) {
  const std::string wanted = "/nowhere/v0001.h5: cannot be read: No such file or directory";
  EXPECT_EQ(refusalOf([] { readGraspSet("/nowhere/v0001.h5"); }), wanted);
  EXPECT_EQ(refusalOf([] { readSummary("/nowhere/v0001.h5"); }), wanted);
  EXPECT_EQ(refusalOf([] { readInputHash("/nowhere/v0001.h5"); }), wanted);
}

TEST(Refusal, Folder) {
  const TestFolder folder;
  EXPECT_THAT(refusalOf([&] { readGraspSet(folder.path()); }), HasSubstr("is a folder"));
}

TEST(Refusal, EmptyFile) { expectRefusal("", "is empty", true); }

TEST(Refusal, NoGraspSet) {
  expectRefusal("solid cube\n", "is no grasp set", true);
  expectRefusal(std::string(4096, '\0'), "is no grasp set", true);
  // HDF5, but not ours
  expectRefusal(goodBytes().substr(kBlockBytes), "is no grasp set", true);
}

TEST(Refusal, NewerFormat) {
  std::string bytes = goodBytes();
  bytes.replace(bytes.find("format_version 1"), 16, "format_version 2");
  expectRefusal(bytes, "has format version 2, want at most 1", true);
}

TEST(Refusal, TruncatedOrLonger) {
  const std::string bytes = goodBytes();
  for (const std::size_t length : {std::size_t{5}, std::size_t{19}, std::size_t{300}, kBlockBytes - 1, kBlockBytes,
                                   kBlockBytes + 1, kBlockBytes + 96, bytes.size() / 2, bytes.size() - 1}) {
    SCOPED_TRACE("length " + std::to_string(length));
    expectRefusal(bytes.substr(0, length), length < 19 ? "is no grasp set" : "is damaged", true);
  }
  expectRefusal(bytes + '\0', "is damaged", true);
}

// One bit anywhere: in the first bytes, in HDF5's structures, in the numbers, in the gaps between them.
TEST(Refusal, FlippedBit) {
  const std::string bytes = goodBytes();
  const RandomStream random(7);
  for (int i = 0; i < kFlips; ++i) {
    const std::size_t range = i < kFlips / 5 ? kBlockBytes : bytes.size();
    const auto position = static_cast<std::size_t>(random.bits(2 * i) % range);
    SCOPED_TRACE("byte " + std::to_string(position));
    std::string damaged = bytes;
    damaged[position] = static_cast<char>(damaged[position] ^ (1 << random.bits(2 * i + 1) % 8));
    expectRefusal(damaged, "", position < kBlockBytes);
  }
}

/// `bytes` with a block whose checksums fit them: what a program with a bug (or a forger) would write.
std::string sealed(const std::string& image, SetBlock block) {
  block.bytes = image.size();
  block.checksum = hashBytes(image.data(), image.size());
  return encodeBlock(block) + image;
}

// The checksum fits, but HDF5 cannot open it.
TEST(Refusal, SealedNoise) {
  expectRefusal(sealed(std::string(5000, 'x'), {"mug", "barrett", 1, "aa", 0, ""}), "cannot be opened by HDF5", false);
}

// The first bytes repeat attributes; they must agree.
TEST(Refusal, BlockOfAnotherSet) {
  const std::string image = goodBytes().substr(kBlockBytes);
  const std::string hash = syntheticSet().inputHash;
  expectRefusal(sealed(image, {"cup", "three-finger", 1, hash, 0, ""}), "/@object is mug, want cup", false);
  expectRefusal(sealed(image, {"mug", "jaw", 1, hash, 0, ""}), "/@hand is three-finger, want jaw", false);
  expectRefusal(sealed(image, {"mug", "three-finger", 2, hash, 0, ""}), "/@set_version is 1, want 2", false);
  expectRefusal(sealed(image, {"mug", "three-finger", 1, "ab", 0, ""}), "/@input_hash is 0011", false);
}

// No refusal: sets from before the attribute have none (here it has another name), the reference ran all of their
// trials.
TEST(OlderSet, WithoutCountOfTrialsByReference) {
  std::string image = goodBytes().substr(kBlockBytes);
  image.replace(image.find("by_reference"), 12, "by_nobody_12");
  const TestFolder folder;
  const fs::path path = folder.path() / "v0001.h5";
  writeBytes(path, sealed(image, {"mug", "three-finger", 1, syntheticSet().inputHash, 0, ""}));
  EXPECT_EQ(readGraspSet(path).trialsByReference, syntheticSet().trialCount());
  EXPECT_EQ(readSummary(path).trialsByReference, syntheticSet().trialCount());
}

/// The file of a set whose attribute is called otherwise, by as many letters.
fs::path writeWithout(const TestFolder& folder, const std::string& attribute, const std::string& other) {
  std::string image = goodBytes().substr(kBlockBytes);
  image.replace(image.find(attribute), attribute.size(), other);
  const fs::path path = folder.path() / "v0001.h5";
  writeBytes(path, sealed(image, {"mug", "three-finger", 1, syntheticSet().inputHash, 0, ""}));
  return path;
}

// Sets from before the attribute say nothing of the method's version.
TEST(OlderSet, WithoutMethodVersion) {
  const TestFolder folder;
  EXPECT_EQ(readGraspSet(writeWithout(folder, "method_version", "somebodys_note")).methodVersion, 0);
}

// Sets from before soft fingers have contacts that are points.
TEST(OlderSet, WithoutTorsionRadius) {
  const TestFolder folder;
  const fs::path path = writeWithout(folder, "torsion_radius", "torsion_nobody");
  EXPECT_EQ(readGraspSet(path).torsionRadius, 0);
  EXPECT_EQ(readSummary(path).torsionRadius, 0);
}

// Sets from before the true cone and the load margin have no such arrays: their rows read as not known.
TEST(OlderSet, WithoutLaterArrays) {
  if (std::system("/usr/bin/python3 -c 'import h5py' 2>/dev/null") != 0) GTEST_SKIP() << "needs python3-h5py";
  const TestFolder folder;
  const fs::path path = folder.path() / "v0001.h5";
  writeBytes(path, goodBytes());
  const std::string code =
      "import h5py, sys; f = h5py.File(sys.argv[1], 'r+', locking=False); "
      "[f.__delitem__('grasps/' + n) for n in "
      "('epsilon_lower', 'epsilon_upper', 'critical_friction', 'load_margin', 'robustness', 'robustness_lower', "
      "'robustness_upper')]";
  ASSERT_EQ(std::system(("/usr/bin/python3 -c \"" + code + "\" " + path.string()).c_str()), 0);
  writeBytes(path,
             sealed(bytesOf(path).substr(kBlockBytes), {"mug", "three-finger", 1, syntheticSet().inputHash, 0, ""}));
  const GraspSet set = readGraspSet(path);
  ASSERT_EQ(set.epsilonLower.size(), set.graspCount());
  EXPECT_TRUE(std::isnan(set.epsilonLower[0]));
  EXPECT_TRUE(std::isnan(set.epsilonUpper[0]));
  EXPECT_TRUE(std::isnan(set.criticalFriction[0]));
  ASSERT_EQ(set.robustness.size(), set.graspCount());
  EXPECT_TRUE(std::isnan(set.robustness[0]));
  ASSERT_EQ(set.loadMargin.size(), set.graspCount());
  EXPECT_TRUE(std::isnan(set.loadMargin[0]));
  const GraspSetSummary summary = readSummary(path);
  EXPECT_EQ(summary.grasps, set.graspCount());
  EXPECT_TRUE(std::isnan(summary.bestEpsilonLower));
  EXPECT_TRUE(std::isnan(summary.leastCriticalFriction));
  EXPECT_TRUE(std::isnan(summary.bestLoadMargin));
  EXPECT_EQ(summary.loadMargins, 0U);
}

// Whole files whose content contradicts db/FORMAT.md. h5py makes them, so the reader is held against another writer.
TEST(Refusal, ContradictionsInside) {
  if (std::system("/usr/bin/python3 -c 'import h5py' 2>/dev/null") != 0) GTEST_SKIP() << "needs python3-h5py";
  const TestFolder folder;
  const fs::path good = folder.path() / "good.h5", list = folder.path() / "list.tsv";
  writeBytes(good, goodBytes());
  const std::string script = std::string(HANDHOLD_SOURCE_DIR) + "/tests/store/damage_sets.py";
  const std::string command = "/usr/bin/python3 " + script + " " + good.string() + " " + folder.path().string();
  ASSERT_EQ(std::system((command + " > " + list.string()).c_str()), 0);
  std::istringstream lines(bytesOf(list));
  int count = 0;
  for (std::string line; std::getline(lines, line); ++count) {
    const std::size_t tab = line.find('\t');
    const fs::path path = folder.path() / line.substr(0, tab);
    const std::string image = bytesOf(path).substr(kBlockBytes);
    writeBytes(path, sealed(image, {"mug", "three-finger", 1, syntheticSet().inputHash, 0, ""}));
    const std::string found = refusalOf([&] { readGraspSet(path); });
    EXPECT_THAT(found, StartsWith(path.string() + ": " + line.substr(tab + 1)));
  }
  EXPECT_GT(count, 80);
}

struct BadSet {
  const char* message;
  void (*apply)(GraspSet&);
};

// The writer refuses what the reader would refuse.
TEST(Refusal, WriterChecksTheSet) {
  const BadSet cases[] = {
      {"/@input_hash is \"xyz\"", [](GraspSet& s) { s.inputHash = "xyz"; }},
      {"/@friction is nan", [](GraspSet& s) { s.friction = std::nan(""); }},
      {"job has a zero byte", [](GraspSet& s) { s.job = std::string("a\0b", 3); }},
      {"/object/vertices row 1 has 0.1, want a 32-bit float", [](GraspSet& s) { s.objectMesh.vertices[1].x() = 0.1; }},
      {"/object/triangles row 0 has vertex 4, want below 4", [](GraspSet& s) { s.objectMesh.triangles[0][2] = 4; }},
      {"/hand/link_names has \"hand_base\"", [](GraspSet& s) { s.linkNames[1] = s.linkNames[0]; }},
      {"/hand/links has 4 meshes, want 5", [](GraspSet& s) { s.linkMeshes.pop_back(); }},
      {"/hand/preshape_names has 1 names, want 2", [](GraspSet& s) { s.preshapeNames.pop_back(); }},
      {"/grasps/roll has 16 numbers, want shape (17)", [](GraspSet& s) { s.roll.pop_back(); }},
      {"/grasps/backoff is inf at element 2",
       [](GraspSet& s) { s.backoff[2] = std::numeric_limits<float>::infinity(); }},
      {"/trials/outcome is 9 at element 1", [](GraspSet& s) { s.outcome[1] = 9; }},
      {"/@torsion_radius is -0.001, want >= 0", [](GraspSet& s) { s.torsionRadius = -0.001; }},
      {"/trials@by_reference is 97, want at most 96", [](GraspSet& s) { s.trialsByReference = 97; }},
      {"/grasps/trial row 3 is (12, ", [](GraspSet& s) { s.trial[9] = 12; }},
      {"/grasps/epsilon row 1 is 9 after", [](GraspSet& s) { s.epsilon[1] = 9; }},
      {"/grasps/epsilon row 16 is",
       [](GraspSet& s) { std::swap_ranges(s.trial.end() - 6, s.trial.end() - 3, s.trial.end() - 3); }},
      {"/grasps/epsilon_lower row 2 is 9, want at most epsilon_upper", [](GraspSet& s) { s.epsilonLower[2] = 9; }},
      {"/grasps/critical_friction is inf at element 2",
       [](GraspSet& s) { s.criticalFriction[2] = std::numeric_limits<float>::infinity(); }},
      {"/@robustness_trials is -1, want >= 0", [](GraspSet& s) { s.robustnessTrials = -1; }},
      {"/@robustness_position is -1, want >= 0", [](GraspSet& s) { s.robustnessPosition = -1; }},
      {"/@robustness_rotation is -1, want >= 0", [](GraspSet& s) { s.robustnessRotation = -1; }},
      {"/grasps/robustness row 0 is 0.5 in [0.4, 1.5], want an interval within [0, 1] around it",
       [](GraspSet& s) { s.robustnessUpper[0] = 1.5F; }},
      {"/grasps/load_margin row 0 is -1, want at least 0", [](GraspSet& s) { s.loadMargin[0] = -1; }},
      {"/grasps/contact_begin row 2 is 0 after 2", [](GraspSet& s) { s.contactBegin[2] = 0; }},
      {"/grasps/contact_begin starts with 1", [](GraspSet& s) { s.contactBegin[0] = 1; }},
      {"/contacts/link row 0 is 5, want below 5", [](GraspSet& s) { s.contactLink[0] = 5; }},
      {"/distance_map/neighbor is 20 at element 4, want below 20", [](GraspSet& s) { s.mapNeighbor[4] = 20; }},
  };
  const TestFolder folder;
  for (const BadSet& bad : cases) {
    GraspSet set = syntheticSet();
    bad.apply(set);
    EXPECT_THAT(refusalOf([&] { Database(folder.path()).write(set); }),
                StartsWith(std::string("set mug/three-finger: ") + bad.message));
  }
  EXPECT_TRUE(Database(folder.path()).files().empty());
}

}  // namespace
}  // namespace handhold
