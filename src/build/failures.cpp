#include "build/failures.h"

#include "core/error.h"
#include "core/file.h"
#include "core/log.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

namespace fs = std::filesystem;

fs::path recordPath(const Database& database, const std::string& object, const std::string& hand) {
  return database.setPath(object, hand, 0).parent_path() / "failed.json";
}

}  // namespace

std::optional<FailureRecord> readFailure(const Database& database, const std::string& object, const std::string& hand) {
  const fs::path path = recordPath(database, object, hand);
  std::error_code missing;
  if (!fs::exists(path, missing)) return std::nullopt;
  try {
    const nlohmann::json json = nlohmann::json::parse(readFile(path));
    FailureRecord record;
    json.at("object").get_to(record.object);
    json.at("hand").get_to(record.hand);
    json.at("error").get_to(record.error);
    json.at("command").get_to(record.command);
    json.at("input_hash").get_to(record.inputHash);
    json.at("known_bad").get_to(record.knownBad);
    json.at("timeout").get_to(record.timeout);
    return record;
  } catch (const nlohmann::json::exception& error) {
    logWarning(fmt::format("{}: is no record of a failure, it counts as none: {}", path.string(), error.what()));
  } catch (const InputError& error) {
    logWarning(error.what());
  }
  return std::nullopt;
}

void writeFailure(const Database& database, const FailureRecord& record) {
  const nlohmann::ordered_json json = {{"object", record.object},        {"hand", record.hand},
                                       {"error", record.error},          {"command", record.command},
                                       {"input_hash", record.inputHash}, {"known_bad", record.knownBad},
                                       {"timeout", record.timeout}};
  const fs::path path = recordPath(database, record.object, record.hand);
  try {
    std::error_code error;
    fs::create_directories(path.parent_path(), error);  // replaceContent tells when it could not
    replaceContent(path, json.dump(1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
  } catch (const SystemError& error) {
    logWarning(error.what());
  }
}

void removeFailure(const Database& database, const std::string& object, const std::string& hand) {
  std::error_code error;
  const fs::path path = recordPath(database, object, hand);
  fs::remove(path, error);
  if (error) logWarning(fmt::format("{}: cannot be removed: {}", path.string(), error.message()));
}

bool isKnownBad(const FailureRecord& record, const std::string& inputHash, double timeout) {
  const bool moreTime = record.timeout > 0 && (timeout == 0 || timeout > record.timeout);
  return record.knownBad && record.inputHash == inputHash && !moreTime;
}

}  // namespace handhold
