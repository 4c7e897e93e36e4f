#include "view/box_plot.h"

#include "view/svg.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

namespace handhold {
namespace {

using svg::kColours;
using svg::line;
using svg::text;

constexpr double kTop = 50, kHeight = 360, kLeft = 70, kBox = 26, kGap = 34;

double quantile(const std::vector<double>& sorted, double p) {
  const double at = p * static_cast<double>(sorted.size() - 1);
  const auto low = static_cast<std::size_t>(at);
  const std::size_t high = std::min(low + 1, sorted.size() - 1);
  return std::lerp(sorted[low], sorted[high], at - static_cast<double>(low));
}

/// Vertical positions: decades from 1 to the largest value.
struct Axis {
  double decades = 1;
  double y(double value) const { return kTop + kHeight * (1 - std::log10(std::max(value, 1.0)) / decades); }
};

std::string box(std::vector<double> values, double x, const char* colour, const Axis& axis) {
  std::sort(values.begin(), values.end());
  const double q1 = quantile(values, 0.25), q2 = quantile(values, 0.5), q3 = quantile(values, 0.75);
  const double reach = 1.5 * (q3 - q1);
  const double low = *std::lower_bound(values.begin(), values.end(), q1 - reach);
  const double high = *std::prev(std::upper_bound(values.begin(), values.end(), q3 + reach));
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
  const std::string stroke = fmt::format("stroke=\"{}\" stroke-width=\"1.5\"", colour);
  const double middle = x + kBox / 2;
  std::string drawn =
      line(middle, axis.y(low), middle, axis.y(q1), stroke) + line(middle, axis.y(q3), middle, axis.y(high), stroke);
  drawn += fmt::format(
      "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"{:.1f}\" height=\"{:.1f}\" fill=\"{}\" fill-opacity=\"0.25\" {}/>\n", x,
      axis.y(q3), kBox, std::max(1.0, axis.y(q1) - axis.y(q3)), colour, stroke);
  drawn += line(x, axis.y(q2), x + kBox, axis.y(q2), stroke);
  drawn += line(x - 3, axis.y(mean), x + kBox + 3, axis.y(mean), "stroke=\"#d55e00\" stroke-width=\"2.5\"");
  for (const double value : values) {
    if (value >= low && value <= high) continue;
    drawn +=
        fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"2\" fill=\"none\" {}/>\n", middle, axis.y(value), stroke);
  }
  return drawn;
}

}  // namespace

std::string boxPlotSvg(const std::string& title, const std::string& yLabel, const std::vector<BoxPlotGroup>& groups) {
  Axis axis;
  double width = kLeft + kGap;
  for (const BoxPlotGroup& group : groups) {
    for (const BoxPlotGroup::Series& series : group.series) {
      width += kBox + 6;
      for (const double value : series.values) axis.decades = std::max(axis.decades, std::ceil(std::log10(value)));
    }
    width += kGap;
  }
  std::string body = text(width / 2, 24, "middle", title, 15);
  for (int decade = 0; decade <= static_cast<int>(axis.decades); ++decade) {
    const double value = std::pow(10, decade);
    body += line(kLeft, axis.y(value), width - 10, axis.y(value), svg::kGrid);
    body += text(kLeft - 8, axis.y(value) + 4, "end", fmt::format("{:.0f}", value));
  }
  body += svg::uprightText(18, kTop + kHeight / 2, yLabel);
  double x = kLeft + kGap;
  for (const BoxPlotGroup& group : groups) {
    const double from = x;
    for (std::size_t i = 0; i < group.series.size(); ++i) {
      if (!group.series[i].values.empty()) body += box(group.series[i].values, x, kColours[i % kColours.size()], axis);
      x += kBox + 6;
    }
    body += text((from + x - 6) / 2, kTop + kHeight + 20, "middle", group.label, 11);
    x += kGap;
  }
  double key = kLeft;
  const double keyY = kTop + kHeight + 44;
  if (!groups.empty()) {
    for (std::size_t i = 0; i < groups[0].series.size(); ++i) {
      body += fmt::format("<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"12\" height=\"12\" fill=\"{}\"/>\n", key, keyY - 10,
                          kColours[i % kColours.size()]);
      body += text(key + 18, keyY, "start", groups[0].series[i].name);
      key += 40 + 7.5 * static_cast<double>(groups[0].series[i].name.size());
    }
  }
  body += line(key, keyY - 4, key + 24, keyY - 4, "stroke=\"#d55e00\" stroke-width=\"2.5\"");
  body += text(key + 30, keyY, "start", "mean");
  return svg::document(std::max(width, key + 90), keyY + 14, body);
}

}  // namespace handhold
