#include "view/calibration_plot.h"

#include "view/svg.h"

#include <cmath>
#include <cstddef>

#include <fmt/format.h>

namespace handhold {
namespace {

using svg::line;
using svg::text;

constexpr double kSquareSide = 320, kSquareTop = 60, kSquareLeft = 64, kBetween = 60;

/// A square of [0, 1] x [0, 1].
struct Square {
  double left = kSquareLeft;
  double x(double value) const { return left + kSquareSide * value; }
  double y(double value) const { return kSquareTop + kSquareSide * (1 - value); }

  std::string axes(const std::string& xLabel, const std::string& yLabel) const {
    std::string drawn;
    for (int i = 0; i <= 5; ++i) {
      const double value = i / 5.0;
      drawn += line(x(0), y(value), x(1), y(value), svg::kGrid) + line(x(value), y(0), x(value), y(1), svg::kGrid);
      drawn += text(x(0) - 8, y(value) + 4, "end", fmt::format("{:.1f}", value));
      drawn += text(x(value), y(0) + 18, "middle", fmt::format("{:.1f}", value));
    }
    drawn += line(x(0), y(0), x(1), y(1), "stroke=\"#888888\" stroke-dasharray=\"5 4\"");
    return drawn + text(x(0.5), y(0) + 40, "middle", xLabel) + svg::uprightText(left - 44, y(0.5), yLabel);
  }
};

}  // namespace

std::string rocSvg(const std::string& title, const std::vector<RocSeries>& series) {
  const Square square;
  std::string body = text(square.x(0.5), 24, "middle", title, 15);
  body += square.axes("share of those that failed", "share of those that held");
  double y = square.y(0.05) - 18 * static_cast<double>(series.size() - 1);
  for (std::size_t i = 0; i < series.size(); ++i, y += 18) {
    const char* colour = svg::kColours[i % svg::kColours.size()];
    std::string points;
    std::array<double, 2> last{-1, -1};
    for (const auto& point : series[i].points) {
      const bool isSeen = std::hypot(point[0] - last[0], point[1] - last[1]) * kSquareSide >= 1;  // apart from the last
      if (!isSeen && &point != &series[i].points.back()) continue;
      points += fmt::format("{:.1f},{:.1f} ", square.x(point[0]), square.y(point[1]));
      last = point;
    }
    body += fmt::format("<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"2\"/>\n", points, colour);
    body += line(square.x(0.42), y - 4, square.x(0.42) + 22, y - 4,
                 fmt::format("stroke=\"{}\" stroke-width=\"3\"", colour));
    body += text(square.x(0.42) + 28, y, "start", series[i].name);
  }
  return svg::document(square.x(1) + 24, square.y(0) + 56, body);
}

std::string reliabilitySvg(const std::string& title, const std::vector<ReliabilityPanel>& panels) {
  const char* colour = svg::kColours[1];
  std::string drawn;
  Square square;
  for (const ReliabilityPanel& panel : panels) {
    drawn += text(square.x(0.5), kSquareTop - 10, "middle", panel.name, 13);
    drawn += square.axes("probability", "share that held, 95 % interval");
    for (const ReliabilityPanel::Bin& bin : panel.bins) {
      const double x = square.x(bin.predicted);
      drawn +=
          line(x, square.y(bin.low), x, square.y(bin.high), fmt::format("stroke=\"{}\" stroke-width=\"2\"", colour));
      drawn +=
          fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"4\" fill=\"{}\"/>\n", x, square.y(bin.share), colour);
      drawn += text(square.x(bin.middle), square.y(0) + 60, "middle", fmt::format("{}", bin.count), 11);
    }
    drawn += text(square.x(0) - 8, square.y(0) + 60, "end", "n", 11);
    square.left += kSquareSide + kBetween + 16;
  }
  const double width = square.left - kBetween + 8;
  return svg::document(width, square.y(0) + 72, text(width / 2, 24, "middle", title, 15) + drawn);
}

}  // namespace handhold
