// What a job file may say, and one test for each thing that it may not.
#include "build/job.h"

#include "core/error.h"

#include <filesystem>
#include <fstream>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

class JobFile : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(::testing::TempDir()) / ::testing::UnitTest::GetInstance()->current_test_info()->name();
    fs::remove_all(folder_);
    fs::create_directories(folder_ / "meshes" / "cup");
    for (const char* name : {"meshes/a.obj", "meshes/b.ply", "meshes/cup/model.ply"}) write(name, "x");
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name) << text;
    return (folder_ / name).string();
  }

  /// A complete job with `catalog` as the entries and `rest` after it.
  Job load(const std::string& catalog, const std::string& rest = "sampling: {samples: 10}\n") const {
    return loadJob(write("job.yaml", "catalog:\n" + catalog + "hands: [hand]\n" + rest));
  }

  /// The message of the refusal.
  std::string refusal(const std::string& catalog, const std::string& rest = "sampling: {samples: 10}\n") const {
    try {
      load(catalog, rest);
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), Not(HasSubstr("\n")));
      return error.what();
    }
    return "(accepted)";
  }

  fs::path folder_;
  const std::string good_ = "  - {name: a, mesh: meshes/a.obj, unit: m}\n";
};

TEST_F(JobFile, DefaultsAreThoseOfTheContract) {
  const Job job = load(good_);
  EXPECT_EQ(job.samples, 10U);
  EXPECT_EQ(job.rolls, 16);
  EXPECT_EQ(job.policy, PolicyKind::surfaceNormal);
  EXPECT_EQ(job.simulation, Simulation::fast);
  EXPECT_EQ(job.friction, 0.4);
  EXPECT_EQ(job.coneEdges, 8);
  EXPECT_EQ(job.keepTop, 0U);
  EXPECT_EQ(job.seed, 1U);
  EXPECT_EQ(job.robustness.noise.trials, 0);
  EXPECT_EQ(job.loadMargin.grasps, 200);
  EXPECT_EQ(job.loadMargin.directions, 14);
  EXPECT_TRUE(job.loadMargin.taskWrenches.empty());
  ASSERT_EQ(job.catalog.size(), 1U);
  EXPECT_EQ(job.catalog[0].mesh, (folder_ / "meshes/a.obj").string());
  EXPECT_EQ(job.handPaths[0], (folder_ / "hand").string());
}

TEST_F(JobFile, UnitsBecomeScales) {
  for (const auto& [unit, scale] : {std::pair{"m", 1.0}, {"cm", 0.01}, {"mm", 0.001}, {"in", 0.0254}}) {
    const Job job = load(std::string("  - {name: a, mesh: a.obj, unit: ") + unit + "}\n");
    EXPECT_EQ(job.catalog[0].unit.scale, scale);
    EXPECT_TRUE(job.catalog[0].unit.written);
  }
  EXPECT_EQ(load("  - {name: a, mesh: a.obj, scale: 0.5}\n").catalog[0].unit.scale, 0.5);
  EXPECT_FALSE(load("  - {name: a, mesh: a.obj}\n").catalog[0].unit.written);
}

TEST_F(JobFile, PathsMayNameTheEnvironment) {
  ASSERT_EQ(::setenv("HANDHOLD_TEST_MESHES", (folder_ / "meshes").c_str(), 1), 0);
  EXPECT_EQ(load("  - {name: a, mesh: \"${HANDHOLD_TEST_MESHES}/a.obj\"}\n").catalog[0].mesh,
            (folder_ / "meshes/a.obj").string());
  EXPECT_EQ(load("  - {folder: \"${HANDHOLD_TEST_MESHES}\", unit: m}\n").catalog.size(), 2U);
  ASSERT_EQ(::unsetenv("HANDHOLD_TEST_MESHES"), 0);
  EXPECT_THAT(refusal("  - {folder: \"${HANDHOLD_TEST_MESHES}\", unit: m}\n"), HasSubstr("HANDHOLD_TEST_MESHES"));
}

