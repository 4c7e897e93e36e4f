#pragma once

#include <cstdio>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>

#include <fmt/core.h>
#include <nlohmann/json.hpp>

namespace handhold::bench {

/// `[--json [FILE]] [--quick]`: tables, or JSON in their place, or JSON in FILE beside them; smaller sizes.
struct Options {
  bool quick = false, json = false;
  std::string jsonFile;
};

/// Nothing, and a line of usage on stderr, when they are others.
inline std::optional<Options> parseOptions(int argc, char** argv, const char* program) {
  Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string_view option = argv[i];
    if (option == "--json") {
      options.json = true;
      if (i + 1 < argc && argv[i + 1][0] != '-') options.jsonFile = argv[++i];
    } else if (option == "--quick") {
      options.quick = true;
    } else {
      fmt::print(stderr, "usage: {} [--json [FILE]] [--quick]\n", program);
      return std::nullopt;
    }
  }
  return options;
}

/// Writes the report as the options say; true when tables are to be printed too.
inline bool writeReport(const nlohmann::ordered_json& report, const Options& options) {
  if (!options.jsonFile.empty()) std::ofstream(options.jsonFile) << report.dump(1) << '\n';
  if (options.json && options.jsonFile.empty()) fmt::print("{}\n", report.dump(1));
  return !options.json || !options.jsonFile.empty();
}

}  // namespace handhold::bench
