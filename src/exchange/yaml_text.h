#pragma once

// Private to this library: numbers and texts as every YAML reader takes them.

#include <string>
#include <vector>

#include <Eigen/Core>

namespace handhold {

/// The shortest text that reads back as the same number; always with a point, without which PyYAML takes 1e-05 for
/// text.
std::string yamlNumber(double value);
/// `[1.0, 2.0]`
std::string yamlList(const Eigen::VectorXd& values);
/// In double quotes, escaped as in JSON, which is YAML.
std::string yamlText(const std::string& text);
/// `["a", "b"]`
std::string yamlList(const std::vector<std::string>& texts);

}  // namespace handhold
