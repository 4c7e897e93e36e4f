// Any text as the robot.yaml of robots/panda: a robot or an InputError of one line. Files that the text names beside
// the URDF and the hand that ship are passed over.
#include "core/yaml.h"
#include "fuzz/one_line.h"
#include "robot/robot.h"

namespace handhold {
namespace {

bool readsOtherFiles(const YamlValue& top) {
  using Kind = YamlValue::Kind;
  if (top.kind() != Kind::map) return false;
  const auto isOther = [](const YamlValue* value, const char* known) {
    return value != nullptr && value->kind() == Kind::scalar && value->text() != known;
  };
  if (isOther(top.find("urdf"), "panda.urdf")) return true;
  const YamlValue* arms = top.find("arms");
  if (arms == nullptr || arms->kind() != Kind::sequence) return false;
  for (const YamlValue& arm : arms->items()) {
    if (arm.kind() == Kind::map && isOther(arm.find("hand"), "../../hands/jaw")) return true;
  }
  return false;
}

void readRobot(const std::string& text) {
  try {
    const std::string path = HANDHOLD_SOURCE_DIR "/robots/panda/robot.yaml";
    if (!readsOtherFiles(YamlValue::parseText(text, path))) parseRobot(text, path);
  } catch (const InputError& error) {
    fuzz::requireOneLine(error);
  }
}

}  // namespace
}  // namespace handhold

extern "C" int LLVMFuzzerTestOneInput(const unsigned char* data, std::size_t size) {
  handhold::readRobot(std::string(reinterpret_cast<const char*>(data), size));
  return 0;
}
