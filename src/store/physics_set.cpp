#include "store/physics_set.h"

#include "core/error.h"
#include "core/file.h"
#include "core/hash.h"
#include "store/hdf5_file.h"

#include <cmath>
#include <limits>
#include <map>
#include <string_view>

#include <fmt/format.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kResultsMagic = "HANDHOLD PHYSICS RESULTS 1\n";
constexpr std::size_t kResultsBlockBytes = 512;

template <class Visit>
void forEachAttribute(const Visit& visit) {
  visit("object", &PhysicsSet::object);
  visit("hand", &PhysicsSet::hand);
  visit("input_hash", &PhysicsSet::inputHash);
  visit("set_version", &PhysicsSet::setVersion);
  visit("settings", &PhysicsSet::settings);
  visit("generator", &PhysicsSet::generator);
  visit("friction", &PhysicsSet::friction);
  visit("mass", &PhysicsSet::mass);
  visit("shape_error_p95", &PhysicsSet::shapeP95);
  visit("shape_error_largest", &PhysicsSet::shapeMost);
}

Shape shapeOf(const PhysicsSet& physics, std::string_view symbols) {
  Shape shape;
  for (const char symbol : symbols) {
    shape.push_back(symbol == 'm'   ? physics.graspCount()
                    : symbol == 'T' ? physics.testNames.size()
                                    : physics.directionNames.size());
  }
  return shape;
}

void check(const PhysicsSet& physics, const std::string& where) {
  const auto refuse = [&](const std::string& message) { throw InputError(fmt::format("{}: {}", where, message)); };
  forEachPhysicsArray([&](const char* path, auto member, std::string_view symbols) {
    const Shape shape = shapeOf(physics, symbols);
    std::size_t count = 1;
    for (const std::size_t length : shape) count *= length;
    if ((physics.*member).size() != count) {
      refuse(fmt::format("{} has {} numbers, want shape {}", path, (physics.*member).size(), shapeText(shape)));
    }
  });
  for (std::size_t i = 1; i < physics.grasp.size(); ++i) {
    if (physics.grasp[i] <= physics.grasp[i - 1]) {
      refuse(
          fmt::format("/grasp row {} is {} after {}, want rising numbers", i, physics.grasp[i], physics.grasp[i - 1]));
    }
  }
  for (std::size_t i = 0; i < physics.outcome.size(); ++i) {
    if (physics.outcome[i] >= physics.outcomeNames.size()) {
      refuse(fmt::format("/load/outcome is {} at element {}, want below {}", physics.outcome[i], i,
                         physics.outcomeNames.size()));
    }
  }
}

std::string encode(const PhysicsSet& physics) {
  Hdf5Builder file(kResultsBlockBytes);
  forEachAttribute([&](const char* name, auto member) {
    if constexpr (std::is_same_v<decltype(member), std::string PhysicsSet::*>) {
      file.setText("/", name, physics.*member);
    } else {
      file.setNumber("/", name, physics.*member);
    }
  });
  for (const char* group : {"/settled", "/load"}) file.addGroup(group);
  forEachPhysicsArray([&](const char* path, auto member, std::string_view symbols) {
    file.addArray(path, shapeOf(physics, symbols), physics.*member);
  });
  file.setTexts("/load/outcome", "names", physics.outcomeNames);
  file.setTexts("/load", "directions", physics.directionNames);
  file.setTexts("/settled", "tests", physics.testNames);
  const std::string image = file.image();
  std::string block = std::string(kResultsMagic) + hashBytes(image.data(), image.size());
  block.resize(kResultsBlockBytes, '\0');
  return block + image;
}

}  // namespace

fs::path physicsPath(const fs::path& set) { return set.parent_path() / ("physics-" + set.filename().string()); }

void writePhysics(const fs::path& path, const PhysicsSet& physics) {
  check(physics, path.string());
  replaceContent(path, encode(physics));
}

