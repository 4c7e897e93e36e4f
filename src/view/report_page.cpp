#include "view/report_page.h"

#include "view/page_files.h"

#include <array>
#include <cmath>
#include <map>

#include <nlohmann/json.hpp>

namespace handhold {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kDrawnTriangles = 200'000;  // of a mesh; more cost loading time and show nothing

/// In the order in which they need each other.
constexpr std::array<std::string_view, 9> kScripts = {"data.js",     "colour.js",    "chart.js", "list.js", "stage.js",
                                                      "overview.js", "grasp_set.js", "plan.js",  "main.js"};

/// No element ends inside a text of JSON: `<` occurs in its strings alone.
std::string withoutTags(const std::string& json) {
  std::string safe;
  safe.reserve(json.size());
  for (const char c : json) c == '<' ? safe += "\\u003c" : safe += c;
  return safe;
}

std::string escaped(const std::string& text) {
  std::string safe;
  for (const char c : text) {
    c == '&' ? safe += "&amp;" : c == '<' ? safe += "&lt;" : safe += c;
  }
  return safe;
}

/// `page` with its one `<!-- NAME -->` replaced.
void fill(std::string& page, std::string_view name, std::string_view text) {
  const std::string mark = "<!-- " + std::string(name) + " -->";
  page.replace(page.find(mark), mark.size(), text);
}

/// Mean of the vertices in each cell of a cubic grid; triangles between three cells stay.
TriangleMesh clustered(const TriangleMesh& mesh, double cell) {
  std::map<std::array<std::int64_t, 3>, std::uint32_t> cells;
  std::vector<std::uint32_t> cellOf;
  std::vector<double> count;
  TriangleMesh result;
  for (const Eigen::Vector3d& v : mesh.vertices) {
    const std::array<std::int64_t, 3> key = {std::llround(v.x() / cell), std::llround(v.y() / cell),
                                             std::llround(v.z() / cell)};
    const auto [entry, isNew] = cells.try_emplace(key, static_cast<std::uint32_t>(cells.size()));
    if (isNew) result.vertices.emplace_back(Eigen::Vector3d::Zero()), count.push_back(0);
    result.vertices[entry->second] += v;
    ++count[entry->second];
    cellOf.push_back(entry->second);
  }
  for (std::size_t i = 0; i < count.size(); ++i) result.vertices[i] /= count[i];
  for (const auto& t : mesh.triangles) {
    const std::array<std::uint32_t, 3> moved = {cellOf[t[0]], cellOf[t[1]], cellOf[t[2]]};
    if (moved[0] != moved[1] && moved[1] != moved[2] && moved[2] != moved[0]) result.triangles.push_back(moved);
  }
  return result;
}

Json poseJson(const Eigen::Isometry3d& X) {
  const Eigen::Quaterniond q(X.linear());
  return {X.translation().x(), X.translation().y(), X.translation().z(), q.x(), q.y(), q.z(), q.w()};
}

Json meshOf(const TriangleMesh& full) {
  const TriangleMesh mesh = coarserMesh(full, kDrawnTriangles);
  std::vector<float> vertices;
  vertices.reserve(3 * mesh.vertices.size());
  for (const Eigen::Vector3d& v : mesh.vertices) {
    for (const double x : v) vertices.push_back(static_cast<float>(x));
  }
  std::vector<std::uint32_t> indices;
  indices.reserve(3 * mesh.triangles.size());
  for (const auto& triangle : mesh.triangles) indices.insert(indices.end(), triangle.begin(), triangle.end());
  const bool isShort = mesh.vertices.size() <= 0x10000;
  const std::string triangles =
      isShort ? packed(std::vector<std::uint16_t>(indices.begin(), indices.end())) : packed(indices);
  return {{"vertices", packed(vertices)}, {"triangles", triangles}};
}

}  // namespace

std::string assemblePage(const std::string& title, const std::vector<PageData>& data) {
  std::string blocks, scripts;
  for (const PageData& block : data) {
    blocks += "<script type=\"application/json\" id=\"" + block.name + "\">" + withoutTags(block.json) + "</script>\n";
  }
  for (const std::string_view name : kScripts) scripts += std::string(pageFile(name)) + "\n";
  std::string page(pageFile("page.html"));
  fill(page, "title", escaped(title));
  fill(page, "style", pageFile("style.css"));
  fill(page, "three.js", pageFile("three.min.js"));
  fill(page, "scripts", scripts);
  fill(page, "data", blocks);  // last: a text in it may look like one of the marks
  return page;
}

std::string base64(const void* bytes, std::size_t size) {
  constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  const auto* byte = static_cast<const unsigned char*>(bytes);
  std::string text;
  text.reserve((size + 2) / 3 * 4);
  for (std::size_t i = 0; i < size; i += 3) {
    std::uint32_t three = 0;
    for (std::size_t j = 0; j < 3; ++j) three = three << 8 | (i + j < size ? byte[i + j] : 0u);
    for (int j = 0; j < 4; ++j) text += kDigits[three >> (18 - 6 * j) & 63];
  }
  for (std::size_t i = text.size() - (3 - size % 3) % 3; i < text.size(); ++i) text[i] = '=';
  return text;
}

std::string meshJson(const TriangleMesh& mesh) { return meshOf(mesh).dump(); }

std::string handJson(const Hand& hand) {
  Json links = Json::array(), joints = Json::array();
  for (const Link& link : hand.links) {
    links.push_back({{"name", link.name},
                     {"parent", link.parentLink},
                     {"joint", link.joint},
                     {"pose", poseJson(link.X_PL)},
                     {"mesh", meshOf(link.mesh)}});
  }
  for (const Joint& joint : hand.joints) {
    joints.push_back({{"name", joint.name},
                      {"prismatic", joint.type == JointType::prismatic},
                      {"pose", poseJson(joint.X_PJ)},
                      {"axis", {joint.axis.x(), joint.axis.y(), joint.axis.z()}}});
  }
  return Json{{"links", links}, {"joints", joints}}.dump(-1, ' ', false, Json::error_handler_t::replace);
}

TriangleMesh coarserMesh(const TriangleMesh& mesh, std::size_t maxTriangles) {
  if (mesh.triangles.size() <= maxTriangles) return mesh;
  // A surface in a box of diagonal d covers about 2 (d / cell)^2 triangles.
  double cell = boundingBox(mesh).diagonal().norm() / std::sqrt(static_cast<double>(maxTriangles) / 2);
  for (;; cell *= 1.2) {
    TriangleMesh coarser = clustered(mesh, cell);
    if (coarser.triangles.size() <= maxTriangles) return coarser;
  }
}

}  // namespace handhold
