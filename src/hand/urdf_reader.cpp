#include "hand/urdf_reader.h"

#include "core/error.h"
#include "core/file.h"
#include "core/hash.h"
#include "hand/urdf_model.h"
#include "mesh/object.h"
#include "mesh/primitives.h"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <mutex>

#include <console_bridge/console.h>
#include <fmt/format.h>
#include <urdf_parser/urdf_parser.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMostLinks = 1000;
constexpr int kDeepestXml = 100;

/// Keeps the first two errors that urdfdom would print: the second often says where the first one is.
class ErrorCollector : public console_bridge::OutputHandler {
 public:
  void log(const std::string& text, console_bridge::LogLevel level, const char*, int) override {
    if (level < console_bridge::CONSOLE_BRIDGE_LOG_ERROR || ++count_ > 2) return;
    errors += (errors.empty() ? "" : "; ") + text;
  }
  std::string errors;

 private:
  int count_ = 0;
};

/// urdfdom's XML reader calls itself for every level.
void refuseDeepXml(const std::string& path, std::string_view text) {
  int depth = 0;
  for (std::size_t at = text.find('<'); at != std::string_view::npos; at = text.find('<', at)) {
    const bool isComment = text.substr(at, 4) == "<!--";
    const std::size_t end = isComment ? text.find("-->", at) : text.find('>', at);
    if (end == std::string_view::npos) return;
    const char kind = text[at + 1];
    if (kind == '/') --depth;
    if (kind != '/' && kind != '!' && kind != '?' && text[end - 1] != '/') ++depth;
    if (depth > kDeepestXml) {
      throw InputError(fmt::format("{}: nests elements more than {} deep, want fewer", path, kDeepestXml));
    }
    at = end;
  }
}

/// urdfdom lets a link have two parents, and rings stand beside the tree.
void requireTree(const std::string& path, const urdf::ModelInterface& model) {
  if (model.links_.size() > kMostLinks) {
    throw InputError(fmt::format("{}: has {} links, want at most {}", path, model.links_.size(), kMostLinks));
  }
  std::map<std::string, const urdf::Joint*> jointAbove;
  for (const auto& [name, joint] : model.joints_) {
    const auto [entry, isFirst] = jointAbove.try_emplace(joint->child_link_name, joint.get());
    if (!isFirst) {
      throw InputError(fmt::format("{}: link {} is the child of joint {} and of joint {}, want one", path,
                                   joint->child_link_name, entry->second->name, name));
    }
  }
  for (const auto& [name, link] : model.links_) {
    std::size_t steps = 0;
    for (auto above = jointAbove.find(name); above != jointAbove.end();
         above = jointAbove.find(above->second->parent_link_name)) {
      if (++steps <= model.links_.size()) continue;
      throw InputError(fmt::format("{}: link {} is in a ring of joints, or below one, want a tree", path, name));
    }
  }
}

/// A .xacro file is a program that writes a URDF; we do not run it.
void refuseXacro(const std::string& path, const std::string& text) {
  // A plain URDF that xacro wrote may still declare its namespace; only elements of it matter.
  const bool isXacro = fs::path(path).extension() == ".xacro" || text.find("<xacro:") != std::string::npos;
  if (!isXacro) return;
  const std::string output = fs::path(path).stem().extension() == ".urdf" ? fs::path(path).stem().string()
                                                                          : fs::path(path).stem().string() + ".urdf";
  throw InputError(fmt::format("{}: is a xacro file, want plain URDF; convert it with: xacro {} > {}", path,
                               fs::path(path).filename().string(), output));
}

std::vector<std::string> splitPaths(const char* list) {
  std::vector<std::string> result;
  for (std::string_view rest = list == nullptr ? "" : list; !rest.empty();) {
    const std::size_t colon = std::min(rest.find(':'), rest.size());
    if (colon > 0) result.emplace_back(rest.substr(0, colon));
    rest.remove_prefix(std::min(colon + 1, rest.size()));
  }
  return result;
}

