// Any text as a job file: a job or an InputError of one line. Entries that read other files (folder, csv) are passed
// over.
#include "build/job.h"
#include "core/yaml.h"
#include "fuzz/one_line.h"

#include <algorithm>

namespace handhold {
namespace {

bool readsOtherFiles(const YamlValue& top) {
  using Kind = YamlValue::Kind;
  const YamlValue* catalog = top.kind() == Kind::map ? top.find("catalog") : nullptr;
  if (catalog == nullptr || catalog->kind() != Kind::sequence) return false;
  return std::any_of(catalog->items().begin(), catalog->items().end(), [](const YamlValue& entry) {
    return entry.kind() == Kind::map && (entry.find("folder") != nullptr || entry.find("csv") != nullptr);
  });
}

void readJob(const std::string& text) {
  try {
    if (!readsOtherFiles(YamlValue::parseText(text, "job.yaml"))) taskWrenches(parseJob(text, "job.yaml"));
  } catch (const InputError& error) {
    fuzz::requireOneLine(error);
  }
}

}  // namespace
}  // namespace handhold

extern "C" int LLVMFuzzerTestOneInput(const unsigned char* data, std::size_t size) {
  handhold::readJob(std::string(reinterpret_cast<const char*>(data), size));
  return 0;
}
