#pragma once

#include "app/program.h"
#include "build/build_job.h"
#include "build/shards.h"
#include "store/physics_set.h"
#include "store/prune.h"

#include <atomic>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace handhold {

struct BuildCommand {
  std::string job;
  BuildOptions options;
  bool dryRun = false, json = false;
  long long trial = -1;  // >= 0: explain one trial, write nothing
};

struct SubmitCommand {
  std::string job;
  BuildOptions options;                // the globs; shards = 0: as many as there are sets, at most 64
  bool print = false, status = false;  // show the scripts; say what is done: neither submits
  std::vector<std::string> sbatchOptions;
};

struct QueryCommand {
  GraspQuery query;                           // all but approach and near
  std::optional<std::string> approach, near;  // X,Y,Z
  double withinDeg = 0, radius = 0;           // of approach and near
  std::string format = "table";               // table, json or csv
};

struct ExportCommand {
  QueryCommand selection;                  // its format aside
  std::string to, folder, frame = "root";  // acronym, isaac, moveit, csv or gltf; root or tcp
};

struct ImportCommand {
  std::string file, mesh, unit, hand, name;  // unit: m, cm, mm, in or empty; name: empty for the mesh's stem
  std::string frame = "root", preshape;      // as GivenGraspOptions has them
  bool close = false;
  double friction = 0.4, contactDistance = 1e-4;  // m
  int threads = 0;                                // 0: all cores
  PackagePaths packages;
};

struct HandCommand {
  std::string path;         // a folder with hand.yaml; a URDF to begin one for
  bool initialise = false;  // print a first hand.yaml
  std::string rootLink;     // for it; empty: guessed
  std::string pictures;     // a folder; empty: none are drawn
  double sphereRadius = 0;  // m
  PackagePaths packages;
};

struct ReportCommand {
  std::string objectGlob = "*", handGlob = "*", output;
  std::optional<std::size_t> top;  // grasps of each set; none: as many as a page carries
};

struct VerifyCommand {
  std::string objectGlob = "*", handGlob = "*";
  int setVersion = 0;  // 0: all
  std::size_t sample = 20;
  bool json = false;
};

struct PhysicsCommand {
  std::string objectGlob = "*", handGlob = "*";
  std::optional<std::size_t> top;          // default: all grasps of a set
  std::vector<std::string> tests{"pull"};  // pull, weight, lift
  std::optional<double> friction;          // default: 1.5 times the set's own
  int threads = 0;                         // 0: all cores
  ProgressMode progress = ProgressMode::automatic;
  std::string replay, pictures;       // SET:I; the folder for its pictures
  std::optional<std::size_t> groups;  // compare so many grasps of each group, write nothing
  std::optional<std::size_t> pieces;  // check the labels of so many grasps, write nothing
  std::string calibrate;              // the folder for models of what holds; writes nothing else
  std::size_t draw = 50;              // for them: of the stored grasps and of the trials of each set
  std::uint64_t seed = 1;             // of what is drawn
  bool json = false;                  // of the groups
};

int runBuild(const BuildCommand& command, const Database& database);
int runSubmit(const SubmitCommand& command, const Database& database);
int runList(const Database& database, bool asJson);
int runInfo(const std::filesystem::path& path, bool asJson);
int runVerify(const VerifyCommand& command, const Database& database);
/// 0: the sets are equal, 1: they differ.
int runDiff(const std::string& a, const std::string& b, bool asJson, const Database& database);
int runPrune(const PruneOptions& options, const Database& database);
int runQuery(const QueryCommand& command, const Database& database);
int runExport(ExportCommand command, const Database& database);
int runImport(const ImportCommand& command, const Database& database);
int runIndex(const Database& database);
int runHand(const HandCommand& command);
int runRender(const std::string& set, const std::string& output);
/// One HTML file about the newest version of every set that the globs pick.
int runReport(const ReportCommand& command, const Database& database);
int runPhysics(const PhysicsCommand& command, const Database& database);
/// `physics --calibrate`
int runCalibration(const PhysicsCommand& command, const Database& database);

/// `SET[:I]`: a set file and the rank of a grasp in it, 0 when none is written; a file whose own name ends like that is
/// taken as it is. @throws InputError
struct GraspName {
  std::string path;
  std::size_t grasp = 0;
};
GraspName parseGraspName(const std::string& text);

/// The physics results beside a set; nothing when there are none. Those that cannot be used are told.
std::optional<PhysicsSet> physicsOf(const std::filesystem::path& set, const std::string& inputHash, int setVersion,
                                    std::size_t grasps);

/// Of each object and hand the newest set. @throws InputError  there is none
std::vector<SetFile> pickedSets(const Database& database, const PhysicsCommand& command);

/// The grasps that pass; failures, and what was left out and why, are told on stderr. @throws InputError
QueryAnswer findGrasps(const QueryCommand& command, const Database& database);

/// The sets of the job that the options' globs pick, with their shards. @throws InputError  there are none
std::vector<ShardedSet> selectedSets(const Job& job, const std::vector<Hand>& hands, const BuildOptions& options);

/// `--trial`: what happened to one candidate, step by step, on stdout.
int explainTrial(const Job& job, const CatalogItem& item, const Hand& hand, std::size_t trial);

/// What the contacts of such a torsion radius are, in words.
std::string contactModel(double torsionRadius);

/// `build --dry-run`: what is done, missing, failed, and what the rest would cost.
int printPlan(const BuildCommand& command, const Job& job, const std::vector<Hand>& hands, const Database& database);

/// SIGINT and SIGTERM make the flag true, once; the next one ends the program.
const std::atomic<bool>& stopOnSignals();

/// The table that `build` and `list` print: a row a set.
std::string summaryTable(const std::vector<GraspSetSummary>& summaries);

}  // namespace handhold
