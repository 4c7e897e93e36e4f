#include "plan/server.h"

#include "core/error.h"
#include "core/yaml.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <istream>
#include <limits>
#include <ostream>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

using Json = nlohmann::ordered_json;

constexpr const char* kRequest = "request";  // stands for the file in messages about a scene
constexpr std::size_t kLongestLine = std::size_t{16} << 20;

/// Refuses what is not in `keys`.
void allowKeys(const Json& request, std::initializer_list<std::string_view> keys) {
  for (const auto& [key, value] : request.items()) {
    if (key == "id" || key == "op" || std::find(keys.begin(), keys.end(), key) != keys.end()) continue;
    throw InputError(fmt::format("{} is no key of {}, want one of: {}", key, request["op"].get<std::string>(),
                                 keys.size() == 0 ? "none" : fmt::format("{}", fmt::join(keys, ", "))));
  }
}

const Json& require(const Json& request, const char* key) {
  const auto at = request.find(key);
  if (at == request.end()) throw InputError(fmt::format("{} is missing", key));
  return *at;
}

std::string text(const Json& value, const char* key) {
  if (!value.is_string()) throw InputError(fmt::format("{} is {}, want a text", key, value.dump()));
  return value.get<std::string>();
}

/// JSON is YAML: what scene files say is read by their reader.
YamlValue asYaml(const Json& value) { return YamlValue::parseText(value.dump(), kRequest); }

double deadline(const Json& request) {
  const auto at = request.find("deadline_ms");
  if (at == request.end()) return std::numeric_limits<double>::infinity();
  if (!at->is_number() || !(at->get<double>() > 0)) {
    throw InputError(fmt::format("deadline_ms is {}, want a number > 0", at->dump()));
  }
  return at->get<double>();
}

std::uint32_t wholeNumber(const Json& request, const char* key, std::uint32_t otherwise) {
  const auto at = request.find(key);
  if (at == request.end()) return otherwise;
  if (!at->is_number_unsigned() || at->get<std::uint64_t>() > std::numeric_limits<std::uint32_t>::max()) {
    throw InputError(fmt::format("{} is {}, want a whole number >= 0", key, at->dump()));
  }
  return at->get<std::uint32_t>();
}

ScoreKind scoreKind(const Json& request) {
  const auto at = request.find("score");
  if (at == request.end()) return ScoreKind::paper;
  const auto score = at->is_string() ? scoreOf(at->get<std::string>()) : std::nullopt;
  if (!score) throw InputError(fmt::format("score is {}, want {}", at->dump(), fmt::join(kScoreNames, " or ")));
  return *score;
}

/// One request at work.
class Operation {
 public:
  Operation(Planner& planner, const Json& request, std::uint64_t stopAt)
      : planner_(planner), request_(request), stopAt_(stopAt) {}

  Json run(const std::string& op) {
    if (op == "scene") return setScene();
    if (op == "add") return add();
    if (op == "move") return move();
    if (op == "remove") return remove();
    if (op == "target") return target();
    if (op == "joints") return joints();
    if (op == "rank") return rank();
    if (op == "plan") return plan();
    throw InputError(
        fmt::format("op is \"{}\", want scene, add, move, remove, target, joints, rank, plan or quit", op));
  }

 private:
  ObjectMeshes meshes() {
    return [this](const std::string& object) { return planner_.objectMesh(object); };
  }

  Json describe() const {
    return {{"target", planner_.scene().target},
            {"obstacles", planner_.scene().obstacles.size()},
            {"notes", planner_.scene().notes}};
  }

  Json take(Scene scene) {
    planner_.setScene(std::move(scene));
    return describe();
  }

  Json setScene() {
    allowKeys(request_, {"scene", "file"});
    if (request_.contains("scene") == request_.contains("file")) throw InputError("want either scene or file");
    if (request_.contains("file")) {
      planner_.loadScene(text(request_["file"], "file"));
      return describe();
    }
    return take(readScene(asYaml(request_["scene"]), "", meshes()));
  }

  std::size_t obstacleIndex(const Scene& scene) const {
    const std::string name = text(require(request_, "name"), "name");
    for (std::size_t i = 0; i < scene.obstacles.size(); ++i) {
      if (scene.obstacles[i].name == name) return i;
    }
    throw InputError(fmt::format("name is \"{}\", want an obstacle of the scene", name));
  }

  Json add() {
    allowKeys(request_, {"obstacle"});
    Scene scene = planner_.scene();
    Obstacle obstacle = readObstacle(asYaml(require(request_, "obstacle")), "", meshes(), &scene.notes);
    for (const Obstacle& other : scene.obstacles) {
      if (other.name == obstacle.name) {
        throw InputError(fmt::format("obstacle.name is \"{}\", which the scene has, want another", obstacle.name));
      }
    }
    scene.obstacles.push_back(std::move(obstacle));
    dropTargetPoints(planner_.objectMesh(scene.target), scene.X_WO, scene.obstacles);
    return take(std::move(scene));
  }

  Json move() {
    allowKeys(request_, {"name", "pose"});
    Scene scene = planner_.scene();
    scene.obstacles[obstacleIndex(scene)].X_WS = asYaml(require(request_, "pose")).pose();
    return take(std::move(scene));
  }

  Json remove() {
    allowKeys(request_, {"name"});
    Scene scene = planner_.scene();
    scene.obstacles.erase(scene.obstacles.begin() + static_cast<std::ptrdiff_t>(obstacleIndex(scene)));
    return take(std::move(scene));
  }

