#include "app/commands.h"
#include "core/error.h"
#include "core/file.h"
#include "core/hash.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <set>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/wait.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kDefaultShards = 64;

/// What is passed on goes to two jobs, and must leave them an array and its summary.
void refuseOwnOptions(const std::vector<std::string>& options) {
  static const std::set<std::string> kOwn = {"--array", "-a", "--job-name", "-J", "--output", "-o",
                                             "--error", "-e", "--wait",     "-W", "--wrap"};
  if (!options.empty() && !options[0].starts_with('-')) {
    throw InputError(
        fmt::format("\"{}\" is one argument too many, want JOB.yaml and options of sbatch after --", options[0]));
  }
  for (const std::string& option : options) {
    const std::string name = option.starts_with("--") ? option.substr(0, option.find('=')) : option.substr(0, 2);
    if (!kOwn.contains(name)) continue;
    throw InputError(
        fmt::format("{}: sbatch's {} is not passed on: the array's length is --shards, its name and logs "
                    "are submit's own",
                    option, name));
  }
}

/// Where everything about one submission is, and how its programs are called.
struct Submission {
  std::string name;
  fs::path folder;
  std::size_t shards = 0;
  std::string jobArguments;  // of handhold, quoted: job, database, globs, packages
};

/// The same job, database and selection have the same name, on every machine and day.
Submission describe(const SubmitCommand& command, const Job& job, const Database& database) {
  const fs::path jobPath = fs::absolute(job.path).lexically_normal();
  const fs::path folder = fs::absolute(database.folder()).lexically_normal();
  ContentHash hash;
  for (const std::string& text :
       {jobPath.string(), folder.string(), command.options.objectGlob, command.options.handGlob}) {
    hash.addText(text);
  }
  Submission submission;
  submission.name = jobPath.stem().string();
  std::replace_if(
      submission.name.begin(), submission.name.end(),
      [](unsigned char c) { return std::isalnum(c) == 0 && c != '_' && c != '-'; }, '_');
  submission.name += "-" + hash.hex().substr(0, 8);
  submission.folder = folder / "submit" / submission.name;
  submission.jobArguments =
      fmt::format("{} --db {} --object {} --hand {}", shellQuoted(jobPath.string()), shellQuoted(folder.string()),
                  shellQuoted(command.options.objectGlob), shellQuoted(command.options.handGlob));
  for (const auto& [package, path] : command.options.packages) {
    submission.jobArguments += " --package " + shellQuoted(package + "=" + fs::absolute(path).string());
  }
  return submission;
}

std::string program() { return shellQuoted((programFolder() / "handhold").string()); }

std::string arrayScript(const Submission& submission) {
  return fmt::format(R"(#!/bin/bash
# Written by handhold submit: one shard of a build. Tasks share nothing but the database folder, where files appear whole
# and are never changed: there is nothing to lock, and locking fails on some network file systems.
export HDF5_USE_FILE_LOCKING=FALSE
exec {} build {} \
  --shard "$SLURM_ARRAY_TASK_ID/{}" --threads "${{SLURM_CPUS_PER_TASK:-$SLURM_CPUS_ON_NODE}}" --progress plain
)",
                     program(), submission.jobArguments, submission.shards);
}

/// What it says comes from the database: a task that was killed leaves its sets missing.
std::string summaryScript(const Submission& submission) {
  return fmt::format(R"(#!/bin/bash
# Written by handhold submit: what is missing after the array whose job id is the argument. Ends with 1 if anything is.
export HDF5_USE_FILE_LOCKING=FALSE
cd {} || exit 1
echo "array $1, logs of its tasks: $PWD/log/$1_SHARD.txt"
exec {} submit --slurm --status {} --shards {}
)",
                     shellQuoted(submission.folder.string()), program(), submission.jobArguments, submission.shards);
}

/// "0-3,6": as sbatch's --array wants them.
std::string rangesOf(const std::set<std::size_t>& numbers) {
  std::vector<std::string> ranges;
  for (auto first = numbers.begin(); first != numbers.end();) {
    auto last = first;
    while (std::next(last) != numbers.end() && *std::next(last) == *last + 1) ++last;
    ranges.push_back(first == last ? std::to_string(*first) : fmt::format("{}-{}", *first, *last));
    first = std::next(last);
  }
  return fmt::format("{}", fmt::join(ranges, ","));
}

/// An sbatch command whose later options win: the caller's over our defaults, what the array needs over the caller's.
std::string sbatchCommand(const SubmitCommand& command, const std::string& defaults, const std::string& needs) {
  std::string line = "sbatch --parsable " + defaults;
  for (const std::string& option : command.sbatchOptions) line += " " + shellQuoted(option);
  return line + " " + needs;
}

/// sbatch replaces % patterns in file names.
std::string logPath(const fs::path& folder, const std::string& pattern) {
  std::string path = folder.string();
  for (std::size_t at = path.find('%'); at != std::string::npos; at = path.find('%', at + 2)) path.insert(at, "%");
  return shellQuoted(path + "/" + pattern);
}

/// Tasks of one name wait for each other, their own array aside: the same command given twice builds nothing twice.
std::string arrayCommand(const SubmitCommand& command, const Submission& submission,
                         const std::set<std::size_t>& shards) {
  return sbatchCommand(command, "--open-mode=append --requeue --dependency=singleton",
                       fmt::format("--job-name={} --output={} --array={} {}", submission.name,
                                   logPath(submission.folder / "log", "%A_%a.txt"), rangesOf(shards),
                                   shellQuoted((submission.folder / "array.sh").string())));
}