TEST_F(JobFile, FolderEntriesTakeTheirNamesFromFiles) {
  const Job stems = load("  - {folder: meshes, glob: \"*.*\", unit: m, friction: 0.3}\n");
  ASSERT_EQ(stems.catalog.size(), 2U);
  EXPECT_EQ(stems.catalog[0].name, "a");
  EXPECT_EQ(stems.catalog[1].name, "b");
  EXPECT_EQ(stems.catalog[1].friction, 0.3);
  const Job parents = load("  - {folder: meshes, glob: \"*/*.ply\", name: \"{parent}\", unit: m}\n");
  ASSERT_EQ(parents.catalog.size(), 1U);
  EXPECT_EQ(parents.catalog[0].name, "cup");
}

TEST_F(JobFile, CsvEntriesAreRows) {
  write("items.csv", "name,mesh,unit,mass\n\"a\",\"meshes/a.obj\",mm,0.25\nb,meshes/b.ply,,\n");
  const Job job = load("  - {csv: items.csv}\n");
  ASSERT_EQ(job.catalog.size(), 2U);
  EXPECT_EQ(job.catalog[0].unit.scale, 0.001);
  EXPECT_EQ(job.catalog[0].mass, 0.25);
  EXPECT_FALSE(job.catalog[1].unit.written);
  EXPECT_FALSE(job.catalog[1].mass.has_value());
}

TEST_F(JobFile, CsvRefusalsNameTheCsvLine) {
  write("items.csv", "name,mesh,unit\na,meshes/a.obj,m\nb,meshes/b.ply,yards\n");
  EXPECT_THAT(refusal("  - {csv: items.csv}\n"),
              AllOf(HasSubstr("items.csv:3: unit is \"yards\", want m, cm, mm or in")));
  write("items.csv", "name,mesh,unit\na,meshes/a.obj\n");
  EXPECT_THAT(refusal("  - {csv: items.csv}\n"), HasSubstr("items.csv:2: has 2 fields, want 3"));
  write("items.csv", "name,mesh,colour\na,meshes/a.obj,red\n");
  EXPECT_THAT(refusal("  - {csv: items.csv}\n"), HasSubstr("items.csv:2: colour is not a known key"));
}

TEST_F(JobFile, RefusesUnknownKeysAnywhere) {
  EXPECT_THAT(refusal(good_, "sampling: {samples: 10}\nsamplings: 3\n"),
              HasSubstr("job.yaml:5: samplings is not a known key"));
  EXPECT_THAT(refusal(good_, "sampling: {samples: 10, roll: 3}\n"),
              HasSubstr("job.yaml:4: sampling.roll is not a known key"));
  EXPECT_THAT(refusal("  - {name: a, mesh: a.obj, colour: red}\n"),
              HasSubstr("job.yaml:2: catalog[0].colour is not a known key"));
}

// Not all of them, as a job that does not name any has.
TEST_F(JobFile, PreshapesAreNotAnEmptyList) {
  EXPECT_THAT(refusal(good_, "sampling: {samples: 10, preshapes: []}\n"),
              HasSubstr("job.yaml:4: sampling.preshapes is a list of 0, want at least one preshape"));
}

TEST_F(JobFile, LoadMarginHasTasks) {
  const auto with = [&](const std::string& margin) {
    return load(good_, "sampling: {samples: 10}\nquality: {load_margin: " + margin + "}\n");
  };
  EXPECT_EQ(with("{grasps: 0}").loadMargin.grasps, 0);
  const Job job = with("{directions: 6, wrenches: [[1, 0, 0, 0, 0, 0.1], [0, 0, 0, 0, 2, 0]]}");
  EXPECT_EQ(job.loadMargin.directions, 6);
  const TaskWrenches tasks = taskWrenches(job);
  ASSERT_EQ(tasks.cols(), 8);
  EXPECT_TRUE(tasks.leftCols(6) == weightDirections(6));
  EXPECT_EQ(tasks(5, 6), 0.1);
  EXPECT_EQ(tasks(4, 7), 2);
}