PhysicsSet readPhysics(const fs::path& path) {
  const auto refuse = [&](std::string_view message) -> void {
    throw InputError(fmt::format("{}: {}", path.string(), message));
  };
  {
    const std::string bytes = readFile(path);
    if (!bytes.starts_with(kResultsMagic) || bytes.size() < kResultsBlockBytes) {
      refuse(fmt::format("holds no physics results: it does not start with \"{}\"",
                         kResultsMagic.substr(0, kResultsMagic.size() - 1)));
    }
    const std::string found = hashBytes(bytes.data() + kResultsBlockBytes, bytes.size() - kResultsBlockBytes);
    const std::string wanted = bytes.substr(kResultsMagic.size(), kHashLength);
    if (found != wanted) refuse(fmt::format("is damaged: the checksum of its data is {}, want {}", found, wanted));
  }
  const Hdf5View file(path);
  PhysicsSet physics;
  forEachAttribute([&](const char* name, auto member) {
    if constexpr (std::is_same_v<decltype(member), std::string PhysicsSet::*>) {
      physics.*member = file.textAttribute("/", name);
    } else {
      physics.*member = file.number<std::decay_t<decltype(physics.*member)>>("/", name);
    }
  });
  physics.outcomeNames = file.textsAttribute("/load/outcome", "names");
  physics.directionNames = file.textsAttribute("/load", "directions");
  physics.testNames = file.textsAttribute("/settled", "tests");
  forEachPhysicsArray([&](const char* name, auto member, std::string_view symbols) {
    Shape shape;
    physics.*member = file.array<typename std::decay_t<decltype(physics.*member)>::value_type>(name, shape);
    const Shape wanted = shapeOf(physics, symbols);
    if (shape != wanted)
      file.refuse(fmt::format("{} has shape {}, want {}", name, shapeText(shape), shapeText(wanted)));
  });
  check(physics, path.string());
  return physics;
}

PhysicsSet readPhysicsOf(const fs::path& setPath, const std::string& inputHash, int setVersion, std::size_t grasps) {
  const fs::path path = physicsPath(setPath);
  PhysicsSet physics = readPhysics(path);
  if (physics.inputHash != inputHash || physics.setVersion != setVersion) {
    throw InputError(fmt::format("{}: belongs to version {} with input hash {}, want {} with {}", path.string(),
                                 physics.setVersion, physics.inputHash, setVersion, inputHash));
  }
  if (!physics.grasp.empty() && physics.grasp.back() >= grasps) {
    throw InputError(
        fmt::format("{}: /grasp ends with {}, want below {}", path.string(), physics.grasp.back(), grasps));
  }
  return physics;
}

std::vector<double> shareHeld(const PhysicsSet& physics, std::size_t grasps) {
  std::vector<double> share(grasps, std::numeric_limits<double>::quiet_NaN());
  const std::size_t directions = physics.directionNames.size();
  for (std::size_t i = 0; i < physics.graspCount(); ++i) {
    double held = 0, all = 0;
    for (std::size_t k = 0; k < directions; ++k) {
      if (!physics.directionNames[k].starts_with("pull ")) continue;
      all += 1;
      held += physics.outcome[i * directions + k] == 0 ? 1 : 0;
    }
    if (all > 0) share[physics.grasp[i]] = held / all;
  }
  return share;
}

std::size_t countHeld(const PhysicsSet& physics, std::string_view test) {
  const std::size_t directions = physics.directionNames.size();
  std::size_t count = 0;
  for (std::size_t i = 0; i < physics.graspCount(); ++i) {
    bool held = true;
    for (std::size_t k = 0; k < directions; ++k) {
      const bool isOfTest = physics.directionNames[k].starts_with(test);
      held = held && (!isOfTest || physics.outcome[i * directions + k] == 0);
    }
    count += held ? 1 : 0;
  }
  return count;
}

}  // namespace handhold