/// package://NAME/rest: the caller's folder for NAME, else the first that exists of AMENT_PREFIX_PATH/share/NAME,
/// ROS_PACKAGE_PATH/NAME (or that folder itself when it is called NAME), and the folders above the URDF called NAME.
std::string resolvePackage(const std::string& uri, const std::string& urdfPath, const PackagePaths& packages) {
  const std::string rest = uri.substr(std::string("package://").size());
  const std::string name = rest.substr(0, rest.find('/'));
  const std::string inside = rest.size() > name.size() ? rest.substr(name.size() + 1) : "";
  std::vector<fs::path> roots;
  if (const auto given = packages.find(name); given != packages.end()) {
    roots.emplace_back(given->second);
  } else {
    for (const auto& prefix : splitPaths(std::getenv("AMENT_PREFIX_PATH"))) {
      roots.push_back(fs::path(prefix) / "share" / name);
    }
    for (const auto& folder : splitPaths(std::getenv("ROS_PACKAGE_PATH"))) {
      roots.push_back(fs::path(folder).filename() == name ? fs::path(folder) : fs::path(folder) / name);
    }
    for (fs::path above = fs::absolute(urdfPath).parent_path(); above != above.root_path();
         above = above.parent_path()) {
      if (above.filename() == name) roots.push_back(above);
    }
  }
  for (const fs::path& root : roots) {
    if (fs::exists(root / inside)) return (root / inside).string();
  }
  throw InputError(
      fmt::format("{}: {} cannot be found ({} folder{} tried), want --package {}=DIR, or AMENT_PREFIX_PATH "
                  "or ROS_PACKAGE_PATH to lead to it",
                  urdfPath, uri, roots.size(), roots.size() == 1 ? "" : "s", name));
}

std::string resolveMesh(const std::string& name, const std::string& urdfPath, const PackagePaths& packages) {
  if (name.rfind("package://", 0) == 0) return resolvePackage(name, urdfPath, packages);
  const std::string plain = name.rfind("file://", 0) == 0 ? name.substr(7) : name;
  if (plain.find("://") != std::string::npos) {
    throw InputError(
        fmt::format("{}: mesh {} has an unknown scheme, want a path, file:// or package://", urdfPath, name));
  }
  return (fs::path(urdfPath).parent_path() / plain).lexically_normal().string();
}

/// What one URDF reading needs to know everywhere.
struct Reader {
  const std::string& path;
  const std::vector<std::string>& ignoreLinks;
  const PackagePaths& packages;
  const std::map<std::string, TriangleMesh>* storedMeshes;  // null: geometry is read from the files that the URDF names
  Mechanism& mechanism;
  ContentHash hash;

  [[noreturn]] void refuse(const std::string& message) const { throw InputError(path + ": " + message); }

  TriangleMesh geometryMesh(const urdf::Geometry& geometry, const std::string& linkName) const {
    const auto requirePositive = [&](double value, const char* what) {
      if (!(value > 0)) refuse(fmt::format("link {}: {} is {}, want > 0", linkName, what, value));
    };
    if (geometry.type == urdf::Geometry::BOX) {
      const auto& d = static_cast<const urdf::Box&>(geometry).dim;
      for (const double side : {d.x, d.y, d.z}) requirePositive(side, "box size");
      return boxMesh({d.x, d.y, d.z});
    }
    if (geometry.type == urdf::Geometry::CYLINDER) {
      const auto& cylinder = static_cast<const urdf::Cylinder&>(geometry);
      requirePositive(cylinder.radius, "cylinder radius");
      requirePositive(cylinder.length, "cylinder length");
      return cylinderMesh(cylinder.radius, cylinder.length);
    }
    if (geometry.type == urdf::Geometry::SPHERE) {
      requirePositive(static_cast<const urdf::Sphere&>(geometry).radius, "sphere radius");
      return sphereMesh(static_cast<const urdf::Sphere&>(geometry).radius);
    }
    const auto& mesh = static_cast<const urdf::Mesh&>(geometry);
    const std::string file = resolveMesh(mesh.filename, path, packages);
    if (!fs::exists(file)) {
      refuse(fmt::format("link {}: mesh {} does not exist, want a mesh file", linkName, file));
    }
    const Eigen::Vector3d scale(mesh.scale.x, mesh.scale.y, mesh.scale.z);
    if (scale.prod() == 0) refuse(fmt::format("link {}: mesh scale has a 0, want none", linkName));
    return loadMesh(file, scale);
  }