  Json target() {
    allowKeys(request_, {"object", "pose"});
    if (!request_.contains("object") && !request_.contains("pose")) throw InputError("want object, pose or both");
    Scene scene = planner_.scene();
    if (request_.contains("object")) scene.target = text(request_["object"], "object");
    if (request_.contains("pose")) scene.X_WO = asYaml(request_["pose"]).pose();
    planner_.objectMesh(scene.target);
    return take(std::move(scene));
  }

  Json joints() {
    allowKeys(request_, {"joints"});
    Scene scene = planner_.scene();
    const Json& given = require(request_, "joints");
    if (given == "home") {
      scene.joints.emplace();
    } else {
      if (!given.is_object()) throw InputError("joints is no map, want joint positions by name, or the word home");
      if (!scene.joints) scene.joints.emplace();
      const YamlValue values = asYaml(given);
      for (const auto& [name, value] : values.entries()) (*scene.joints)[name] = value.number();
    }
    return take(std::move(scene));
  }

  Json rank() {
    allowKeys(request_, {"score", "top"});
    const Ranking ranking = planner_.rank(scoreKind(request_));
    return {{"grasps", Json::parse(rankingJson(planner_, ranking, wholeNumber(request_, "top", 0)))},
            {"timing_ms", ranking.timingMs}};
  }

  Json plan() {
    allowKeys(request_, {"score", "deadline_ms", "prefer", "trace"});
    PlanRequest request;
    request.score = scoreKind(request_);
    if (request_.contains("prefer")) request.prefer = wholeNumber(request_, "prefer", 0);
    if (request_.contains("trace")) {
      if (!request_["trace"].is_boolean()) throw InputError("trace is neither true nor false");
      request.trace = request_["trace"].get<bool>();
    }
    const double budget = deadline(request_);
    const auto start = std::chrono::steady_clock::now();
    if (stopAt_ > 0) {
      request.stop = [this](std::uint64_t checks) { return checks >= stopAt_; };
    } else if (std::isfinite(budget)) {
      request.stop = [=](std::uint64_t) {
        return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count() > budget;
      };
    }
    return Json::parse(planJson(planner_.plan(request), false));
  }

  Planner& planner_;
  const Json& request_;
  std::uint64_t stopAt_;
};

Json failure(const Json& id, const std::string& message) { return {{"id", id}, {"ok", false}, {"error", message}}; }

/// Without what may differ between two runs.
Json comparable(Json answer) {
  if (answer.contains("result") && answer["result"].is_object()) answer["result"].erase("timing_ms");
  return answer;
}

}  // namespace

std::string PlanServer::answer(const std::string& line, std::uint64_t stopAt) {
  Json id = nullptr, reply;
  try {
    if (line.size() > kLongestLine)
      throw InputError(fmt::format("the line has {} bytes, want 16 MiB at most", line.size()));
    const Json request = Json::parse(line);
    if (!request.is_object()) throw InputError("want one JSON object a line");
    if (request.contains("id")) id = request["id"];
    const std::string op = text(require(request, "op"), "op");
    if (op == "quit") {
      allowKeys(request, {});
      hasQuit_ = true;
      reply = {{"id", id}, {"ok", true}, {"result", nullptr}};
    } else {
      reply = {{"id", id}, {"ok", true}, {"result", Operation(planner_, request, stopAt).run(op)}};
    }
  } catch (const Json::parse_error& error) {
    reply = failure(id, fmt::format("is no JSON: byte {} is not what was expected", error.byte));
  } catch (const std::exception& error) {
    reply = failure(id, error.what());
  }
  return reply.dump(-1, ' ', false, Json::error_handler_t::replace);
}

void serve(PlanServer& server, std::istream& in, std::ostream& out, std::ostream* record) {
  std::string line;
  while (!server.hasQuit() && std::getline(in, line)) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    const std::string answer = server.answer(line);
    out << answer << std::endl;
    if (record == nullptr) continue;
    // The request as text: it may be no JSON.
    const Json entry = {{"request", line}, {"answer", Json::parse(answer)}};
    *record << entry.dump(-1, ' ', false, Json::error_handler_t::replace) << std::endl;
  }
}

bool replay(PlanServer& server, std::istream& record, const std::string& name, std::ostream& out) {
  std::size_t number = 0, differing = 0;
  for (std::string line; std::getline(record, line);) {
    ++number;
    Json entry = Json::parse(line, nullptr, false);
    if (!entry.is_object() || !entry.contains("request") || !entry["request"].is_string() ||
        !entry.contains("answer")) {
      throw InputError(fmt::format("{}:{}: is no line of a record, want request and answer", name, number));
    }
    const Json& recorded = entry["answer"];
    std::uint64_t stopAt = 0;
    if (recorded.contains("result") && recorded["result"].is_object() && recorded["result"].contains("stopped")) {
      stopAt = std::max<std::uint64_t>(1, recorded["result"].value("checks", std::uint64_t{1}));
    }
    const Json answer = Json::parse(server.answer(entry["request"].get<std::string>(), stopAt));
    if (comparable(answer) == comparable(recorded)) continue;
    ++differing;
    out << fmt::format("{}:{}: the answer differs\n", name, number) << answer.dump() << '\n';
  }
  out << fmt::format("replayed {} requests, {} answers differ", number, differing) << std::endl;
  return differing == 0;
}

}  // namespace handhold
