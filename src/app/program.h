#pragma once

#include "hand/mechanism.h"

#include <map>
#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace handhold {

/// Exit codes of every program (contract).
inline constexpr int kExitDone = 0, kExitItemFailed = 1, kExitWrongInput = 2;

/// $HANDHOLD_DB, then ./db.
std::string defaultDatabase();

/// Entries NAME=DIR. @throws InputError
PackagePaths parsePackages(const std::vector<std::string>& given);

/// `3 unreachable, 1 no_motion`; `none` of nothing.
std::string counted(const std::map<std::string, std::size_t>& counts);

/// `left arm`; the name alone where it says so itself: `arm`, `right_arm`.
std::string armText(const std::string& name);

/// Parses the arguments; the exit code when the program has nothing more to do (--help, --version, wrong usage), -1
/// else.
int parseArguments(CLI::App& app, int argc, char** argv);

/// What main does: runs, and turns what is thrown into one line and an exit code.
int runGuarded(int (*run)(int, char**), int argc, char** argv);

}  // namespace handhold
