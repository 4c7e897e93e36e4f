#include "build/job.h"

#include "core/error.h"
#include "core/file.h"
#include "core/yaml.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <numbers>
#include <sstream>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

/// With 50 directions a load margin takes some tens of milliseconds.
constexpr std::size_t kMostTaskWrenches = 200;

std::string besides(const std::string& file, const std::string& path) {
  return (fs::path(file).parent_path() / path).lexically_normal().string();
}

/// A path of the job, with ${NAME} replaced by the environment.
std::string pathAt(const std::string& file, const YamlValue& value) {
  return besides(file, expandEnvironment(value.text(), value.where()));
}

double readFriction(const YamlValue& value) {
  constexpr double kMost = 10;
  const double friction = value.number();
  if (friction <= 0 || friction > kMost) value.refuse(fmt::format("a number > 0 and at most {}", kMost));
  return friction;
}

/// What may be written for a catalog entry beside its name and mesh.
void readProperties(const YamlValue& entry, const Job& job, CatalogItem& item) {
  item.unit = readMeshUnit(entry);
  item.friction = job.friction;
  if (const YamlValue* friction = entry.find("friction")) item.friction = readFriction(*friction);
  if (const YamlValue* mass = entry.find("mass")) item.mass = mass->positiveNumber();
}

std::string nameFor(const std::string& pattern, const fs::path& mesh, const YamlValue& where) {
  std::string name = pattern;
  const auto replace = [&](const std::string& token, const std::string& value) {
    for (std::size_t at = name.find(token); at != std::string::npos; at = name.find(token, at + value.size())) {
      name.replace(at, token.size(), value);
    }
  };
  replace("{stem}", mesh.stem().string());
  replace("{parent}", mesh.parent_path().filename().string());
  requireName(name, where.where(), fmt::format("the name of {}", mesh.string()));
  return name;
}

void readFolder(const YamlValue& entry, const Job& job, std::vector<CatalogItem>& catalog) {
  entry.allowKeys({"folder", "glob", "name", "unit", "scale", "friction", "mass"});
  const fs::path folder = pathAt(job.path, entry.require("folder"));
  if (!fs::is_directory(folder))
    entry.require("folder").refuse("an existing folder (looked for " + folder.string() + ")");
  const std::string glob = entry.find("glob") == nullptr ? "*" : entry.require("glob").text();
  const std::string pattern = entry.find("name") == nullptr ? "{stem}" : entry.require("name").text();
  std::vector<fs::path> meshes;
  for (const auto& file : fs::recursive_directory_iterator(folder)) {
    if (file.is_regular_file() && matchesGlob(file.path().lexically_relative(folder).string(), glob)) {
      meshes.push_back(file.path());
    }
  }
  if (meshes.empty()) entry.fail(fmt::format("matches no file: glob \"{}\" in {}", glob, folder.string()));
  std::sort(meshes.begin(), meshes.end());
  for (const fs::path& mesh : meshes) {
    CatalogItem& item = catalog.emplace_back();
    item.name = nameFor(pattern, mesh, entry);
    item.mesh = mesh.string();
    item.where = entry.where();
    readProperties(entry, job, item);
  }
}

/// Commas separate; a field in double quotes may hold commas.
std::vector<std::string> splitCsvLine(const std::string& line) {
  std::vector<std::string> fields(1);
  bool quoted = false;
  for (const char c : line) {
    if (c == '"') {
      quoted = !quoted;
    } else if (c == ',' && !quoted) {
      fields.emplace_back();
    } else if (c != '\r') {
      fields.back() += c;
    }
  }
  return fields;
}

