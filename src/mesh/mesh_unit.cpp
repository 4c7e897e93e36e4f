#include "core/yaml.h"
#include "mesh/object.h"

#include <map>

namespace handhold {

MeshUnit readMeshUnit(const YamlValue& entry) {
  const YamlValue* unit = entry.find("unit");
  const YamlValue* scale = entry.find("scale");
  if (unit != nullptr && scale != nullptr) scale->fail("is given beside unit, want one of them");
  if (unit != nullptr) {
    static const std::map<std::string, double> kUnits = {{"m", 1}, {"cm", 0.01}, {"mm", 0.001}, {"in", 0.0254}};
    const auto known = kUnits.find(unit->text());
    if (known == kUnits.end()) unit->refuse("m, cm, mm or in");
    return {known->second, true, known->first};
  }
  if (scale != nullptr) return {scale->positiveNumber(), true, "scale " + scale->text()};
  return {};
}

}  // namespace handhold
