#pragma once

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <numeric>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace handhold::bench {

inline double microsecondsNow() {
  const auto now = std::chrono::steady_clock::now().time_since_epoch();
  return std::chrono::duration<double, std::micro>(now).count();
}

inline double quantile(std::vector<double> values, double q) {
  if (values.empty()) return std::nan("");
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// Times of single calls in repeats; each repeat has instances of its own.
class Timings {
 public:
  void startRepeat() { repeats_.emplace_back(); }
  void add(double microseconds) { repeats_.back().push_back(microseconds); }
  double median() const { return at(0.5); }
  double at(double q) const { return quantile(all(), q); }
  double mean() const {
    const std::vector<double> values = all();
    return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
  }

  nlohmann::ordered_json json() const {
    std::vector<double> medians;
    for (const auto& repeat : repeats_) {
      if (!repeat.empty()) medians.push_back(quantile(repeat, 0.5));
    }
    if (medians.empty()) return nullptr;
    const auto [least, most] = std::minmax_element(medians.begin(), medians.end());
    return {{"median_us", median()},     {"p90_us", quantile(all(), 0.9)}, {"calls", all().size()},
            {"repeats", medians.size()}, {"median_min_us", *least},        {"median_max_us", *most}};
  }

 private:
  std::vector<double> all() const {
    std::vector<double> values;
    for (const auto& repeat : repeats_) values.insert(values.end(), repeat.begin(), repeat.end());
    return values;
  }

  std::vector<std::vector<double>> repeats_;
};

/// The value of a call; its time goes to the timings.
template <class Call>
auto timed(Timings& timings, const Call& call) {
  const double before = microsecondsNow();
  const auto value = call();
  timings.add(microsecondsNow() - before);
  return value;
}

inline std::string cpuModel() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  }
  return "unknown";
}

}  // namespace handhold::bench
