#include "app/program.h"

#include "core/error.h"
#include "core/log.h"

#include <csignal>
#include <cstdlib>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

namespace handhold {

std::string defaultDatabase() {
  const char* fromEnvironment = std::getenv("HANDHOLD_DB");
  return fromEnvironment != nullptr && *fromEnvironment != '\0' ? fromEnvironment : "./db";
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

std::string counted(const std::map<std::string, std::size_t>& counts) {
  std::string text;
  for (const auto& [name, count] : counts) text += fmt::format("{}{} {}", text.empty() ? "" : ", ", count, name);
  return text.empty() ? "none" : text;
}

std::string armText(const std::string& name) { return name.ends_with("arm") ? name : name + " arm"; }

int parseArguments(CLI::App& app, int argc, char** argv) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& success) {  // --help, --version
    return app.exit(success);
  } catch (const CLI::ParseError& error) {
    if (app.get_subcommands().empty() && argc > 1 && argv[1][0] != '-') {
      std::vector<std::string> names;
      for (const CLI::App* command : app.get_subcommands({})) names.push_back(command->get_name());
      logError(fmt::format("\"{}\" is no command, want one of: {} (see {} --help)", argv[1], fmt::join(names, ", "),
                           app.get_name()));
    } else {
      logError(fmt::format("{} (see {} --help)", error.what(), app.get_name()));
    }
    return kExitWrongInput;
  }
  return -1;
}

int runGuarded(int (*run)(int, char**), int argc, char** argv) {
  std::signal(SIGXFSZ, SIG_IGN);  // a file that may grow no further is a failed write, told as a full disk is
  try {
    return run(argc, argv);
  } catch (const InputError& error) {
    logError(error.what());
    return kExitWrongInput;
  } catch (const SystemError& error) {
    logError(error.what());
    return kExitItemFailed;
  } catch (const std::exception& error) {
    logError(std::string("unexpected: ") + error.what());
    return kExitItemFailed;
  }
}

}  // namespace handhold
