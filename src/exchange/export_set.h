#pragma once

#include "exchange/grasp_frame.h"
#include "store/database.h"

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace handhold {

/// What docs/exchange.md describes.
enum class ExportFormat { acronym, isaac, moveit, csv, gltf };

/// Grasps of one set that a query found, with the whole set and its hand.
struct ExportedSet {
  FoundSet found;  // the grasps to be written, at least one
  GraspSet set;
  Hand hand;
};

/// Reads the set in which something was found. @throws InputError  as readGraspSet and restoreHand do
ExportedSet loadExportedSet(FoundSet found);

/// A file to be written.
struct ExportedFile {
  std::string name;     // without a folder
  std::string content;  // bytes
  std::size_t grasps = 0;
};

/// The files of one set: `<object>_<hand>.<ext>`; ACRONYM adds the mesh that it refers to. glTF has a file a grasp,
/// `<object>_<hand>_<grasp>.glb` when there are several. Poses are of `frame` in the object frame.
std::vector<ExportedFile> exportSet(const ExportedSet& exported, ExportFormat format, GraspFrame frame);

/// Poses X_OF of the grasps, in their order.
std::vector<Eigen::Isometry3d> framePoses(const ExportedSet& exported, GraspFrame frame, RootAxes axes);

// The formats, one file each (docs/exchange.md).

/// `meshName`: what /object/file says.
std::string acronymFile(const ExportedSet& exported, GraspFrame frame, const std::string& meshName);
std::string isaacText(const ExportedSet& exported, GraspFrame frame);
std::string moveitText(const ExportedSet& exported, GraspFrame frame);
/// The `index`-th of the found grasps as binary glTF 2.0.
std::string gltfFile(const ExportedSet& exported, std::size_t index);

/// A table with a header and a line a grasp: the columns of `query --format csv`. `poseName` begins the names of the
/// pose's columns.
std::string csvText(const std::vector<FoundSet>& sets, std::string_view poseName = "");

}  // namespace handhold
