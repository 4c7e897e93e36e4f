#pragma once

#include "build/build_job.h"

#include <filesystem>
#include <string>
#include <vector>

namespace handhold {

/// Exit codes of every program (contract).
inline constexpr int kExitDone = 0, kExitItemFailed = 1, kExitWrongInput = 2;

struct BuildCommand {
  std::string job;
  BuildOptions options;
  PackagePaths packages;
  bool dryRun = false;
  long long trial = -1;  // >= 0: explain one trial, write nothing
};

int runBuild(const BuildCommand& command, const Database& database);
int runList(const Database& database, bool asJson);
int runInfo(const std::filesystem::path& path, bool asJson);
int runHand(const std::string& path, bool initialise, const PackagePaths& packages, double sphereRadius);
int runRender(const std::string& set, const std::string& output);

/// `--trial`: what happened to one candidate, step by step, on stdout.
int explainTrial(const Job& job, const CatalogItem& item, const Hand& hand, std::size_t trial);

/// What the contacts of such a torsion radius are, in words.
std::string contactModel(double torsionRadius);

/// The table that `build` and `list` print: a row a set.
std::string summaryTable(const std::vector<GraspSetSummary>& summaries);

}  // namespace handhold
