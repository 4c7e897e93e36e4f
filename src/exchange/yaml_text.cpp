#include "exchange/yaml_text.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace handhold {

std::string yamlNumber(double value) { return fmt::format("{:#}", value); }

std::string yamlList(const Eigen::VectorXd& values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : ", ") + yamlNumber(value);
  return "[" + text + "]";
}

std::string yamlText(const std::string& text) { return nlohmann::json(text).dump(); }

std::string yamlList(const std::vector<std::string>& texts) {
  std::string all;
  for (const std::string& text : texts) all += (all.empty() ? "" : ", ") + yamlText(text);
  return "[" + all + "]";
}

}  // namespace handhold