TEST_F(JobFile, RobustnessHasNoise) {
  const auto text = [](const std::string& robustness) {
    return "sampling: {samples: 10}\nquality: {robustness: " + robustness + "}\n";
  };
  const Job job = load(good_, text("{position: 0.003, rotation_deg: 90}"));
  EXPECT_EQ(job.robustness.grasps, 200);
  EXPECT_EQ(job.robustness.noise.trials, 100);
  EXPECT_EQ(job.robustness.noise.position, 0.003);
  EXPECT_DOUBLE_EQ(job.robustness.noise.rotation, std::numbers::pi / 2);
  const auto refused = [&](const std::string& robustness) { return refusal(good_, text(robustness)); };
  EXPECT_THAT(refused("{position: 0.003}"), HasSubstr("job.yaml:5: quality.robustness has no key \"rotation_deg\""));
  EXPECT_THAT(refused("{position: -1, rotation_deg: 3}"), HasSubstr("quality.robustness.position is \"-1\""));
  EXPECT_THAT(refused("{position: .nan, rotation_deg: 3}"), HasSubstr("quality.robustness.position"));
  EXPECT_THAT(refused("{position: 0, rotation_deg: 91}"), HasSubstr("quality.robustness.rotation_deg is \"91\""));
  EXPECT_THAT(refused("{position: 0, rotation_deg: 0, trials: 0}"), HasSubstr("quality.robustness.trials is \"0\""));
  EXPECT_THAT(refused("{position: 0, rotation_deg: 0, noise: 1}"),
              HasSubstr("quality.robustness.noise is not a known key"));
}

TEST_F(JobFile, RefusesOtherLoads) {
  const auto refused = [&](const std::string& margin) {
    return refusal(good_, "sampling: {samples: 10}\nquality: {load_margin: " + margin + "}\n");
  };
  EXPECT_THAT(refused("{grasp: 5}"), HasSubstr("job.yaml:5: quality.load_margin.grasp is not a known key"));
  EXPECT_THAT(refused("{grasps: -1}"), HasSubstr("quality.load_margin.grasps is \"-1\""));
  EXPECT_THAT(refused("{directions: 5}"), HasSubstr("quality.load_margin.directions is \"5\""));
  EXPECT_THAT(refused("{directions: 51}"), HasSubstr("quality.load_margin.directions is \"51\""));
  EXPECT_THAT(refused("{wrenches: 3}"), HasSubstr("quality.load_margin.wrenches"));
  for (const char* wrench : {"[1, 2, 3]", "[0, 0, 0, 0, 0, 0]", "7"}) {
    EXPECT_THAT(refused(std::string("{wrenches: [[1, 0, 0, 0, 0, 0], ") + wrench + "]}"),
                AllOf(HasSubstr("job.yaml:5: quality.load_margin.wrenches[1]")))
        << wrench;
  }
  EXPECT_THAT(refused("{wrenches: [[1, 0, 0, 0, 0, .nan]]}"), HasSubstr("quality.load_margin.wrenches[0][5]"));
  std::string many = "[1, 0, 0, 0, 0, 0]";
  for (int i = 0; i < 200; ++i) many += ", [1, 0, 0, 0, 0, 0]";
  EXPECT_THAT(refused("{wrenches: [" + many + "]}"), HasSubstr("has 201 wrenches, want at most 200"));
}

TEST_F(JobFile, RefusesARepeatedKey) {
  EXPECT_THAT(refusal(good_, "sampling: {samples: 10, samples: 11}\n"),
              HasSubstr("job.yaml:4: sampling.samples is given twice"));
}

TEST_F(JobFile, RefusesANameTwice) {
  EXPECT_THAT(refusal(good_ + "  - {name: a, mesh: meshes/b.ply, unit: m}\n"),
              AllOf(HasSubstr("job.yaml:3: the object name \"a\" is already taken by"), HasSubstr("a.obj")));
}

TEST_F(JobFile, RefusesAnUnknownUnit) {
  EXPECT_THAT(refusal("  - {name: a, mesh: a.obj, unit: ft}\n"),
              HasSubstr("catalog[0].unit is \"ft\", want m, cm, mm or in"));
}

TEST_F(JobFile, RefusesUnitAndScaleTogether) {
  EXPECT_THAT(refusal("  - {name: a, mesh: a.obj, unit: m, scale: 2}\n"), HasSubstr("scale is given beside unit"));
}

