// The offline program: builds grasp databases and shows what is in them.
#include "app/commands.h"
#include "app/program.h"
#include "core/error.h"

#include <cstdlib>
#include <filesystem>
#include <limits>
#include <map>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

namespace handhold {
namespace {

/// "I/N" with 0 <= I < N.
void parseShard(const std::string& text, BuildOptions& options) {
  if (text.empty()) return;
  char* end = nullptr;
  options.shard = std::strtoul(text.c_str(), &end, 10);
  options.shards = *end == '/' ? std::strtoul(end + 1, &end, 10) : 0;
  const bool plain = text.find_first_not_of("0123456789/") == std::string::npos;
  if (!plain || *end != '\0' || options.shard >= options.shards) {
    throw InputError(fmt::format("--shard is \"{}\", want I/N with I from 0 to N-1, as 0/4", text));
  }
}

/// The filters of `query`.
void addFilters(CLI::App* sub, QueryCommand& command) {
  GraspQuery& query = command.query;
  sub->add_option("--object", query.object, "only objects whose name matches")->type_name("GLOB");
  sub->add_option("--hand", query.hand, "only hands whose name matches")->type_name("GLOB");
  sub->add_option("--set-version", query.setVersion, "this version (default: the newest of each set)")->type_name("V");
  sub->add_option("--min-epsilon", query.minEpsilon, "epsilon, at the friction of the set's job, is at least E")
      ->type_name("E");
  sub->add_option("--friction", query.friction, "force closed at friction MU, at most that of the set's job")
      ->type_name("MU");
  CLI::Option* approach = sub->add_option("--approach", command.approach, "approach direction, palm to object");
  CLI::Option* within = sub->add_option("--within", command.withinDeg, "at most so many degrees from --approach");
  approach->type_name("X,Y,Z")->needs(within);
  within->type_name("DEG")->needs(approach);
  CLI::Option* near = sub->add_option("--near", command.near, "target point, object frame [m]");
  CLI::Option* radius = sub->add_option("--radius", command.radius, "at most so far from --near [m]");
  near->type_name("X,Y,Z")->needs(radius);
  radius->type_name("M")->needs(near);
  sub->add_option("--preshape", query.preshape, "only preshapes whose name matches")->type_name("GLOB");
  sub->add_option("--min-physics", query.minPhysics, "share of simulated directions survived, 0 to 1")->type_name("P");
  CLI::Option* top = sub->add_option("--top", query.top, "at most K of each set")->type_name("K");
  top->check(CLI::Range(1, std::numeric_limits<int>::max()));
  sub->add_flag("--diverse", query.diverse, "with --top: spread over those that pass, not the best; prints how well")
      ->needs(top);
}

CLI::App* addQuery(CLI::App& app, QueryCommand& command) {
  CLI::App* sub = app.add_subcommand("query", "the grasps of one or many sets that pass every filter, best first");
  addFilters(sub, command);
  sub->add_option("--format", command.format, "table, json or csv")->check(CLI::IsMember({"table", "json", "csv"}));
  return sub;
}

CLI::App* addExport(CLI::App& app, ExportCommand& command) {
  CLI::App* sub = app.add_subcommand("export", "write grasps for other programs (docs/exchange.md)");
  sub->add_option("--to", command.to, "acronym, isaac, moveit, csv or gltf")
      ->required()
      ->check(CLI::IsMember({"acronym", "isaac", "moveit", "csv", "gltf"}));
  sub->add_option("--out", command.folder, "the folder to write to")->required()->type_name("DIR");
  sub->add_option("--frame", command.frame, "poses are those of the hand's root link, or of the tcp of hand.yaml")
      ->check(CLI::IsMember({"root", "tcp"}));
  addFilters(sub, command.selection);
  return sub;
}

CLI::App* addImport(CLI::App& app, ImportCommand& command) {
  CLI::App* sub = app.add_subcommand("import", "make a set of grasps that were planned elsewhere (docs/exchange.md)");
  sub->add_option("file", command.file, "ACRONYM .h5, isaac_grasp .yaml or GraspGen .json")
      ->required()
      ->type_name("FILE");
  sub->add_option("--mesh", command.mesh, "the object's mesh")->required()->type_name("FILE");
  sub->add_option("--unit", command.unit, "of the mesh: m, cm, mm or in (default: the file's scale, else metres)")
      ->check(CLI::IsMember({"m", "cm", "mm", "in"}));
  sub->add_option("--hand", command.hand, "the hand's folder")->required()->type_name("DIR");
  sub->add_option("--name", command.name, "the object's name (default: that of the mesh file)")->type_name("NAME");
  sub->add_option("--frame", command.frame, "the file's poses are those of the hand's root, or of its tcp")
      ->check(CLI::IsMember({"root", "tcp"}));
  sub->add_option("--preshape", command.preshape,
                  "in which the hand arrives (default: as the file says, else the first)")
      ->type_name("NAME");
  sub->add_flag("--close", command.close, "pass over the file's joint positions: the policy closes the hand");
  sub->add_option("--friction", command.friction, "coefficient of friction")->check(CLI::Range(1e-6, 10.0));
  sub->add_option("--contact-distance", command.contactDistance, "links at most so far from the object touch it [m]")
      ->check(CLI::Range(2e-5, 2e-3));
  sub->add_option("--threads", command.threads, "default: one a core")->check(CLI::Range(1, 1024));
  return sub;
}

CLI::App* addPhysics(CLI::App& app, PhysicsCommand& command) {
  CLI::App* sub =
      app.add_subcommand("physics", "simulate the grasps of each set in MuJoCo: do they hold? (docs/physics.md)");
  sub->add_option("--object", command.objectGlob, "only objects whose name matches")->type_name("GLOB");
  sub->add_option("--hand", command.handGlob, "only hands whose name matches")->type_name("GLOB");
  sub->add_option("--top", command.top, "the best K grasps of each set (default: all)")
      ->type_name("K")
      ->check(CLI::Range(1, std::numeric_limits<int>::max()));
  sub->add_option("--test", command.tests, "pull (1 N on 0.1 kg), weight (its own), lift; with commas between them")
      ->delimiter(',')
      ->check(CLI::IsMember({"pull", "weight", "lift"}));
  sub->add_option("--friction", command.friction, "simulated (default: 1.5 times that of the set)")
      ->check(CLI::Range(0.01, 10.0));
  sub->add_option("--threads", command.threads, "default: one a core")->check(CLI::Range(1, 1024));
  CLI::Option* replay =
      sub->add_option("--replay", command.replay, "one grasp of a set, against its stored results")->type_name("SET:I");
  sub->add_option("--pictures", command.pictures, "with --replay: a folder for pictures of it")
      ->type_name("DIR")
      ->needs(replay);
  CLI::Option* groups = sub->add_option("--groups", command.groups,
                                        "compare K grasps each of the best, stored, trials and open; writes nothing");
  groups->type_name("K")->check(CLI::Range(1, 1'000'000))->excludes(replay);
  CLI::Option* pieces =
      sub->add_option(
             "--pieces", command.pieces,
             "label K grasps drawn from stored and trials with the object as convex pieces too; writes nothing")
          ->type_name("K")
          ->check(CLI::Range(1, 1'000'000))
          ->excludes(replay)
          ->excludes(groups);
  CLI::Option* calibrate = sub->add_option(
      "--calibrate", command.calibrate,
      "fit the probability that a grasp holds to drawn grasps, a model a hand; writes it and plots here");
  calibrate->type_name("DIR")->excludes(replay)->excludes(groups)->excludes(pieces);
  sub->add_option("--draw", command.draw,
                  "with --calibrate: stored grasps, and as many trials, of each set (default 50)")
      ->type_name("K")
      ->check(CLI::Range(1, 1'000'000))
      ->needs(calibrate);
  sub->add_option("--seed", command.seed, "of what is drawn at random");
  return sub;
}

int runProgram(int argc, char** argv) {
  CLI::App app("Handhold builds databases of robot grasps and shows what is in them.", "handhold");
  app.set_version_flag("--version", "handhold " HANDHOLD_VERSION);
  app.require_subcommand(1);
  std::string databaseFolder = defaultDatabase(), format = "table", shard, progress = "auto", path, output;
  std::vector<std::string> packages;
  BuildCommand build;
  VerifyCommand verify;
  PruneOptions prune;
  std::string otherSet;
  HandCommand hand;
  double sphereDiameter = 0.05;

  const auto addDatabase = [&](CLI::App* command) {
    command->add_option("--db", databaseFolder, "the database folder (default: $HANDHOLD_DB, then ./db)");
  };
  const auto addFormat = [&](CLI::App* command) {
    command->add_option("--format", format, "table or json")->check(CLI::IsMember({"table", "json"}));
  };
  const auto addNames = [&](CLI::App* command, std::string& objectGlob, std::string& handGlob) {
    command->add_option("--object", objectGlob, "only objects whose name matches")->type_name("GLOB");
    command->add_option("--hand", handGlob, "only hands whose name matches")->type_name("GLOB");
  };
  const auto addPackages = [&](CLI::App* command) {
    command->add_option("--package", packages, "NAME=DIR: where package://NAME/ leads")->type_name("NAME=DIR");
  };

  const auto addProgress = [&](CLI::App* command) {
    command->add_option("--progress", progress, "auto, plain, json or none")
        ->check(CLI::IsMember({"auto", "plain", "json", "none"}));
  };

  CLI::App* buildCommand = app.add_subcommand("build", "build the grasp sets of a job");
  buildCommand->add_option("job", build.job, "the job file (YAML)")->required()->type_name("JOB.yaml");
  addDatabase(buildCommand);
  addPackages(buildCommand);
  buildCommand->add_option("--threads", build.options.threads, "default: one a core")->check(CLI::Range(1, 1024));
  addNames(buildCommand, build.options.objectGlob, build.options.handGlob);
  buildCommand->add_option("--shard", shard, "only the I-th of N parts, I from 0")->type_name("I/N");
  buildCommand->add_flag("--force", build.options.force, "write the next version though nothing changed");
  buildCommand->add_flag("--retry-failed", build.options.retryFailed, "try inputs again that are known to fail");
  buildCommand->add_flag("--dry-run", build.dryRun, "say what is done, missing, failed, and what the rest would cost");
  addFormat(buildCommand);
  addProgress(buildCommand);
  buildCommand->add_option("--trial", build.trial, "explain one trial (index into N*R*M), write nothing")
      ->check(CLI::Range(0LL, std::numeric_limits<long long>::max()));

  CLI::App* listCommand = app.add_subcommand("list", "a line for every set and version");
  addDatabase(listCommand);
  addFormat(listCommand);

  CLI::App* infoCommand = app.add_subcommand("info", "one set, or all below a folder: provenance, outcomes, timings");
  infoCommand->add_option("set", path, "a set file or a folder")->required()->type_name("FILE|DIR");
  addFormat(infoCommand);

  CLI::App* verifyCommand = app.add_subcommand(
      "verify", "checksums, then grasps and trials of each set recomputed from its own record, bit for bit");
  addDatabase(verifyCommand);
  addNames(verifyCommand, verify.objectGlob, verify.handGlob);
  verifyCommand->add_option("--set-version", verify.setVersion, "only this version")
      ->check(CLI::Range(1, 1'000'000'000));
  verifyCommand->add_option("--sample", verify.sample, "grasps, and as many trials, of each set (default 20; 0: none)")
      ->check(CLI::Range(0, std::numeric_limits<int>::max()));
  addFormat(verifyCommand);

  CLI::App* diffCommand = app.add_subcommand(
      "diff", "what changed from set A to set B; exit status 0: equal, 1: they differ, 2: one cannot be read");
  diffCommand->add_option("A", path, "a set file, OBJECT/HAND (its newest version) or OBJECT/HAND/vN")->required();
  diffCommand->add_option("B", otherSet, "the other")->required();
  addDatabase(diffCommand);
  addFormat(diffCommand);

  CLI::App* pruneCommand = app.add_subcommand("prune", "remove old versions, and temporary files of dead builders");
  pruneCommand->add_option("--keep", prune.keep, "newest versions of each set that stay, at least 1")
      ->required()
      ->check(CLI::Range(1, 1'000'000'000));
  addDatabase(pruneCommand);
  addNames(pruneCommand, prune.objectGlob, prune.handGlob);
  pruneCommand->add_flag("--dry-run", prune.dryRun, "only say what would be removed");

  QueryCommand query;
  CLI::App* queryCommand = addQuery(app, query);
  addDatabase(queryCommand);

  ExportCommand exporting;
  CLI::App* exportCommand = addExport(app, exporting);
  addDatabase(exportCommand);

  ImportCommand importing;
  CLI::App* importCommand = addImport(app, importing);
  addDatabase(importCommand);
  addPackages(importCommand);

  PhysicsCommand physics;
  CLI::App* physicsCommand = addPhysics(app, physics);
  addDatabase(physicsCommand);
  addProgress(physicsCommand);
  addFormat(physicsCommand);

  CLI::App* indexCommand = app.add_subcommand("index", "write index.sqlite: list and queries over many sets get fast");
  addDatabase(indexCommand);

  CLI::App* handCommand = app.add_subcommand("hand", "check a hand: joints, coupling, palm, every preshape closed");
  handCommand->add_option("hand", hand.path, "the hand's folder, or a URDF with --init")
      ->required()
      ->type_name("DIR|FILE.urdf");
  CLI::Option* init =
      handCommand->add_flag("--init", hand.initialise, "print a first hand.yaml, guessed from the URDF");
  handCommand->add_option("--root", hand.rootLink, "the hand is what hangs from this link (default: guessed)")
      ->type_name("LINK")
      ->needs(init);
  handCommand->add_option("--out", hand.pictures, "draw every preshape, open and closed on the sphere, as DIR/NAME.png")
      ->type_name("DIR")
      ->excludes(init);
  handCommand->add_option("--sphere", sphereDiameter, "diameter [m] of the sphere to close on")
      ->check(CLI::Range(0.001, 10.0));
  addPackages(handCommand);

  CLI::App* renderCommand = app.add_subcommand("render", "a picture of a grasp (the best, or number I by rank)");
  renderCommand->add_option("set", path, "a set file, with :I for the I-th grasp from 0")
      ->required()
      ->type_name("SET[:I]");
  renderCommand->add_option("--out", output, "the PNG to write")->required()->type_name("PNG");

  ReportCommand report;
  CLI::App* reportCommand =
      app.add_subcommand("report", "sets in one HTML file that a browser shows: grasps in 3-D, filters, outcomes");
  reportCommand->add_option("--out", report.output, "the file to write")->required()->type_name("FILE.html");
  addDatabase(reportCommand);
  addNames(reportCommand, report.objectGlob, report.handGlob);
  reportCommand->add_option("--top", report.top, "at most K grasps of each set (default: 50000 in all)")
      ->check(CLI::Range(1, std::numeric_limits<int>::max()))
      ->type_name("K");

  SubmitCommand submit;
  submit.options.shards = 0;
  bool slurm = false;
  CLI::App* submitCommand = app.add_subcommand("submit", "build a job on a cluster: a Slurm job array and its summary");
  submitCommand->add_option("job", submit.job, "the job file (YAML)")->required()->type_name("JOB.yaml");
  submitCommand->add_flag("--slurm", slurm, "for Slurm, by sbatch")->required();
  addDatabase(submitCommand);
  addPackages(submitCommand);
  submitCommand->add_option("--shards", submit.options.shards, "tasks (default: one a set, at most 64)")
      ->check(CLI::Range(1, 1'000'000));
  submitCommand->add_option("--object", submit.options.objectGlob, "only objects whose name matches")
      ->type_name("GLOB");
  submitCommand->add_option("--hand", submit.options.handGlob, "only hands whose name matches")->type_name("GLOB");
  CLI::Option* print = submitCommand->add_flag("--print", submit.print, "show scripts and commands, submit nothing");
  submitCommand->add_flag("--status", submit.status, "say which sets are not built, submit nothing")->excludes(print);
  submitCommand
      ->add_option("options", submit.sbatchOptions, "after --: options of sbatch, for the array and its summary")
      ->type_name("SBATCH OPTIONS");

  if (const int exit = parseArguments(app, argc, argv); exit >= 0) return exit;

  static const std::map<std::string, ProgressMode> kModes = {{"auto", ProgressMode::automatic},
                                                             {"plain", ProgressMode::plain},
                                                             {"json", ProgressMode::json},
                                                             {"none", ProgressMode::none}};
  build.options.progress = physics.progress = kModes.at(progress);
  build.options.packages = importing.packages = hand.packages = parsePackages(packages);
  hand.sphereRadius = sphereDiameter / 2;
  build.json = verify.json = physics.json = format == "json";
  parseShard(shard, build.options);
  const Database database(databaseFolder);
  // These make the folder where there is none; what else has its name would fail every set.
  const bool makesFolder = *buildCommand || *submitCommand || *importCommand;
  std::error_code ignored;
  if (makesFolder && std::filesystem::exists(databaseFolder, ignored)) database.requireFolder();
  if (*submitCommand) {
    submit.options.packages = build.options.packages;
    return runSubmit(submit, database);
  }
  if (*buildCommand) return runBuild(build, database);
  if (*listCommand) return runList(database, format == "json");
  if (*infoCommand) return runInfo(path, format == "json");
  if (*queryCommand) return runQuery(query, database);
  if (*exportCommand) return runExport(exporting, database);
  if (*importCommand) return runImport(importing, database);
  if (*physicsCommand) return runPhysics(physics, database);
  if (*indexCommand) return runIndex(database);
  if (*verifyCommand) return runVerify(verify, database);
  if (*diffCommand) return runDiff(path, otherSet, format == "json", database);
  if (*pruneCommand) return runPrune(prune, database);
  if (*handCommand) return runHand(hand);
  if (*reportCommand) return runReport(report, database);
  return runRender(path, output);
}

}  // namespace
}  // namespace handhold

int main(int argc, char** argv) { return handhold::runGuarded(handhold::runProgram, argc, argv); }
