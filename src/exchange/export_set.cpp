#include "exchange/export_set.h"

#include "core/error.h"

#include <cassert>

#include <fmt/format.h>

namespace handhold {
namespace {

/// Wavefront OBJ; vertices are 32-bit floats and read back as the same ones.
std::string objText(const TriangleMesh& mesh) {
  std::string text;
  for (const Eigen::Vector3d& v : mesh.vertices)
    text +=
        fmt::format("v {} {} {}\n", static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z()));
  for (const auto& t : mesh.triangles) text += fmt::format("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
  return text;
}

/// The poses of the grasps as those of another frame of the hand.
FoundSet inFrame(const ExportedSet& exported, GraspFrame frame) {
  FoundSet moved = exported.found;
  const std::vector<Eigen::Isometry3d> X_OF = framePoses(exported, frame, RootAxes::link);
  for (std::size_t i = 0; i < X_OF.size(); ++i) {
    const Eigen::Vector3d p = X_OF[i].translation();
    Eigen::Quaterniond q(X_OF[i].linear());
    if (q.w() < 0) q.coeffs() = -q.coeffs();
    moved.grasps[i].handPose = {p.x(), p.y(), p.z(), q.x(), q.y(), q.z(), q.w()};
  }
  return moved;
}

}  // namespace

ExportedSet loadExportedSet(FoundSet found) {
  ExportedSet exported;
  exported.set = readGraspSet(found.path);
  try {
    const GraspSet& set = exported.set;
    exported.hand = restoreHand(set.hand, set.urdf, set.config, set.linkNames, set.linkMeshes);
  } catch (const InputError& error) {
    throw InputError(fmt::format("{}: {}", found.path.string(), error.what()));
  }
  exported.found = std::move(found);
  return exported;
}

std::vector<Eigen::Isometry3d> framePoses(const ExportedSet& exported, GraspFrame frame, RootAxes axes) {
  std::vector<Eigen::Isometry3d> X_OF;
  for (const FoundGrasp& grasp : exported.found.grasps)
    X_OF.push_back(grasp.X_OH * framePose(exported.hand, grasp.preshapeJointPosition, frame, axes));
  return X_OF;
}

std::vector<ExportedFile> exportSet(const ExportedSet& exported, ExportFormat format, GraspFrame frame) {
  const std::string name = exported.found.object + "_" + exported.found.hand;
  const std::size_t n = exported.found.grasps.size();
  switch (format) {
    case ExportFormat::acronym:
      return {{name + ".obj", objText(exported.set.objectMesh), 0},
              {name + ".h5", acronymFile(exported, frame, name + ".obj"), n}};
    case ExportFormat::isaac:
      return {{name + ".yaml", isaacText(exported, frame), n}};
    case ExportFormat::moveit:
      return {{name + ".yaml", moveitText(exported, frame), n}};
    case ExportFormat::csv:
      if (frame == GraspFrame::root) return {{name + ".csv", csvText({exported.found}), n}};
      return {{name + ".csv", csvText({inFrame(exported, frame)}, "tcp_"), n}};
    case ExportFormat::gltf: {
      std::vector<ExportedFile> files;
      for (std::size_t i = 0; i < n; ++i) {
        const std::string suffix = n == 1 ? "" : fmt::format("_{}", exported.found.grasps[i].grasp);
        files.push_back({name + suffix + ".glb", gltfFile(exported, i), 1});
      }
      return files;
    }
  }
  assert(false);
  return {};
}

}  // namespace handhold