  void requireNear(const Eigen::Vector3d& point, const std::string& what) const {
    const double distance = point.cwiseAbs().maxCoeff();
    if (distance <= kFarthest) return;
    refuse(
        fmt::format("{} reaches {} m from its frame, want at most {} m (a mesh in millimetres needs "
                    "scale=\"0.001 0.001 0.001\")",
                    what, distance, kFarthest));
  }

  /// All pieces of a link as one mesh in the link frame, rounded as the database stores it.
  void readFiles(const urdf::Link& source, Link& link) {
    if (std::find(ignoreLinks.begin(), ignoreLinks.end(), source.name) != ignoreLinks.end()) return;
    std::vector<std::pair<urdf::GeometrySharedPtr, Eigen::Isometry3d>> pieces;
    for (const auto& collision : source.collision_array) {
      if (collision && collision->geometry) pieces.emplace_back(collision->geometry, toPose(collision->origin));
    }
    if (pieces.empty()) {
      for (const auto& visual : source.visual_array) {
        if (visual && visual->geometry) pieces.emplace_back(visual->geometry, toPose(visual->origin));
      }
      if (!pieces.empty())
        mechanism.notes.push_back(fmt::format("link {} has no <collision>: its <visual> is used", link.name));
    }
    for (const auto& [geometry, X_LP] : pieces) {
      append(link.mesh, geometryMesh(*geometry, link.name), X_LP);
    }
    for (const auto& vertex : link.mesh.vertices) requireNear(vertex, "link " + link.name);
    roundToFloat(link.mesh);
  }

  /// Everything that follows from a link's geometry is taken from its mesh as it is stored.
  void readGeometry(const urdf::Link& source, Link& link) {
    if (storedMeshes == nullptr) {
      readFiles(source, link);
    } else if (const auto stored = storedMeshes->find(source.name); stored != storedMeshes->end()) {
      link.mesh = stored->second;
    } else {
      refuse(fmt::format("link {} has no stored geometry", source.name));
    }
    link.piecePoints = pieceVertices(link.mesh);
    for (const auto& vertex : link.mesh.vertices) hash.addBytes(vertex.data(), sizeof vertex);
    for (const auto& triangle : link.mesh.triangles) hash.addBytes(triangle.data(), sizeof triangle);
  }

  void readLimits(const urdf::Joint& source, Joint& joint) const {
    if (source.type == urdf::Joint::CONTINUOUS) {
      joint.lower = -std::numeric_limits<double>::infinity();
      joint.upper = std::numeric_limits<double>::infinity();
      if (source.limits) joint.effort = source.limits->effort;
      if (source.limits) joint.velocity = source.limits->velocity;
      return;
    }
    if (!source.limits) refuse(fmt::format("joint {} has no <limit>, want lower and upper", source.name));
    joint.lower = source.limits->lower;
    joint.upper = source.limits->upper;
    joint.effort = source.limits->effort;
    joint.velocity = source.limits->velocity;
    if (joint.effort < 0) refuse(fmt::format("joint {}: effort is {}, want >= 0", source.name, joint.effort));
    if (!(joint.lower <= joint.upper)) {
      refuse(fmt::format("joint {}: lower limit {} is above upper limit {}", source.name, joint.lower, joint.upper));
    }
  }

