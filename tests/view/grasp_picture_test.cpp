#include "view/grasp_picture.h"

#include "core/error.h"
#include "hand/hand.h"
#include "mesh/primitives.h"

#include <algorithm>

#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

const Hand& barrett() {
  static const Hand hand = loadHand(HANDHOLD_SOURCE_DIR "/hands/barrett");
  return hand;
}

/// A hand pose that no axis is special in.
Isometry3d madeUpPose() {
  Isometry3d X_OH = Isometry3d::Identity();
  X_OH.rotate(Eigen::AngleAxisd(2.8, Vector3d(1, 0.2, -0.1).normalized()));
  X_OH.translation() = Vector3d(0.01, 0.02, 0.2);
  return X_OH;
}

/// One made-up grasp: the Barrett hand's first preshape around a sphere, touched at two points.
GraspSet madeUpSet() {
  GraspSet set;
  set.object = "ball";
  set.hand = "barrett";
  set.objectMesh = sphereMesh(0.04);
  set.urdf = barrett().urdfText;
  for (const Joint& joint : barrett().joints) set.jointNames.push_back(joint.name);
  for (const Link& link : barrett().links) {
    set.linkNames.push_back(link.name);
    set.linkMeshes.push_back(link.mesh);
  }
  const Isometry3d X_OH = madeUpPose();
  const Eigen::Quaterniond q(X_OH.linear());
  for (const double number : X_OH.translation()) set.handPose.push_back(number);
  for (const double number : q.coeffs()) set.handPose.push_back(number);
  for (const double number : barrett().preshapes[0].jointPosition)
    set.jointPosition.push_back(static_cast<float>(number));
  set.approachDirection = {0, 0, -1};
  set.epsilon = {0.1};
  set.contactPosition = {0.04F, 0, 0, 0, -0.04F, 0};
  set.contactNormal = {-1, 0, 0, 0, 1, 0};
  set.contactLink = {static_cast<std::uint16_t>(set.linkNames.size() - 1), 0};
  set.contactBegin = {0, 2};
  return set;
}

RenderSettings thumbnail() {
  RenderSettings settings;
  settings.width = 64;
  settings.height = 48;
  return settings;
}

// Object, links where kinematics puts them, then a sphere and a cone for each contact.
TEST(GraspScene, PartsStandWhereTheRecordSays) {
  constexpr double kStoredAsFloat = 1e-6;  // joint positions
  const GraspSet set = madeUpSet();
  const std::vector<ScenePart> scene = graspScene(set, 0);
  const auto X_HL = forwardKinematics(barrett(), barrett().preshapes[0].jointPosition);
  std::size_t part = 1;
  for (std::size_t i = 0; i < X_HL.size(); ++i) {
    if (set.linkMeshes[i].triangles.empty()) continue;
    EXPECT_LT((scene[part++].X_W.matrix() - (madeUpPose() * X_HL[i]).matrix()).norm(), kStoredAsFloat)
        << set.linkNames[i];
  }
  ASSERT_EQ(scene.size(), part + 4);
  EXPECT_TRUE(std::all_of(scene.begin() + part, scene.end(), [](const ScenePart& p) { return p.isMark; }));
  EXPECT_LT((scene[part].X_W.translation() - Vector3d(0.04, 0, 0)).norm(), kStoredAsFloat);
  // The cone's tip is the contact, and the cone comes from outside, along the normal.
  const ScenePart& cone = scene[part + 3];
  EXPECT_LT((cone.X_W * Vector3d::Zero() - Vector3d(0, -0.04, 0)).norm(), kStoredAsFloat);
  EXPECT_LT((cone.X_W.linear() * Vector3d::UnitZ() - Vector3d(0, 1, 0)).norm(), kStoredAsFloat);
  EXPECT_LT((cone.X_W * cone.mesh.vertices[1]).y(), -0.04);
}

// The object is warm, the hand cool; touching links stand out from the others.
TEST(GraspScene, Colours) {
  const std::vector<ScenePart> scene = graspScene(madeUpSet(), 0);
  EXPECT_GT(scene[0].colour[0], scene[0].colour[2]);
  for (std::size_t i = 1; i < scene.size() - 4; ++i) EXPECT_LE(scene[i].colour[0], scene[i].colour[2]);
  EXPECT_NE(scene[scene.size() - 5].colour, scene[scene.size() - 6].colour);
}

// The view is from above, and from the side where an open contact is, not through the object.
TEST(GraspView, SeesTheContacts) {
  const GraspSet set = madeUpSet();
  const Vector3d toEye = graspView(set, 0, graspScene(set, 0));
  EXPECT_NEAR(toEye.norm(), 1, 1e-12);
  EXPECT_GT(toEye.z(), 0);
  EXPECT_GT(toEye.dot(Vector3d(1, -1, 0)), 0);
}

TEST(GraspPicture, SamePictureTwice) {
  const GraspSet set = madeUpSet();
  const Image a = graspPicture(set, 0, thumbnail()), b = graspPicture(set, 0, thumbnail());
  EXPECT_EQ(a.rgb.size(), 3U * 64 * 48);
  EXPECT_EQ(a.rgb, b.rgb);
}

void expectRefusal(const GraspSet& set, std::size_t grasp, const std::string& message) {
  try {
    graspScene(set, grasp);
    ADD_FAILURE() << "accepted";
  } catch (const InputError& error) {
    EXPECT_EQ(error.what(), message);
  }
}

TEST(GraspPicture, RefusesAGraspThatIsNotThere) {
  GraspSet set = madeUpSet();
  expectRefusal(set, 1, "grasp 1 does not exist, the set of ball and barrett holds 1: want 0 to 0");
  set.epsilon.clear();
  expectRefusal(set, 0, "the set of ball and barrett holds no grasp, want one that does");
}

}  // namespace
}  // namespace handhold