/// A row becomes a small YAML map, so that values are checked by the same code; its line is the CSV's.
void readCsv(const YamlValue& entry, const Job& job, std::vector<CatalogItem>& catalog) {
  entry.allowKeys({"csv"});
  const std::string path = pathAt(job.path, entry.require("csv"));
  std::istringstream lines(readFile(path));
  std::string line;
  std::vector<std::string> header;
  const std::size_t before = catalog.size();
  for (int number = 1; std::getline(lines, line); ++number) {
    const std::vector<std::string> fields = splitCsvLine(line);
    if (line.empty() || (fields.size() == 1 && fields[0].empty())) continue;
    if (header.empty()) {
      header = fields;
      continue;
    }
    if (fields.size() != header.size()) {
      throw InputError(fmt::format("{}:{}: has {} fields, want {} as in the first line", path, number, fields.size(),
                                   header.size()));
    }
    std::string text;
    for (std::size_t i = 0; i < header.size(); ++i) {
      std::string quoted;
      for (const char c : fields[i]) quoted += c == '\'' ? "''" : std::string(1, c);
      if (!fields[i].empty()) text += fmt::format("{}'{}': '{}'", text.empty() ? "{" : ", ", header[i], quoted);
    }
    const YamlValue row = YamlValue::parseText(text + "}", path, number);
    row.allowKeys({"name", "mesh", "unit", "scale", "friction", "mass"});
    CatalogItem& item = catalog.emplace_back();
    item.name = row.require("name").text();
    requireName(item.name, row.where(), "name");
    item.mesh = besides(path, row.require("mesh").text());
    item.where = row.where();
    readProperties(row, job, item);
  }
  if (catalog.size() == before) entry.require("csv").fail("leads to a file without any row below its header: " + path);
}

void readCatalogEntry(const YamlValue& entry, const Job& job, std::vector<CatalogItem>& catalog) {
  if (entry.find("folder") != nullptr) return readFolder(entry, job, catalog);
  if (entry.find("csv") != nullptr) return readCsv(entry, job, catalog);
  entry.allowKeys({"name", "mesh", "unit", "scale", "friction", "mass"});
  CatalogItem& item = catalog.emplace_back();
  item.name = entry.require("name").text();
  requireName(item.name, entry.where(), "name");
  item.mesh = pathAt(job.path, entry.require("mesh"));
  item.where = entry.where();
  readProperties(entry, job, item);
}

void refuseRepeatedNames(const std::vector<CatalogItem>& sorted) {
  for (std::size_t i = 1; i < sorted.size(); ++i) {
    if (sorted[i].name != sorted[i - 1].name) continue;
    throw InputError(fmt::format("{}: the object name \"{}\" is already taken by {} ({}), want every name once",
                                 sorted[i].where, sorted[i].name, sorted[i - 1].mesh, sorted[i - 1].where));
  }
}