  /// Appends the moving joint between two links and returns its index, or -1 for a fixed one.
  int addJoint(const urdf::Joint& source, int parentLink, int childLink) {
    if (source.type == urdf::Joint::FIXED) return -1;
    if (source.type != urdf::Joint::REVOLUTE && source.type != urdf::Joint::CONTINUOUS &&
        source.type != urdf::Joint::PRISMATIC) {
      refuse(fmt::format("joint {} is planar, floating or unknown, want fixed, revolute, continuous or prismatic",
                         source.name));
    }
    Joint joint;
    joint.name = source.name;
    joint.type = source.type == urdf::Joint::PRISMATIC ? JointType::prismatic : JointType::revolute;
    joint.parentLink = parentLink;
    joint.childLink = childLink;
    joint.X_PJ = toPose(source.parent_to_joint_origin_transform);
    joint.axis = {source.axis.x, source.axis.y, source.axis.z};
    if (joint.axis.norm() < 1e-9) refuse(fmt::format("joint {}: axis is zero, want a direction", source.name));
    joint.axis.normalize();
    readLimits(source, joint);
    mechanism.joints.push_back(joint);
    return static_cast<int>(mechanism.joints.size()) - 1;
  }

  /// Depth first, children in the URDF's (alphabetical) order: parents always come before their children.
  void addLink(const urdf::Link& source, int parentLink, const urdf::Joint* toParent) {
    Link link;
    link.name = source.name;
    link.parentLink = parentLink;
    const int index = static_cast<int>(mechanism.links.size());
    if (toParent != nullptr) {
      link.X_PL = toPose(toParent->parent_to_joint_origin_transform);
      requireNear(link.X_PL.translation(), "joint " + toParent->name);
      link.joint = addJoint(*toParent, parentLink, index);
    }
    readGeometry(source, link);
    mechanism.links.push_back(std::move(link));
    for (const auto& child : source.child_links) addLink(*child, index, child->parent_joint.get());
  }

  /// A joint that mimics a mimic joint is made to follow the independent joint at the chain's end.
  void shortenChain(Joint& joint) const {
    for (std::size_t steps = 0; joint.mimicOf >= 0 && mechanism.joints[joint.mimicOf].mimicOf >= 0; ++steps) {
      if (steps > mechanism.joints.size()) refuse(fmt::format("joint {} mimics itself through others", joint.name));
      const Joint& master = mechanism.joints[joint.mimicOf];
      joint.mimicOffset += joint.mimicMultiplier * master.mimicOffset;
      joint.mimicMultiplier *= master.mimicMultiplier;
      joint.mimicOf = master.mimicOf;
    }
  }

  /// Mimic elements name joints; all of a hand's must be inside its subtree and end at an independent joint.
  void connectMimics(const urdf::ModelInterface& model) {
    const auto indexOf = [&](const std::string& name) {
      const auto it =
          std::find_if(mechanism.joints.begin(), mechanism.joints.end(), [&](const auto& j) { return j.name == name; });
      return it == mechanism.joints.end() ? -1 : static_cast<int>(it - mechanism.joints.begin());
    };
    for (Joint& joint : mechanism.joints) {
      const auto mimic = model.getJoint(joint.name)->mimic;
      if (!mimic) continue;
      joint.mimicOf = indexOf(mimic->joint_name);
      joint.mimicMultiplier = mimic->multiplier;
      joint.mimicOffset = mimic->offset;
      if (joint.mimicOf < 0) {
        refuse(fmt::format("joint {} mimics {}, which is no moving joint below the root link", joint.name,
                           mimic->joint_name));
      }
    }
    for (Joint& joint : mechanism.joints) shortenChain(joint);
  }
};

std::string withDoubledPercents(const std::string& text) {
  std::string result;
  for (const char c : text) result += c == '%' ? std::string("%%") : std::string(1, c);
  return result;
}

