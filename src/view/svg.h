#pragma once

// Private to this library: the pieces that plots are drawn with.

#include <array>
#include <string>

namespace handhold::svg {

/// Okabe and Ito's colours: they tell series apart without red against green.
inline constexpr std::array<const char*, 4> kColours = {"#999999", "#0072b2", "#e69f00", "#009e73"};
inline constexpr const char* kGrid = "stroke=\"#888888\" stroke-opacity=\"0.4\"";

std::string line(double x1, double y1, double x2, double y2, const std::string& style);
/// @param anchor  start, middle or end
std::string text(double x, double y, const std::string& anchor, const std::string& content, int size = 12);
/// The same turned to read upwards.
std::string uprightText(double x, double y, const std::string& content);
/// The file, readable on light and dark ground.
std::string document(double width, double height, const std::string& body);

}  // namespace handhold::svg
