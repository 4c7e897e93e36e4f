#include "app/commands.h"
#include "build/verify_set.h"
#include "core/error.h"
#include "core/log.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

namespace fs = std::filesystem;
using State = VerifyReport::State;

constexpr const char* kStates[] = {"good", "differs", "damaged", "not recomputed"};

std::string nameOf(const fs::path& path) {
  const fs::path folder = path.parent_path();
  return fmt::format("{} x {} {}", folder.parent_path().filename().string(), folder.filename().string(),
                     path.stem().string());
}

nlohmann::ordered_json toJson(const fs::path& path, const VerifyReport& report) {
  nlohmann::ordered_json mismatches = nlohmann::ordered_json::array();
  for (const auto& mismatch : report.mismatches) {
    mismatches.push_back({{"where", mismatch.where}, {"stored", mismatch.stored}, {"recomputed", mismatch.recomputed}});
  }
  return {{"path", path.string()},   {"state", kStates[static_cast<int>(report.state)]},
          {"reason", report.reason}, {"grasps", report.grasps},
          {"trials", report.trials}, {"mismatches", mismatches}};
}

void printReport(const fs::path& path, const VerifyReport& report, std::size_t sample) {
  std::string what = report.reason;
  if (report.state == State::good) {
    what = sample == 0 ? "checked" : fmt::format("{} grasps and {} trials recomputed", report.grasps, report.trials);
  } else if (report.state == State::differs) {
    what = fmt::format("{} of what was recomputed is otherwise", report.mismatches.size());
  }
  fmt::print("{:<14} {}: {}\n", kStates[static_cast<int>(report.state)], nameOf(path), what);
  for (const auto& mismatch : report.mismatches) {
    const bool hasValues = !mismatch.stored.empty() || !mismatch.recomputed.empty();
    fmt::print("  {}{}\n", mismatch.where,
               hasValues ? fmt::format(": stored {}, recomputed {}", mismatch.stored, mismatch.recomputed) : "");
  }
}

}  // namespace

int runVerify(const VerifyCommand& command, const Database& database) {
  const std::atomic<bool>& stop = stopOnSignals();
  SetVerifier verifier;
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  std::size_t counts[4] = {}, stopped = 0, all = 0;
  for (const auto& [path, object, hand, version] : database.sets(command.objectGlob, command.handGlob)) {
    if (command.setVersion != 0 && path != database.setPath(object, hand, command.setVersion)) continue;
    ++all;
    const auto report = stop ? std::nullopt : verifier.verify(path, command.sample, stop);
    if (!report) {
      ++stopped;
      continue;
    }
    ++counts[static_cast<int>(report->state)];
    command.json ? list.push_back(toJson(path, *report)) : printReport(path, *report, command.sample);
  }
  if (all == 0) {
    throw InputError(fmt::format("{}: --object {} --hand {}{} picks no set", database.folder().string(),
                                 command.objectGlob, command.handGlob,
                                 command.setVersion > 0 ? fmt::format(" --set-version {}", command.setVersion) : ""));
  }
  if (command.json) {
    fmt::print("{}\n", list.dump(1, ' ', false, nlohmann::json::error_handler_t::replace));
  } else {
    fmt::print("{} sets: {} good, {} that cannot be recomputed, {} that differ, {} damaged{}\n", all, counts[0],
               counts[3], counts[1], counts[2],
               stopped > 0 ? fmt::format(", {} left when it was stopped", stopped) : "");
  }
  return counts[1] + counts[2] + stopped == 0 ? kExitDone : kExitItemFailed;
}

}  // namespace handhold
