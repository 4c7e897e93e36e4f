#pragma once

// Private to this library: where each member of a GraspSet lies in its file. db/FORMAT.md describes it for people; the
// writer, the reader and firstDifference go through the lists below, so that none of them can forget a member.

#include "store/grasp_set.h"
#include "store/hdf5_file.h"

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <map>
#include <string>
#include <string_view>

namespace handhold {

/// Rises when a reader of the former version would misread the file; db/FORMAT.md has the policy.
inline constexpr int kFormatVersion = 1;
/// Bytes before HDF5's own: text that says what the file is, and the checksum.
inline constexpr std::size_t kBlockBytes = 512;
inline constexpr std::string_view kMagic = "HANDHOLD GRASP SET\n";

/// The first 512 bytes. They repeat some attributes so that unchanged sets are found without reading the rest.
struct SetBlock {
  std::string object, hand;
  int setVersion = 0;
  std::string inputHash;
  std::size_t bytes = 0;  // from byte 512 to the end
  std::string checksum;   // XXH3-128 of these bytes, 32 hexadecimal digits
};

/// The block as text lines, the last one a hash of the others, padded with zeros to 512 bytes.
std::string encodeBlock(const SetBlock& block);
/// The whole file. The set must have passed checkGraspSet.
std::string encodeGraspSet(const GraspSet& set);
/// Throws InputError `WHERE: ...` for the first array whose length, index, order or number contradicts the others.
void checkGraspSet(const GraspSet& set, std::string_view where);
/// The same for what readGraspTable reads.
void checkGraspTable(const GraspSet& set, std::string_view where);
/// The rows of /grasps, the attributes of / and the names that the rows refer to, after the checksum of the whole file.
/// The other arrays stay empty. Throws InputError as readGraspSet does.
GraspSet readGraspTable(const std::filesystem::path& path);

/// Lengths of the arrays by the symbols of db/FORMAT.md. Digits stand for themselves, '+' for n + 1.
using Sizes = std::map<char, std::size_t>;
Sizes sizesOf(const GraspSet& set);

/// Arrays of /grasps that older sets do not have: NaN in every row then. A row may have NaN in newer ones too.
inline constexpr std::string_view kLaterArrays[] = {
    "/grasps/epsilon_lower", "/grasps/epsilon_upper",    "/grasps/critical_friction", "/grasps/load_margin",
    "/grasps/robustness",    "/grasps/robustness_lower", "/grasps/robustness_upper"};
inline bool isLaterArray(std::string_view path) {
  return std::find(std::begin(kLaterArrays), std::end(kLaterArrays), path) != std::end(kLaterArrays);
}

/// visit(PATH, MEMBER, SYMBOLS) for every array of numbers but the meshes and /timings.
template <class Visit>
void forEachArray(const Visit& visit) {
  visit("/samples/point", &GraspSet::samplePoint, "N3");
  visit("/samples/normal", &GraspSet::sampleNormal, "N3");
  visit("/trials/outcome", &GraspSet::outcome, "NRM");
  visit("/trials/epsilon", &GraspSet::trialEpsilon, "NRM");
  visit("/grasps/trial", &GraspSet::trial, "n3");
  visit("/grasps/target_point", &GraspSet::targetPoint, "n3");
  visit("/grasps/approach_direction", &GraspSet::approachDirection, "n3");
  visit("/grasps/roll", &GraspSet::roll, "n");
  visit("/grasps/hand_pose", &GraspSet::handPose, "n7");
  visit("/grasps/joint_position", &GraspSet::jointPosition, "nJ");
  visit("/grasps/preshape_joint_position", &GraspSet::preshapeJointPosition, "nJ");
  visit("/grasps/epsilon", &GraspSet::epsilon, "n");
  visit("/grasps/backoff", &GraspSet::backoff, "n");
  visit("/grasps/approach_clear", &GraspSet::approachClear, "n");
  visit("/grasps/epsilon_lower", &GraspSet::epsilonLower, "n");
  visit("/grasps/epsilon_upper", &GraspSet::epsilonUpper, "n");
  visit("/grasps/critical_friction", &GraspSet::criticalFriction, "n");
  visit("/grasps/load_margin", &GraspSet::loadMargin, "n");
  visit("/grasps/robustness", &GraspSet::robustness, "n");
  visit("/grasps/robustness_lower", &GraspSet::robustnessLower, "n");
  visit("/grasps/robustness_upper", &GraspSet::robustnessUpper, "n");
  visit("/grasps/contact_begin", &GraspSet::contactBegin, "+");
  visit("/contacts/position", &GraspSet::contactPosition, "C3");
  visit("/contacts/normal", &GraspSet::contactNormal, "C3");
  visit("/contacts/link", &GraspSet::contactLink, "C");
  visit("/distance_map/point", &GraspSet::mapPoint, "S3");
  visit("/distance_map/normal", &GraspSet::mapNormal, "S3");
  visit("/distance_map/neighbor", &GraspSet::mapNeighbor, "nk");
  visit("/distance_map/weight", &GraspSet::mapWeight, "nk");
}

/// visit(PATH, MEMBER) for every list of texts but the attribute `names` of /trials/outcome.
template <class Visit>
void forEachTexts(const Visit& visit) {
  visit("/object/notes", &GraspSet::objectNotes);
  visit("/hand/joint_names", &GraspSet::jointNames);
  visit("/hand/link_names", &GraspSet::linkNames);
  visit("/hand/preshape_names", &GraspSet::preshapeNames);
}

/// visit(PATH, MEMBER) for every single text that is a dataset.
template <class Visit>
void forEachText(const Visit& visit) {
  visit("/hand/urdf", &GraspSet::urdf);
  visit("/hand/config", &GraspSet::config);
}

/// Attributes of / that older sets do not have: the member keeps its default.
inline constexpr std::string_view kLaterAttributes[] = {"method_version", "torsion_radius", "robustness_trials",
                                                        "robustness_position", "robustness_rotation"};
inline bool isLaterAttribute(std::string_view name) {
  return std::find(std::begin(kLaterAttributes), std::end(kLaterAttributes), name) != std::end(kLaterAttributes);
}

/// visit(NAME, MEMBER) for every attribute of / but format_version.
template <class Visit>
void forEachRootAttribute(const Visit& visit) {
  visit("object", &GraspSet::object);
  visit("hand", &GraspSet::hand);
  visit("set_version", &GraspSet::setVersion);
  visit("input_hash", &GraspSet::inputHash);
  visit("generator", &GraspSet::generator);
  visit("method_version", &GraspSet::methodVersion);
  visit("job", &GraspSet::job);
  visit("policy", &GraspSet::policy);
  visit("seed", &GraspSet::seed);
  visit("friction", &GraspSet::friction);
  visit("cone_edges", &GraspSet::coneEdges);
  visit("contact_distance", &GraspSet::contactDistance);
  visit("torque_scale", &GraspSet::torqueScale);
  visit("torsion_radius", &GraspSet::torsionRadius);
  visit("robustness_trials", &GraspSet::robustnessTrials);
  visit("robustness_position", &GraspSet::robustnessPosition);
  visit("robustness_rotation", &GraspSet::robustnessRotation);
  visit("pitch", &GraspSet::pitch);
  visit("map_pitch", &GraspSet::mapPitch);
}

/// `/hand/links/NAME`, where '%' of the link's name is %25, '/' is %2F and a name of one dot is %2E: HDF5 gives both a
/// meaning of their own. Different names stay different.
std::string linkFolder(std::string_view linkName);

}  // namespace handhold