std::string summaryCommand(const SubmitCommand& command, const Submission& submission, const std::string& array) {
  return sbatchCommand(command, "--open-mode=truncate",
                       fmt::format("--job-name={}-summary --dependency=afterany:{} --output={} {} {}", submission.name,
                                   array, logPath(submission.folder, "summary.txt"),
                                   shellQuoted((submission.folder / "summary.sh").string()), array));
}

void writeScript(const fs::path& path, const std::string& text) {
  std::ofstream stream(path);
  stream << text;
  stream.close();
  if (!stream) throw SystemError(fmt::format("{}: cannot be written", path.string()));
}

/// Runs a command of sbatch, whose own messages go to stderr, and returns the job id that it prints (`ID[;CLUSTER]`).
std::string runSbatch(const std::string& line) {
  std::FILE* pipe = ::popen(line.c_str(), "r");
  if (pipe == nullptr) throw SystemError("sbatch cannot be started");
  std::string output;
  std::array<char, 256> block{};
  while (std::fgets(block.data(), block.size(), pipe) != nullptr) output += block.data();
  const int status = ::pclose(pipe);
  const std::string id = output.substr(0, output.find_first_not_of("0123456789"));
  if (status != 0) {
    throw SystemError(fmt::format("sbatch refused with exit code {}: {}", WEXITSTATUS(status), line));
  }
  if (id.empty()) {
    throw SystemError(
        fmt::format("sbatch printed \"{}\", want a job id: {}", output.substr(0, output.find('\n')), line));
  }
  return id;
}

/// What is to say of a set that is not done, empty of one that is.
std::string remark(PlannedSet::State state) {
  switch (state) {
    case PlannedSet::State::missing:
      return "missing";
    case PlannedSet::State::changed:
      return "changed";
    case PlannedSet::State::unreadable:
      return "unreadable";
    case PlannedSet::State::failed:
      return "failed";
    case PlannedSet::State::done:
      return "";
  }
  return "";
}

}  // namespace

int runSubmit(const SubmitCommand& command, const Database& database) {
  refuseOwnOptions(command.sbatchOptions);
  const bool onlyShow = command.print || command.status;
  if (!onlyShow && std::system("command -v sbatch >/dev/null 2>&1") != 0) {
    throw InputError("--slurm: sbatch is not in PATH, want Slurm's programs (Debian: slurm-client), or --print");
  }
  const Job job = loadJob(command.job);
  const std::vector<Hand> hands = loadHands(job, command.options.packages);
  BuildOptions all = command.options;
  all.shards = 1;
  const std::size_t count = selectedSets(job, hands, all).size();
  const std::vector<PlannedSet> plan = planJob(job, hands, database, all);  // in the order of the sets

  Submission submission = describe(command, job, database);
  submission.shards = command.options.shards > 0 ? command.options.shards : std::min(count, kDefaultShards);
  const std::vector<ShardedSet> sets = dealSets(job, hands, all.objectGlob, all.handGlob, submission.shards);
  std::set<std::size_t> shards;  // that have something to do
  std::size_t open = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (remark(plan[i].state).empty()) continue;
    ++open;
    if (plan[i].state != PlannedSet::State::failed) shards.insert(sets[i].shard);  // known to fail: left alone
    if (command.status) {
      fmt::print("{:<10} {} x {}  shard {}{}\n", remark(plan[i].state), plan[i].object, plan[i].hand, sets[i].shard,
                 plan[i].error.empty() ? "" : "  " + plan[i].error);
    }
  }
  const auto failed = std::count_if(plan.begin(), plan.end(),
                                    [](const PlannedSet& set) { return set.state == PlannedSet::State::failed; });
  const std::size_t toBuild = open - static_cast<std::size_t>(failed);
  fmt::print("{} sets: {} done, {} to build in {} of {} shards{}\n", count, count - open, toBuild, shards.size(),
             submission.shards, failed > 0 ? fmt::format(", {} failed and left alone", failed) : "");
  if (command.status || shards.empty()) return open == 0 ? kExitDone : kExitItemFailed;

  if (command.print) {
    fmt::print("\n# {}\n{}", (submission.folder / "array.sh").string(), arrayScript(submission));
    fmt::print("\n# {}\n{}", (submission.folder / "summary.sh").string(), summaryScript(submission));
    fmt::print("\n# submitted with\n{}\n{}\n", arrayCommand(command, submission, shards),
               summaryCommand(command, submission, "ARRAY_ID"));
    return kExitDone;
  }
  createFolders(submission.folder / "log");
  writeScript(submission.folder / "array.sh", arrayScript(submission));
  writeScript(submission.folder / "summary.sh", summaryScript(submission));
  const std::string array = runSbatch(arrayCommand(command, submission, shards));
  fmt::print("array {}: logs in {}\n", array, (submission.folder / "log").string());
  std::fflush(stdout);
  const std::string summary = runSbatch(summaryCommand(command, submission, array));
  fmt::print("summary {}: after the array in {}\n", summary, (submission.folder / "summary.txt").string());
  return kExitDone;
}

}  // namespace handhold
