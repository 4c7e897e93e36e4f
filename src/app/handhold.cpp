// The offline program: builds grasp databases and shows what is in them.
#include "app/commands.h"
#include "core/error.h"
#include "core/log.h"

#include <cstdlib>
#include <map>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

namespace handhold {
namespace {

std::string defaultDatabase() {
  const char* fromEnvironment = std::getenv("HANDHOLD_DB");
  return fromEnvironment != nullptr && *fromEnvironment != '\0' ? fromEnvironment : "./db";
}

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

PackagePaths parsePackages(const std::vector<std::string>& given) {
  PackagePaths packages;
  for (const std::string& entry : given) {
    const std::size_t equals = entry.find('=');
    if (equals == std::string::npos || equals == 0)
      throw InputError(fmt::format("--package is \"{}\", want NAME=DIR", entry));
    packages[entry.substr(0, equals)] = entry.substr(equals + 1);
  }
  return packages;
}

int runProgram(int argc, char** argv) {
  CLI::App app("Handhold builds databases of robot grasps and shows what is in them.", "handhold");
  app.set_version_flag("--version", "handhold " HANDHOLD_VERSION);
  app.require_subcommand(1);
  std::string databaseFolder = defaultDatabase(), format = "table", shard, progress = "auto", path, output;
  std::vector<std::string> packages;
  BuildCommand build;
  bool initialise = false;
  double sphereDiameter = 0.05;

  const auto addDatabase = [&](CLI::App* command) {
    command->add_option("--db", databaseFolder, "the database folder (default: $HANDHOLD_DB, then ./db)");
  };
  const auto addFormat = [&](CLI::App* command) {
    command->add_option("--format", format, "table or json")->check(CLI::IsMember({"table", "json"}));
  };
  const auto addPackages = [&](CLI::App* command) {
    command->add_option("--package", packages, "NAME=DIR: where package://NAME/ leads")->type_name("NAME=DIR");
  };

  CLI::App* buildCommand = app.add_subcommand("build", "build the grasp sets of a job");
  buildCommand->add_option("job", build.job, "the job file (YAML)")->required()->type_name("JOB.yaml");
  addDatabase(buildCommand);
  addPackages(buildCommand);
  buildCommand->add_option("--threads", build.options.threads, "default: one a core")->check(CLI::Range(1, 1024));
  buildCommand->add_option("--object", build.options.objectGlob, "only objects whose name matches")->type_name("GLOB");
  buildCommand->add_option("--hand", build.options.handGlob, "only hands whose name matches")->type_name("GLOB");
  buildCommand->add_option("--shard", shard, "only the I-th of N parts, I from 0")->type_name("I/N");
  buildCommand->add_flag("--force", build.options.force, "write the next version though nothing changed");
  buildCommand->add_flag("--dry-run", build.dryRun, "say what would be done and what it would cost");
  buildCommand->add_option("--progress", progress, "auto, plain, json or none")
      ->check(CLI::IsMember({"auto", "plain", "json", "none"}));
  buildCommand->add_option("--trial", build.trial, "explain one trial (index into N*R*M), write nothing")
      ->check(CLI::NonNegativeNumber);

  CLI::App* listCommand = app.add_subcommand("list", "a line for every set and version");
  addDatabase(listCommand);
  addFormat(listCommand);

  CLI::App* infoCommand = app.add_subcommand("info", "one set, or all below a folder: provenance, outcomes, timings");
  infoCommand->add_option("set", path, "a set file or a folder")->required()->type_name("FILE|DIR");
  addFormat(infoCommand);

  CLI::App* handCommand = app.add_subcommand("hand", "check a hand: joints, coupling, palm, every preshape closed");
  handCommand->add_option("hand", path, "the hand's folder, or a URDF with --init")
      ->required()
      ->type_name("DIR|FILE.urdf");
  handCommand->add_flag("--init", initialise, "print a hand.yaml to start from");
  handCommand->add_option("--sphere", sphereDiameter, "diameter [m] of the sphere to close on")
      ->check(CLI::PositiveNumber);
  addPackages(handCommand);

  CLI::App* renderCommand = app.add_subcommand("render", "a picture of a grasp (the best, or number I by rank)");
  renderCommand->add_option("set", path, "a set file, with :I for the I-th grasp from 0")
      ->required()
      ->type_name("SET[:I]");
  renderCommand->add_option("--out", output, "the PNG to write")->required()->type_name("PNG");

  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& success) {  // --help, --version
    return app.exit(success);
  } catch (const CLI::ParseError& error) {
    if (app.get_subcommands().empty() && argc > 1 && argv[1][0] != '-') {
      logError(
          fmt::format("\"{}\" is no command, want build, list, info, hand or render (see handhold --help)", argv[1]));
      return kExitWrongInput;
    }
    logError(fmt::format("{} (see handhold --help)", error.what()));
    return kExitWrongInput;
  }

  static const std::map<std::string, ProgressMode> kModes = {{"auto", ProgressMode::automatic},
                                                             {"plain", ProgressMode::plain},
                                                             {"json", ProgressMode::json},
                                                             {"none", ProgressMode::none}};
  build.options.progress = kModes.at(progress);
  build.packages = parsePackages(packages);
  parseShard(shard, build.options);
  const Database database(databaseFolder);
  if (*buildCommand) return runBuild(build, database);
  if (*listCommand) return runList(database, format == "json");
  if (*infoCommand) return runInfo(path, format == "json");
  if (*handCommand) return runHand(path, initialise, build.packages, sphereDiameter / 2);
  return runRender(path, output);
}

}  // namespace
}  // namespace handhold

int main(int argc, char** argv) {
  try {
    return handhold::runProgram(argc, argv);
  } catch (const handhold::InputError& error) {
    handhold::logError(error.what());
    return handhold::kExitWrongInput;
  } catch (const handhold::SystemError& error) {
    handhold::logError(error.what());
    return handhold::kExitItemFailed;
  } catch (const std::exception& error) {
    handhold::logError(std::string("unexpected: ") + error.what());
    return handhold::kExitItemFailed;
  }
}