/// The model, which has a root. Safe from one thread at a time: console_bridge's output handler is the process's.
std::shared_ptr<urdf::ModelInterface> parseLogged(const std::string& path, const std::string& text) {
  ErrorCollector log;
  console_bridge::setLogLevel(console_bridge::CONSOLE_BRIDGE_LOG_ERROR);
  console_bridge::useOutputHandler(&log);
  urdf::ModelInterfaceSharedPtr model;
  std::string reason;
  try {
    model = urdf::parseURDF(text);
  } catch (const std::exception& error) {
    reason = error.what();
  }
  console_bridge::restorePreviousOutputHandler();
  // A shape that it cannot read is an error in its log, and missing in the model.
  if (model == nullptr || model->getRoot() == nullptr || !log.errors.empty()) {
    if (!log.errors.empty()) reason = log.errors;
    if (reason.empty()) reason = "the parser gave no reason";
    throw InputError(fmt::format("{}: is no valid URDF: {}", path, reason));
  }
  return model;
}

}  // namespace

std::shared_ptr<urdf::ModelInterface> parseUrdf(const std::string& path, const std::string& text) {
  static std::mutex parserMutex;  // guards console_bridge
  const std::lock_guard lock(parserMutex);
  refuseDeepXml(path, text);
  // urdfdom logs a number that it cannot read as a format of printf, which would follow its % to anywhere.
  if (text.find('%') != std::string::npos) parseLogged(path, withDoubledPercents(text));
  const auto model = parseLogged(path, text);
  requireTree(path, *model);
  return model;
}

Eigen::Isometry3d toPose(const urdf::Pose& pose) {
  Eigen::Quaterniond q(pose.rotation.w, pose.rotation.x, pose.rotation.y, pose.rotation.z);
  Eigen::Isometry3d X = Eigen::Isometry3d::Identity();
  X.linear() = q.normalized().toRotationMatrix();
  X.translation() = Eigen::Vector3d(pose.position.x, pose.position.y, pose.position.z);
  return X;
}

namespace {

/// Fills `mechanism` with the links below `rootLink` of the URDF in mechanism.urdfText.
void readLinks(const std::string& path, const std::string& rootLink, const std::vector<std::string>& ignoreLinks,
               const PackagePaths& packages, const std::map<std::string, TriangleMesh>* storedMeshes,
               Mechanism& mechanism) {
  const auto model = parseUrdf(path, mechanism.urdfText);
  const auto root = rootLink.empty() ? model->getRoot() : model->getLink(rootLink);
  if (root == nullptr) {
    std::vector<std::string> names;
    for (const auto& [name, link] : model->links_) names.push_back(name);
    throw InputError(fmt::format("{}: has no link {} to begin at (root_link), want one of: {}", path, rootLink,
                                 fmt::join(names, ", ")));
  }
  for (const std::string& name : ignoreLinks) {
    if (model->getLink(name) == nullptr) throw InputError(fmt::format("{}: has no link {} to ignore", path, name));
  }
  Reader reader{path, ignoreLinks, packages, storedMeshes, mechanism, {}};
  reader.addLink(*root, -1, nullptr);
  reader.connectMimics(*model);
  mechanism.contentHash = reader.hash.hex();
}

}  // namespace

void readUrdf(const std::string& path, const std::string& rootLink, const std::vector<std::string>& ignoreLinks,
              const PackagePaths& packages, Mechanism& mechanism) {
  mechanism.urdfText = readFile(path);
  refuseXacro(path, mechanism.urdfText);
  readLinks(path, rootLink, ignoreLinks, packages, nullptr, mechanism);
}

void readStoredUrdf(const std::string& text, const std::string& rootLink,
                    const std::map<std::string, TriangleMesh>& meshes, Mechanism& mechanism) {
  mechanism.urdfText = text;
  readLinks("the stored URDF", rootLink, {}, {}, &meshes, mechanism);
}

std::string yamlName(const std::string& name) {
  const bool plain = !name.empty() && std::isalpha(static_cast<unsigned char>(name[0])) != 0 &&
                     std::all_of(name.begin(), name.end(), [](unsigned char c) {
                       return std::isalnum(c) != 0 || c == '_' || c == '-' || c == '.' || c == '/';
                     });
  if (plain && name != "null") return name;
  std::string result = "\"";
  for (const char c : name) {
    if (c == '"' || c == '\\') result += '\\';
    result += c;
  }
  return result + "\"";
}

}  // namespace handhold
