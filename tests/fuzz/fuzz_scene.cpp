// Any text as a scene file: a scene or an InputError of one line. The database has one object, a box called mug;
// obstacles that read other files (mesh, points) are passed over.
#include "core/yaml.h"
#include "fuzz/one_line.h"
#include "mesh/primitives.h"
#include "scene/scene.h"

#include <algorithm>

namespace handhold {
namespace {

bool readsOtherFiles(const YamlValue& top) {
  using Kind = YamlValue::Kind;
  const YamlValue* obstacles = top.kind() == Kind::map ? top.find("obstacles") : nullptr;
  if (obstacles == nullptr || obstacles->kind() != Kind::sequence) return false;
  return std::any_of(obstacles->items().begin(), obstacles->items().end(), [](const YamlValue& entry) {
    return entry.kind() == Kind::map && (entry.find("mesh") != nullptr || entry.find("points") != nullptr);
  });
}

void readSceneText(const std::string& text) {
  try {
    const YamlValue top = YamlValue::parseText(text, "scene.yaml");
    if (readsOtherFiles(top)) return;
    readScene(top, "scene.yaml", [](const std::string& object) {
      if (object != "mug") throw InputError("the database has no such object");
      return boxMesh({0.1, 0.1, 0.1});
    });
  } catch (const InputError& error) {
    fuzz::requireOneLine(error);
  }
}

}  // namespace
}  // namespace handhold

extern "C" int LLVMFuzzerTestOneInput(const unsigned char* data, std::size_t size) {
  handhold::readSceneText(std::string(reinterpret_cast<const char*>(data), size));
  return 0;
}
