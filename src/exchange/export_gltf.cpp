#include "exchange/export_set.h"

#include <cstring>

#include <nlohmann/json.hpp>

namespace handhold {
namespace {

using Json = nlohmann::ordered_json;

// Numbers of the glTF 2.0 specification (Khronos).
constexpr int kFloat = 5126, kUnsignedInt = 5125, kArrayBuffer = 34962, kElementArrayBuffer = 34963;
constexpr std::uint32_t kMagic = 0x46546C67, kVersion = 2, kJsonChunk = 0x4E4F534A, kBinaryChunk = 0x004E4942;

template <class T>
void appendBytes(std::string& bytes, T value) {
  char raw[sizeof value];
  std::memcpy(raw, &value, sizeof value);
  bytes.append(raw, sizeof value);
}

/// A glTF scene that grows: one buffer, a view and an accessor for each array.
class Scene {
 public:
  Scene() {
    json_ = {{"asset", {{"version", "2.0"}, {"generator", "handhold"}}},
             {"scene", 0},
             {"scenes", Json::array({{{"nodes", Json::array()}}})}};
  }

  int addMaterial(const std::string& name, const std::array<double, 4>& color) {
    return add("materials", {{"name", name},
                             {"doubleSided", true},
                             {"pbrMetallicRoughness", {{"baseColorFactor", color}, {"metallicFactor", 0}}}});
  }

  int addMesh(const std::string& name, const TriangleMesh& mesh, int material) {
    std::string vertices, indices;
    Eigen::AlignedBox3f box;
    for (const Eigen::Vector3d& vertex : mesh.vertices) {
      box.extend(vertex.cast<float>());
      for (const double x : vertex) appendBytes(vertices, static_cast<float>(x));
    }
    for (const auto& triangle : mesh.triangles) {
      for (const std::uint32_t vertex : triangle) appendBytes(indices, vertex);
    }
    const int positions = addAccessor(vertices, kArrayBuffer, kFloat, "VEC3", mesh.vertices.size());
    json_["accessors"].back()["min"] = {box.min().x(), box.min().y(), box.min().z()};
    json_["accessors"].back()["max"] = {box.max().x(), box.max().y(), box.max().z()};
    const int triangles = addAccessor(indices, kElementArrayBuffer, kUnsignedInt, "SCALAR", 3 * mesh.triangles.size());
    const Json primitive = {{"attributes", {{"POSITION", positions}}}, {"indices", triangles}, {"material", material}};
    return add("meshes", {{"name", name}, {"primitives", Json::array({primitive})}});
  }

  /// A node below `parent` (-1: the scene itself), `mesh` -1: without one. Quaternions are x y z w.
  int addNode(const std::string& name, int parent, const Eigen::Isometry3d& X, int mesh) {
    const Eigen::Quaterniond q(X.linear());
    Json node = {{"name", name},
                 {"translation", {X.translation().x(), X.translation().y(), X.translation().z()}},
                 {"rotation", {q.x(), q.y(), q.z(), q.w()}}};
    if (mesh >= 0) node["mesh"] = mesh;
    const int index = add("nodes", node);
    (parent < 0 ? json_["scenes"][0]["nodes"] : json_["nodes"][static_cast<std::size_t>(parent)]["children"])
        .push_back(index);
    return index;
  }

  void setExtras(Json extras) { json_["extras"] = std::move(extras); }

  /// The scene as one binary file.
  std::string bytes() {
    json_["buffers"] = Json::array({{{"byteLength", buffer_.size()}}});
    std::string text = json_.dump();
    text.resize((text.size() + 3) / 4 * 4, ' ');
    std::string file;
    for (const std::size_t number : {std::size_t{kMagic}, std::size_t{kVersion}, 28 + text.size() + buffer_.size(),
                                     text.size(), std::size_t{kJsonChunk}})
      appendBytes(file, static_cast<std::uint32_t>(number));
    file += text;
    appendBytes(file, static_cast<std::uint32_t>(buffer_.size()));
    appendBytes(file, kBinaryChunk);
    return file + buffer_;
  }

 private:
  /// All our arrays are of 4-byte numbers: every offset is aligned.
  int addAccessor(const std::string& bytes, int target, int type, const char* shape, std::size_t count) {
    const int view =
        add("bufferViews",
            {{"buffer", 0}, {"byteOffset", buffer_.size()}, {"byteLength", bytes.size()}, {"target", target}});
    buffer_ += bytes;
    return add("accessors", {{"bufferView", view}, {"componentType", type}, {"count", count}, {"type", shape}});
  }

  int add(const char* list, Json value) {
    json_[list].push_back(std::move(value));
    return static_cast<int>(json_[list].size()) - 1;
  }

  Json json_;
  std::string buffer_;
};

}  // namespace

std::string gltfFile(const ExportedSet& exported, std::size_t index) {
  const FoundGrasp& grasp = exported.found.grasps[index];
  const Hand& hand = exported.hand;
  Scene scene;
  const int objectColor = scene.addMaterial("object", {0.8, 0.6, 0.3, 1});
  const int handColor = scene.addMaterial("hand", {0.45, 0.5, 0.6, 1});
  scene.addNode(exported.found.object, -1, Eigen::Isometry3d::Identity(),
                scene.addMesh(exported.found.object, exported.set.objectMesh, objectColor));
  const int root = scene.addNode(exported.found.hand, -1, grasp.X_OH, -1);
  const auto X_HL = forwardKinematics(hand, grasp.jointPosition);
  for (std::size_t i = 0; i < hand.links.size(); ++i) {
    const Link& link = hand.links[i];
    const int mesh = link.mesh.triangles.empty() ? -1 : scene.addMesh(link.name, link.mesh, handColor);
    scene.addNode(link.name, root, X_HL[i], mesh);
  }
  scene.addNode("tcp", root, framePose(hand, grasp.jointPosition, GraspFrame::tcp, RootAxes::palm), -1);
  scene.setExtras({{"object", exported.found.object},
                   {"hand", exported.found.hand},
                   {"set_version", exported.found.setVersion},
                   {"grasp", grasp.grasp},
                   {"epsilon", grasp.epsilon}});
  return scene.bytes();
}

}  // namespace handhold