void readSampling(const YamlValue& sampling, Job& job) {
  sampling.allowKeys({"samples", "pitch", "rolls", "policy", "preshapes"});
  const YamlValue* samples = sampling.find("samples");
  const YamlValue* pitch = sampling.find("pitch");
  if ((samples == nullptr) == (pitch == nullptr))
    sampling.fail("needs samples (a number) or pitch (metres), one of them");
  if (samples != nullptr) job.samples = samples->integer(1, 10'000'000);
  if (pitch != nullptr) job.pitch = pitch->positiveNumber();
  if (const YamlValue* rolls = sampling.find("rolls")) job.rolls = rolls->integer(1, 10'000);
  if (const YamlValue* preshapes = sampling.find("preshapes")) {
    job.preshapes = preshapes->texts();
    if (job.preshapes.empty()) preshapes->refuse("at least one preshape, or no key preshapes for all");
  }
  if (const YamlValue* policy = sampling.find("policy")) {
    if (policy->text() == "center_of_mass") {
      job.policy = PolicyKind::centerOfMass;
      if (pitch != nullptr) pitch->fail("is given with policy center_of_mass, want samples: the number of directions");
    } else if (policy->text() != "surface_normal") {
      policy->refuse("surface_normal or center_of_mass");
    }
  }
}

void readSimulation(const YamlValue& simulation, Job& job) {
  if (simulation.text() == "reference") {
    job.simulation = Simulation::reference;
  } else if (simulation.text() != "fast") {
    simulation.refuse("fast or reference");
  }
}

/// [fx, fy, fz, tx, ty, tz], not all zero.
Eigen::Matrix<double, 6, 1> readWrench(const YamlValue& wrench) {
  constexpr const char* kWanted = "six numbers that are not all 0: force [N] and torque [N m] for each newton of load";
  Eigen::Matrix<double, 6, 1> result;
  if (wrench.items().size() != 6) wrench.refuse(kWanted);
  for (int i = 0; i < 6; ++i) result[i] = wrench.items()[static_cast<std::size_t>(i)].number();
  if (result.isZero(0)) wrench.refuse(kWanted);
  return result;
}

void readLoadMargin(const YamlValue& margin, LoadMarginSettings& settings) {
  margin.allowKeys({"grasps", "directions", "wrenches"});
  if (const YamlValue* grasps = margin.find("grasps")) settings.grasps = grasps->integer(0, 1'000'000'000);
  if (const YamlValue* directions = margin.find("directions")) settings.directions = directions->integer(6, 50);
  if (const YamlValue* wrenches = margin.find("wrenches")) {
    for (const YamlValue& wrench : wrenches->items()) settings.taskWrenches.push_back(readWrench(wrench));
    if (settings.taskWrenches.size() > kMostTaskWrenches)
      wrenches->fail(fmt::format("has {} wrenches, want at most {}", settings.taskWrenches.size(), kMostTaskWrenches));
  }
}

double readDeviation(const YamlValue& value, double most, const char* unit) {
  const double deviation = value.number();
  if (!(deviation >= 0 && deviation <= most)) value.refuse(fmt::format("a number of {} from 0 to {}", unit, most));
  return deviation;
}

void readRobustness(const YamlValue& robustness, RobustnessSettings& settings) {
  robustness.allowKeys({"grasps", "trials", "position", "rotation_deg"});
  if (const YamlValue* grasps = robustness.find("grasps")) settings.grasps = grasps->integer(1, 1'000'000'000);
  settings.noise.trials = 100;
  if (const YamlValue* trials = robustness.find("trials")) settings.noise.trials = trials->integer(1, 1'000'000);
  settings.noise.position = readDeviation(robustness.require("position"), 0.1, "metres");
  settings.noise.rotation = readDeviation(robustness.require("rotation_deg"), 90, "degrees") * std::numbers::pi / 180;
}

void readQuality(const YamlValue& quality, Job& job) {
  quality.allowKeys({"friction", "cone_edges", "contact_distance", "load_margin", "robustness"});
  if (const YamlValue* margin = quality.find("load_margin")) readLoadMargin(*margin, job.loadMargin);
  if (const YamlValue* robustness = quality.find("robustness")) readRobustness(*robustness, job.robustness);
  if (const YamlValue* friction = quality.find("friction")) job.friction = readFriction(*friction);
  if (const YamlValue* edges = quality.find("cone_edges")) job.coneEdges = edges->integer(3, 64);
  if (const YamlValue* distance = quality.find("contact_distance")) {
    job.contactDistance = distance->number();
    if (job.contactDistance < 2e-5 || job.contactDistance > 2e-3)
      distance->refuse("a number of metres from 0.00002 to 0.002");
  }
}

void readKeep(const YamlValue& keep, Job& job) {
  keep.allowKeys({"top", "diverse"});
  job.keepTop = keep.require("top").integer(1, 1'000'000'000);
  if (const YamlValue* diverse = keep.find("diverse")) job.keepDiverse = diverse->boolean();
}

void readSettings(const YamlValue& top, Job& job) {
  top.allowKeys({"catalog", "hands", "sampling", "simulation", "quality", "keep", "distance_map", "seed", "timeout"});
  if (const YamlValue* quality = top.find("quality")) readQuality(*quality, job);
  readSampling(top.require("sampling"), job);
  if (const YamlValue* simulation = top.find("simulation")) readSimulation(*simulation, job);
  if (const YamlValue* keep = top.find("keep")) readKeep(*keep, job);
  if (const YamlValue* map = top.find("distance_map")) {
    map->allowKeys({"neighbors"});
    job.mapNeighbors = map->require("neighbors").integer(1, 64);
  }
  if (const YamlValue* seed = top.find("seed")) job.seed = seed->integer(0, 2'000'000'000);
  if (const YamlValue* timeout = top.find("timeout")) job.timeout = timeout->positiveNumber();
}

}  // namespace

Job parseJobSettings(const std::string& text, const std::string& name) {
  Job job;
  job.path = name;
  job.text = text;
  readSettings(YamlValue::parseText(text, name), job);
  return job;
}

Job loadJob(const std::string& path) { return parseJob(readFile(path), path); }

Job parseJob(const std::string& text, const std::string& path) {
  Job job;
  job.path = path;
  job.text = text;
  const YamlValue top = YamlValue::parseText(job.text, path);
  readSettings(top, job);
  for (const YamlValue& entry : top.require("catalog").items()) readCatalogEntry(entry, job, job.catalog);
  if (job.catalog.empty()) top.require("catalog").refuse("at least one object");
  std::stable_sort(job.catalog.begin(), job.catalog.end(),
                   [](const auto& a, const auto& b) { return a.name < b.name; });
  refuseRepeatedNames(job.catalog);
  for (const YamlValue& hand : top.require("hands").items()) job.handPaths.push_back(pathAt(path, hand));
  if (job.handPaths.empty()) top.require("hands").refuse("at least one hand");
  return job;
}

ReferenceSettings policySettings(const Job& job) {
  ReferenceSettings settings;
  settings.contactDistance = job.contactDistance;
  return settings;
}

TaskWrenches taskWrenches(const Job& job) {
  const auto& own = job.loadMargin.taskWrenches;
  const TaskWrenches weight = weightDirections(job.loadMargin.directions);
  TaskWrenches tasks(6, weight.cols() + static_cast<Eigen::Index>(own.size()));
  tasks.leftCols(weight.cols()) = weight;
  for (std::size_t i = 0; i < own.size(); ++i) tasks.col(weight.cols() + static_cast<Eigen::Index>(i)) = own[i];
  return tasks;
}

std::vector<Hand> loadHands(const Job& job, const PackagePaths& packages) {
  std::vector<Hand> hands;
  for (const std::string& path : job.handPaths) {
    Hand& hand = hands.emplace_back(loadHand(path, packages));
    if (job.preshapes.empty()) continue;
    choosePreshapes(hand, job.preshapes);
    if (hand.preshapes.empty()) {
      throw InputError(fmt::format("{}: sampling.preshapes names none of {}'s preshapes: {}", job.path, hand.name,
                                   fmt::join(job.preshapes, ", ")));
    }
  }
  std::sort(hands.begin(), hands.end(), [](const auto& a, const auto& b) { return a.name < b.name; });
  for (std::size_t i = 1; i < hands.size(); ++i) {
    if (hands[i].name == hands[i - 1].name) {
      throw InputError(fmt::format("{}: two hands are called {} (after their folders), want every name once", job.path,
                                   hands[i].name));
    }
  }
  // A chosen preshape that no hand has is a typing error.
  for (const std::string& name : job.preshapes) {
    const bool known = std::any_of(hands.begin(), hands.end(), [&](const Hand& hand) {
      return std::any_of(hand.preshapes.begin(), hand.preshapes.end(), [&](const auto& p) { return p.name == name; });
    });
    if (!known)
      throw InputError(
          fmt::format("{}: sampling.preshapes has \"{}\", which no hand of the job knows", job.path, name));
  }
  return hands;
}

}  // namespace handhold
