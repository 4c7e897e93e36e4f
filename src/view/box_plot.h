#pragma once

#include <string>
#include <vector>

namespace handhold {

/// Boxes of one cell of an experiment, side by side.
struct BoxPlotGroup {
  std::string label;
  struct Series {
    std::string name;
    std::vector<double> values;  // > 0
  };
  std::vector<Series> series;
};

/// A box plot with a logarithmic vertical axis as SVG text, readable on light and dark ground: box from the first to
/// the third quartile, line at the median, whiskers to the last value within 1.5 times the box (Tukey 1977), circles
/// beyond, a bar at the mean. Colours tell series apart without red against green.
std::string boxPlotSvg(const std::string& title, const std::string& yLabel, const std::vector<BoxPlotGroup>& groups);

}  // namespace handhold
