#include "view/svg.h"

#include <fmt/format.h>

namespace handhold::svg {

std::string line(double x1, double y1, double x2, double y2, const std::string& style) {
  return fmt::format("<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" {}/>\n", x1, y1, x2, y2, style);
}

std::string text(double x, double y, const std::string& anchor, const std::string& content, int size) {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\" font-size=\"{}\">{}</text>\n", x, y, anchor,
                     size, content);
}

std::string uprightText(double x, double y, const std::string& content) {
  return fmt::format(
      "<text transform=\"translate({} {:.1f}) rotate(-90)\" text-anchor=\"middle\" font-size=\"12\">{}</text>\n", x, y,
      content);
}

std::string document(double width, double height, const std::string& body) {
  return fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{0:.0f}\" height=\"{1:.0f}\" viewBox=\"0 0 {0:.0f} {1:.0f}\" "
      "font-family=\"sans-serif\">\n<style>text{{fill:#222}}@media(prefers-color-scheme:dark){{text{{fill:#ddd}}}}</"
      "style>\n"
      "{2}</svg>\n",
      width, height, body);
}

}  // namespace handhold::svg