TEST_F(JobFile, RefusesNamesThatLeaveTheDatabase) {
  for (const char* name : {"../x", "a/b", ".hidden", "\"\""}) {
    EXPECT_THAT(refusal(std::string("  - {name: ") + name + ", mesh: a.obj}\n"), HasSubstr("job.yaml:2:")) << name;
  }
}

TEST_F(JobFile, RefusesSamplingWithoutOrWithBothMeasures) {
  EXPECT_THAT(refusal(good_, "sampling: {rolls: 4}\n"), HasSubstr("needs samples (a number) or pitch (metres)"));
  EXPECT_THAT(refusal(good_, "sampling: {samples: 4, pitch: 0.01}\n"), HasSubstr("one of them"));
  EXPECT_THAT(refusal(good_, "sampling: {pitch: -0.02}\n"),
              HasSubstr("sampling.pitch is \"-0.02\", want a number > 0"));
  EXPECT_THAT(refusal(good_, "sampling: {samples: 1.5}\n"),
              HasSubstr("sampling.samples is \"1.5\", want a whole number"));
  EXPECT_THAT(refusal(good_, ""), HasSubstr("has no key \"sampling\""));
}

TEST_F(JobFile, RefusesAnUnknownPolicy) {
  EXPECT_THAT(refusal(good_, "sampling: {samples: 4, policy: random}\n"),
              HasSubstr("want surface_normal or center_of_mass"));
}

TEST_F(JobFile, SimulationIsFastOrReference) {
  const std::string sampling = "sampling: {samples: 4}\n";
  EXPECT_EQ(load(good_, sampling + "simulation: fast\n").simulation, Simulation::fast);
  EXPECT_EQ(load(good_, sampling + "simulation: reference\n").simulation, Simulation::reference);
  EXPECT_THAT(refusal(good_, sampling + "simulation: exact\n"),
              HasSubstr("job.yaml:5: simulation is \"exact\", want fast or reference"));
}

TEST_F(JobFile, RefusesFoldersThatGiveNothing) {
  EXPECT_THAT(refusal("  - {folder: nowhere}\n"),
              HasSubstr("catalog[0].folder is \"nowhere\", want an existing folder"));
  EXPECT_THAT(refusal("  - {folder: meshes, glob: \"*.stl\"}\n"), HasSubstr("matches no file"));
}

TEST_F(JobFile, RefusesBadQuality) {
  EXPECT_THAT(refusal(good_, "sampling: {samples: 4}\nquality: {friction: 0}\n"),
              HasSubstr("quality.friction is \"0\", want a number > 0"));
  EXPECT_THAT(refusal(good_, "sampling: {samples: 4}\nquality: {cone_edges: 2}\n"),
              HasSubstr("want a whole number from 3 to 64"));
  EXPECT_THAT(refusal(good_, "sampling: {samples: 4}\nquality: {contact_distance: 0.1}\n"),
              HasSubstr("quality.contact_distance is \"0.1\", want a number of metres from 0.00002 to 0.002"));
}

TEST_F(JobFile, RefusesWhatIsNoYaml) {
  EXPECT_THAT(refusal("  - {name: a\n"), HasSubstr("is no valid YAML"));
  EXPECT_THROW(loadJob((folder_ / "missing.yaml").string()), InputError);
}

TEST_F(JobFile, RefusesAPreshapeThatNoHandHas) {
  Job job = load(good_, "sampling: {samples: 4, preshapes: [open_80, tight]}\n");
  job.handPaths = {HANDHOLD_SOURCE_DIR "/hands/jaw"};
  try {
    loadHands(job);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("sampling.preshapes has \"tight\""));
  }
  job.preshapes = {"open_80"};
  EXPECT_EQ(loadHands(job)[0].preshapes.size(), 1U);
}

TEST(ShippedJobs, Load) {
  for (const char* name : {"demo", "paper", "full"}) {
    const Job job = loadJob(std::string(HANDHOLD_SOURCE_DIR "/jobs/") + name + ".yaml");
    EXPECT_GE(job.catalog.size(), 3U);
    for (const CatalogItem& item : job.catalog) EXPECT_TRUE(fs::exists(item.mesh)) << item.mesh;
    EXPECT_GE(loadHands(job).size(), 2U);
  }
}

}  // namespace
}  // namespace handhold
