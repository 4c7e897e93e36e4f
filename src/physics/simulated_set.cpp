#include "physics/simulated_set.h"

#include "build/stored_set.h"
#include "core/error.h"
#include "core/file.h"
#include "core/yaml.h"
#include "store/database.h"

namespace handhold {

namespace fs = std::filesystem;

double catalogMass(const std::string& jobText, const std::string& object) {
  try {
    const YamlValue job = YamlValue::parseText(jobText, "the stored job");
    const YamlValue* catalog = job.find("catalog");
    if (catalog == nullptr) return 0;
    for (const YamlValue& entry : catalog->items()) {
      const YamlValue* mass = entry.find("mass");
      if (mass == nullptr) continue;
      const YamlValue *name = entry.find("name"), *mesh = entry.find("mesh"), *glob = entry.find("glob");
      const bool isIt = mesh != nullptr
                            ? (name != nullptr ? name->text() : fs::path(mesh->text()).stem().string()) == object
                            : glob != nullptr && matchesGlob(object, fs::path(glob->text()).stem().string());
      if (isIt) return mass->positiveNumber();
    }
  } catch (const InputError&) {  // an imported set's job is no job file
  }
  return 0;
}

SimulatedSet::SimulatedSet(GraspSet set, const Hand& hand, LinkSolids links, std::shared_ptr<const Solid> object,
                           const std::optional<double>& friction)
    : set_(std::move(set)),
      mass_(catalogMass(set_.job, set_.object)),
      shapeError_(surfaceError(*object)),
      properties_(massProperties(set_.objectMesh, isWatertight(set_.objectMesh))),
      links_(std::move(links)),
      object_(std::move(object)) {
  settings_.world.friction = friction.value_or(kFrictionRatio * set_.friction);
  model_ = std::make_unique<PhysicsModel>(hand, links_, object_, properties_, mass_, settings_);
}

std::size_t SimulatedSet::makePieces() {
  std::vector<ConvexPiece> pieces = convexPieces(set_.objectMesh);
  const std::size_t count = pieces.size();
  pieceModel_ =
      std::make_unique<PhysicsModel>(model_->hand(), links_, object_, properties_, mass_, settings_, std::move(pieces));
  return count;
}

GraspPosture SimulatedSet::posture(std::size_t row) const {
  const auto nJoints = static_cast<Eigen::Index>(set_.jointNames.size());
  const auto joints = [&](const std::vector<float>& values) -> Eigen::VectorXd {
    return Eigen::Map<const Eigen::VectorXf>(values.data() + row * set_.jointNames.size(), nJoints).cast<double>();
  };
  const auto vectorAt = [](const std::vector<float>& values, std::size_t i) -> Eigen::Vector3d {
    return Eigen::Vector3f(values.data() + 3 * i).cast<double>();
  };
  GraspPosture posture{set_.X_OH(row), joints(set_.preshapeJointPosition), joints(set_.jointPosition), {}};
  for (std::size_t i = set_.contactBegin[row]; i < set_.contactBegin[row + 1]; ++i) {
    posture.contacts.push_back(
        {vectorAt(set_.contactPosition, i), vectorAt(set_.contactNormal, i), set_.contactLink[i]});
  }
  return posture;
}

std::unique_ptr<SimulatedSet> SetLoader::load(const fs::path& path) {
  GraspSet set = readGraspSet(path);
  const Hand hand = storedHand(set);
  LinkSolids& links = links_[hand.contentHash];
  if (links.empty()) links = linkSolids(hand);
  if (!object_ || objectMesh_.vertices != set.objectMesh.vertices ||
      objectMesh_.triangles != set.objectMesh.triangles) {
    objectMesh_ = set.objectMesh;
    object_ = std::make_shared<Solid>(objectSolid(objectMesh_));
  }
  return std::make_unique<SimulatedSet>(std::move(set), hand, links, object_, friction_);
}

}  // namespace handhold
