// Reading hands: what is understood, and one test for each refusal with its words.

#include "hand/hand.h"

#include "core/yaml.h"
#include "hand/hand_files.h"
#include "mesh/files.h"
#include "mesh/primitives.h"
#include "mesh/shapes.h"

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <map>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;
using Eigen::Vector3d;
using std::numbers::pi;
using test::goodUrdf;
using test::indexOf;
using test::kGoodConfig;
using test::with;
using testing::HasSubstr;
using testing::StartsWith;
using testing::StrEq;
using testing::ThrowsMessage;

constexpr double kFloatTol = 1e-8;  // m: coordinates of 0.1 m as 32-bit floats

using LoadHand = test::HandFiles;

// ---- What is read ----------------------------------------------------------------------------------------------

TEST_F(LoadHand, GoodHand) {
  const Hand hand = load(goodUrdf());
  EXPECT_EQ(hand.name, "test_hand");
  EXPECT_EQ(hand.links.size(), 4U);
  EXPECT_EQ(hand.joints.size(), 3U);
  EXPECT_EQ(hand.links[0].name, "base");
  const Joint& slide = hand.joints[indexOf(hand.joints, "slide")];
  EXPECT_EQ(slide.type, JointType::prismatic);
  EXPECT_EQ(slide.upper, 0.04);
  EXPECT_EQ(slide.effort, 9);
  ASSERT_EQ(hand.preshapes.size(), 1U);
  EXPECT_EQ(hand.preshapes[0].standoff, 0.02);
  EXPECT_DOUBLE_EQ(hand.preshapes[0].jointPosition[indexOf(hand.joints, "bend_2")], 0.5 * 0.25 + 0.1);
  ASSERT_EQ(hand.closing.size(), 2U);
  EXPECT_EQ(hand.closing[0].breakawayJoint, indexOf(hand.joints, "bend_2"));
  EXPECT_EQ(hand.closing[1].breakawayJoint, -1);
  EXPECT_EQ(hand.closing[1].direction, -1);
  EXPECT_EQ(hand.configText, kGoodConfig);
  EXPECT_EQ(hand.urdfText, goodUrdf());
}

// Parents come before their children, whatever the order in the file and the alphabet.
TEST_F(LoadHand, ParentsComeFirst) {
  const Hand hand = load(goodUrdf());
  for (std::size_t i = 1; i < hand.links.size(); ++i) {
    EXPECT_GE(hand.links[i].parentLink, 0);
    EXPECT_LT(hand.links[i].parentLink, static_cast<int>(i));
  }
  for (const Joint& joint : hand.joints) EXPECT_LT(joint.parentLink, joint.childLink);
}

TEST_F(LoadHand, PathMayBeTheFolderOrTheFile) {
  const Hand hand = load(goodUrdf());
  EXPECT_EQ(loadHand(folder_.string() + "/").name, "test_hand");
  EXPECT_EQ(loadHand(folder_ / "hand.yaml").contentHash, hand.contentHash);
  EXPECT_EQ(loadHand(folder_ / "../test_hand/hand.yaml").contentHash, hand.contentHash);
}

// Palm frame: +z approach, +x closing, right-handed.
TEST_F(LoadHand, PalmFrame) {
  const Hand hand = load(goodUrdf(), with(kGoodConfig, "approach: [0, 0, 1], closing: [1, 0, 0]",
                                          "approach: [0, 2, 0], closing: [0, 0, -3]"));
  const Eigen::Matrix3d R = hand.X_LG.linear();
  EXPECT_TRUE(R.col(2).isApprox(Vector3d::UnitY()));
  EXPECT_TRUE(R.col(0).isApprox(-Vector3d::UnitZ()));
  EXPECT_NEAR(R.determinant(), 1, 1e-12);
  EXPECT_TRUE(hand.X_LG.translation().isApprox(Vector3d(0, 0, 0.01)));
}

TEST_F(LoadHand, TcpIsThePalmUnlessWritten) {
  EXPECT_EQ(load(goodUrdf()).p_LT, Vector3d(0, 0, 0.01));
  const Hand hand = load(goodUrdf(), kGoodConfig + "tcp: {link: slider, position: [0, 0, 0.12]}\n");
  EXPECT_EQ(hand.p_LT, Vector3d(0, 0, 0.12));
  EXPECT_EQ(hand.links[hand.tcpLink].name, "slider");
}

TEST_F(LoadHand, ContactLinks) {
  for (const Link& link : load(goodUrdf(), kGoodConfig + "contact_links: all\n").links) {
    EXPECT_TRUE(link.contactAllowed);
  }
  const Hand hand = load(goodUrdf(), kGoodConfig + "contact_links: [distal, proximal]\n");
  for (const Link& link : hand.links) {
    EXPECT_EQ(link.contactAllowed, link.name == "distal" || link.name == "proximal") << link.name;
  }
}

TEST_F(LoadHand, IgnoredLinksHaveNoGeometry) {
  const Hand hand = load(goodUrdf(), kGoodConfig + "ignore_links: [proximal]\n");
  for (const Link& link : hand.links) EXPECT_EQ(link.mesh.triangles.empty(), link.name == "proximal") << link.name;
}

// The subtree of a whole robot: poses are relative to its root, joints above it do not count.
TEST_F(LoadHand, SubtreeOfARobot) {
  const std::string robot = with(goodUrdf(), "</robot>",
                                 "<link name=\"arm\"/><link name=\"world\"/>" +
                                     test::revolute("wrist", "arm", "base", "<origin xyz=\"0 0 5\"/>") +
                                     test::revolute("shoulder", "world", "arm", "") + "</robot>");
  const Hand hand = load(robot);
  EXPECT_EQ(hand.links[0].name, "base");
  EXPECT_EQ(hand.links[0].joint, -1);
  EXPECT_EQ(hand.links.size(), 4U);
  EXPECT_EQ(indexOf(hand.joints, "wrist"), -1);
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(3);
  EXPECT_TRUE(
      forwardKinematics(hand, zero)[indexOf(hand.links, "proximal")].translation().isApprox(Vector3d(0.05, 0, 0.01)));
}

TEST_F(LoadHand, ContinuousJointHasNoLimits) {
  const std::string urdf =
      with(goodUrdf(), "type=\"revolute\"><parent link=\"base\"", "type=\"continuous\"><parent link=\"base\"");
  const Hand hand = load(urdf, with(kGoodConfig, "  - {joint: bend, direction: 1, breakaway: bend_2}\n", ""));
  EXPECT_EQ(hand.joints[indexOf(hand.joints, "bend")].upper, std::numeric_limits<double>::infinity());
  EXPECT_THAT(refusal(urdf),
              StrEq("hand.yaml:7: closing[0] closes the joint bend, which has no limit in that direction, "
                    "want one in the URDF"));
}

TEST_F(LoadHand, VisualStandsInForMissingCollision) {
  std::string urdf = goodUrdf();
  for (const char* tag : {"<collision>", "</collision>"}) {
    const std::string start = std::string(tag) == "<collision>" ? "<visual>" : "</visual>";
    urdf.replace(urdf.find(tag, urdf.find("name=\"slider\"")), std::string(tag).size(), start);
  }
  const Hand hand = load(urdf);
  EXPECT_EQ(hand.links[indexOf(hand.links, "slider")].mesh.triangles.size(), 12U);
  EXPECT_THAT(hand.notes, testing::Contains(StrEq("link slider has no <collision>: its <visual> is used")));
}

TEST_F(LoadHand, ContactModel) {
  const Hand silent = load(goodUrdf());
  EXPECT_EQ(silent.torsionRadius, 0);
  const Hand point = load(goodUrdf(), kGoodConfig + "contact: {model: point}\n");
  EXPECT_EQ(point.torsionRadius, 0);
  const Hand soft = load(goodUrdf(), kGoodConfig + "contact: {model: soft_finger, torsion_radius: 0.004}\n");
  EXPECT_EQ(soft.torsionRadius, 0.004);
  EXPECT_NE(soft.contentHash, silent.contentHash);
  EXPECT_NE(soft.contentHash,
            load(goodUrdf(), kGoodConfig + "contact: {model: soft_finger, torsion_radius: 0.005}\n").contentHash);
}

TEST_F(LoadHand, HashChangesWithEachText) {
  const std::string hash = load(goodUrdf()).contentHash;
  EXPECT_EQ(load(goodUrdf()).contentHash, hash);
  EXPECT_NE(load(goodUrdf() + " ").contentHash, hash);
  EXPECT_NE(load(goodUrdf(), kGoodConfig + "# note\n").contentHash, hash);
}

// ---- Mesh files ------------------------------------------------------------------------------------------------

class LoadHandMesh : public test::HandFiles {
 protected:
  LoadHandMesh() {
    for (const char* name : {"AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH"}) {
      if (const char* value = std::getenv(name)) before_[name] = value;
      ::unsetenv(name);
    }
  }
  ~LoadHandMesh() override {
    for (const char* name : {"AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH"}) {
      before_.count(name) > 0 ? ::setenv(name, before_[name].c_str(), 1) : ::unsetenv(name);
    }
  }

  /// The slider's box replaced by a mesh file.
  static std::string meshUrdf(const std::string& attributes) {
    return with(goodUrdf(), "<box size=\"0.01 0.01 0.01\"/>", "<mesh " + attributes + "/>");
  }
  static const Link& slider(const Hand& hand) { return hand.links[indexOf(hand.links, "slider")]; }
  static std::string cubeText() { return test::objText(test::box({1, 2, 3}, {2, 4, 6})); }

  std::map<std::string, std::string> before_;
};

TEST_F(LoadHandMesh, ScaleIsPerAxis) {
  write("meshes/box.obj", cubeText());
  const Hand hand = load(meshUrdf("filename=\"meshes/box.obj\" scale=\"0.01 0.02 0.001\""));
  const Eigen::AlignedBox3d box = boundingBox(slider(hand).mesh);
  EXPECT_TRUE(box.min().isApprox(Vector3d(0.01, 0.04, 0.003), 1e-6));
  EXPECT_TRUE(box.max().isApprox(Vector3d(0.02, 0.08, 0.006), 1e-6));
}

// A mirror image is not inside out.
TEST_F(LoadHandMesh, MirrorScaleKeepsTheOutsideOutside) {
  write("box.obj", cubeText());
  const Hand hand = load(meshUrdf("filename=\"box.obj\" scale=\"-0.01 0.01 0.01\""));
  EXPECT_NEAR(test::volume(slider(hand).mesh), 6e-6, 1e-10);
}

TEST_F(LoadHandMesh, OriginMovesTheMesh) {
  write("box.obj", cubeText());
  const std::string urdf = with(meshUrdf("filename=\"box.obj\" scale=\"0.01 0.01 0.01\""), "<geometry><mesh",
                                "<origin xyz=\"0.1 0 0\" rpy=\"0 0 1.5707963267948966\"/><geometry><mesh");
  const Eigen::AlignedBox3d box = boundingBox(slider(load(urdf)).mesh);
  EXPECT_TRUE(box.min().isApprox(Vector3d(0.06, 0.01, 0.03), 1e-6));
  EXPECT_TRUE(box.max().isApprox(Vector3d(0.08, 0.02, 0.06), 1e-6));
}

// Each connected part has its point: one inside an object does not collide with the surface.
TEST_F(LoadHandMesh, EveryPartHasAPiecePointOnItsSurface) {
  write("two.obj", test::objText(test::joined(test::box({0, 0, 0}, {1, 1, 1}), test::box({5, 5, 5}, {6, 6, 6}))));
  const Hand hand = load(meshUrdf("filename=\"two.obj\" scale=\"0.01 0.01 0.01\""));
  ASSERT_EQ(slider(hand).piecePoints.size(), 2U);
  const Eigen::AlignedBox3d first(Vector3d::Constant(-kFloatTol), Vector3d::Constant(0.01 + kFloatTol));
  EXPECT_NE(first.contains(slider(hand).piecePoints[0]), first.contains(slider(hand).piecePoints[1]));
}

TEST_F(LoadHandMesh, MissingFileIsNamed) {
  EXPECT_THAT(refusal(meshUrdf("filename=\"none.obj\"")),
              StrEq("test.urdf: link slider: mesh none.obj does not exist, want a mesh file"));
}

TEST_F(LoadHandMesh, BrokenFileIsNamed) {
  write("bad.stl", "solid x\nfacet normal");
  EXPECT_THAT(refusal(meshUrdf("filename=\"bad.stl\"")), StartsWith("bad.stl: "));
}

TEST_F(LoadHandMesh, UnknownSchemeIsRefused) {
  EXPECT_THAT(refusal(meshUrdf("filename=\"http://x/y.obj\"")),
              StrEq("test.urdf: mesh http://x/y.obj has an unknown scheme, want a path, file:// or package://"));
}

TEST_F(LoadHandMesh, FileSchemeIsAPath) {
  write("box.obj", cubeText());
  EXPECT_EQ(slider(load(meshUrdf("filename=\"file://" + (folder_ / "box.obj").string() + "\""))).mesh.triangles.size(),
            12U);
}

TEST_F(LoadHandMesh, PackageThatIsNowhereIsRefused) {
  EXPECT_THAT(refusal(meshUrdf("filename=\"package://gripper/meshes/box.obj\"")),
              StrEq("test.urdf: package://gripper/meshes/box.obj cannot be found (0 folders tried), want --package "
                    "gripper=DIR, or AMENT_PREFIX_PATH or ROS_PACKAGE_PATH to lead to it"));
  EXPECT_THAT(refusal(meshUrdf("filename=\"package://gripper/box.obj\""), kGoodConfig, {{"gripper", folder_ / "none"}}),
              HasSubstr("cannot be found (1 folder tried)"));
}

TEST_F(LoadHandMesh, PackageByTheCaller) {
  write("../elsewhere/meshes/box.obj", cubeText());
  const Hand hand =
      load(meshUrdf("filename=\"package://gripper/meshes/box.obj\""), kGoodConfig, {{"gripper", top_ / "elsewhere"}});
  EXPECT_EQ(slider(hand).mesh.triangles.size(), 12U);
}

TEST_F(LoadHandMesh, PackageByAmentPrefixPath) {
  write("../install/share/gripper/meshes/box.obj", cubeText());
  ::setenv("AMENT_PREFIX_PATH", ("/nowhere::" + (top_ / "install").string()).c_str(), 1);
  EXPECT_EQ(slider(load(meshUrdf("filename=\"package://gripper/meshes/box.obj\""))).mesh.triangles.size(), 12U);
}

// Either the folder of packages or the package itself.
TEST_F(LoadHandMesh, PackageByRosPackagePath) {
  write("../ros/gripper/meshes/box.obj", cubeText());
  for (const fs::path& path : {top_ / "ros", top_ / "ros/gripper"}) {
    ::setenv("ROS_PACKAGE_PATH", (path.string() + ":/nowhere").c_str(), 1);
    EXPECT_EQ(slider(load(meshUrdf("filename=\"package://gripper/meshes/box.obj\""))).mesh.triangles.size(), 12U);
  }
}

// A package checked out without ROS: the URDF stands somewhere inside it.
TEST_F(LoadHandMesh, PackageAboveTheUrdf) {
  write("meshes/box.obj", cubeText());
  EXPECT_EQ(slider(load(meshUrdf("filename=\"package://test_hand/meshes/box.obj\""))).mesh.triangles.size(), 12U);
}

// ---- Refusals: files -------------------------------------------------------------------------------------------

TEST_F(LoadHand, RefusesMissingFolder) {
  EXPECT_THAT([&] { loadHand(folder_ / "none"); },
              ThrowsMessage<InputError>(
                  StrEq((folder_ / "none").string() + ": does not exist, want a hand's folder with hand.yaml")));
}

TEST_F(LoadHand, RefusesFolderWithoutHandYaml) {
  EXPECT_THAT([&] { loadHand(folder_); },
              ThrowsMessage<InputError>(
                  StrEq((folder_ / "hand.yaml").string() + ": does not exist, want a hand's folder with hand.yaml")));
}

TEST_F(LoadHand, RefusesFolderThatIsNoName) {
  write("../bad name/test.urdf", goodUrdf());
  write("../bad name/hand.yaml", kGoodConfig);
  EXPECT_THAT([&] { loadHand(top_ / "bad name"); },
              ThrowsMessage<InputError>(HasSubstr("the hand's folder is \"bad name\", want 1 to 100 letters")));
}

TEST_F(LoadHand, RefusesUnknownKey) {
  EXPECT_THAT(configRefusal("root_link", "root"),
              StartsWith("hand.yaml:2: root is not a known key, want one of: urdf, root_link, palm"));
  EXPECT_THAT(configRefusal("standoff", "stand_off"),
              StartsWith("hand.yaml:5: preshapes[0].stand_off is not a known key"));
  EXPECT_THAT(configRefusal("breakaway", "break"), StartsWith("hand.yaml:7: closing[0].break is not a known key"));
  EXPECT_THAT(configRefusal("approach", "up"), StartsWith("hand.yaml:3: palm.up is not a known key"));
}

TEST_F(LoadHand, RefusesMissingKeys) {
  for (const char* key : {"urdf", "palm", "preshapes", "closing"}) {
    std::string config = "\n" + kGoodConfig;
    const std::size_t begin = config.find(fmt::format("\n{}:", key)) + 1;
    std::size_t end = config.find('\n', begin) + 1;
    while (config.substr(end, 2) == "  ") end = config.find('\n', end) + 1;
    EXPECT_THAT(refusal(goodUrdf(), config.erase(begin, end - begin)),
                StrEq(fmt::format("hand.yaml:2: the file has no key \"{}\", want one", key)));
  }
}

TEST_F(LoadHand, RefusesBadContactModels) {
  const auto said = [&](const std::string& value) {
    return refusal(goodUrdf(), kGoodConfig + "contact: " + value + "\n");
  };
  EXPECT_THAT(said("{model: rubber}"), StrEq("hand.yaml:9: contact.model is \"rubber\", want point or soft_finger"));
  EXPECT_THAT(said("{torsion_radius: 0.004}"), StrEq("hand.yaml:9: contact has no key \"model\", want one"));
  EXPECT_THAT(said("{model: soft_finger}"), StrEq("hand.yaml:9: contact has no key \"torsion_radius\", want one"));
  EXPECT_THAT(said("{model: point, torsion_radius: 0.004}"),
              StrEq("hand.yaml:9: contact.torsion_radius is given with model point, want it with soft_finger alone"));
  for (const char* number : {"0", "-0.004", "0.11", "4"}) {
    EXPECT_THAT(said(fmt::format("{{model: soft_finger, torsion_radius: {}}}", number)),
                StrEq(fmt::format("hand.yaml:9: contact.torsion_radius is \"{}\", want a number of metres > 0 and at "
                                  "most 0.1",
                                  number)));
  }
  for (const char* number : {"nan", "wide", "[0.004]"}) {
    EXPECT_THAT(said(fmt::format("{{model: soft_finger, torsion_radius: {}}}", number)),
                StartsWith("hand.yaml:9: contact.torsion_radius is "));
  }
  EXPECT_THAT(said("{model: soft_finger, radius: 0.004}"),
              StartsWith("hand.yaml:9: contact.radius is not a known key, want one of: model, torsion_radius"));
  EXPECT_THAT(said("soft_finger"), StartsWith("hand.yaml:9: contact is "));
}

TEST_F(LoadHand, RefusesMissingUrdf) {
  EXPECT_THAT(configRefusal("test.urdf", "none.urdf"),
              StrEq("hand.yaml:1: urdf is \"none.urdf\", want the path of a URDF file, relative to hand.yaml (looked "
                    "for none.urdf)"));
}

TEST_F(LoadHand, RefusesUnsetEnvironmentVariable) {
  ::unsetenv("HANDHOLD_TEST_NONE");
  EXPECT_THAT(configRefusal("test.urdf", "${HANDHOLD_TEST_NONE}/test.urdf"),
              HasSubstr("hand.yaml:1: ${HANDHOLD_TEST_NONE} is not set"));
}

TEST_F(LoadHand, RefusesXacroWithTheCommandThatConvertsIt) {
  write("gripper.urdf.xacro", goodUrdf());
  EXPECT_THAT(configRefusal("test.urdf", "gripper.urdf.xacro"),
              StrEq("gripper.urdf.xacro: is a xacro file, want plain URDF; convert it with: xacro gripper.urdf.xacro > "
                    "gripper.urdf"));
  write("gripper.xacro", goodUrdf());
  EXPECT_THAT(configRefusal("test.urdf", "gripper.xacro"), HasSubstr("xacro gripper.xacro > gripper.urdf"));
  const std::string space = "<robot xmlns:xacro=\"http://www.ros.org/wiki/xacro\" ";
  EXPECT_THAT(refusal(with(with(goodUrdf(), "<robot ", space), "</robot>", "<xacro:finger/></robot>")),
              StartsWith("test.urdf: is a xacro file, want plain URDF"));
  EXPECT_THAT(urdfRefusal("<robot ", space), StrEq("nothing was thrown"));  // what xacro wrote declares it still
}

TEST_F(LoadHand, RefusesMalformedXml) {
  EXPECT_THAT(urdfRefusal("</robot>", ""), StartsWith("test.urdf: is no valid URDF: "));
  EXPECT_THAT(refusal(""), StartsWith("test.urdf: is no valid URDF: "));
  EXPECT_THAT(refusal("<robot name=\"x\"></robot>"), StartsWith("test.urdf: is no valid URDF: "));
  EXPECT_THAT(refusal("<sdf/>"), StartsWith("test.urdf: is no valid URDF: "));
  EXPECT_THAT(refusal(goodUrdf().substr(0, 300)), StartsWith("test.urdf: is no valid URDF: "));
}

// Whatever is cut off or damaged, the answer is a hand or one line.
TEST_F(LoadHand, DamagedUrdfEndsInAHandOrARefusal) {
  const std::string good = goodUrdf();
  int refused = 0;
  for (std::size_t i = 0; i < good.size(); i += 7) {
    for (const std::string& text : {good.substr(0, i), with(good, good.substr(i, 1), "\""),
                                    good.substr(0, i) + good.substr(std::min(i + 5, good.size()))}) {
      const std::string message = refusal(text);
      if (message == "nothing was thrown") continue;
      ++refused;
      EXPECT_EQ(message.find('\n'), std::string::npos) << message;
    }
  }
  EXPECT_GT(refused, 100);
}

// ---- Refusals: joints ------------------------------------------------------------------------------------------

TEST_F(LoadHand, RefusesJointWithoutLimit) {
  EXPECT_THAT(urdfRefusal("<limit lower=\"0\" upper=\"0.04\" effort=\"9\" velocity=\"1\"/>", ""),
              testing::AllOf(StartsWith("test.urdf: "), HasSubstr("slide"), HasSubstr("limit")));
  EXPECT_THAT(urdfRefusal("<limit lower=\"-0.5\" upper=\"1.5\" effort=\"2\" velocity=\"1\"/>", ""),
              testing::AllOf(StartsWith("test.urdf: "), HasSubstr("bend"), HasSubstr("limit")));
}

TEST_F(LoadHand, RefusesLowerAboveUpper) {
  EXPECT_THAT(urdfRefusal("lower=\"0\" upper=\"0.04\"", "lower=\"0.05\" upper=\"0.04\""),
              StrEq("test.urdf: joint slide: lower limit 0.05 is above upper limit 0.04"));
}

TEST_F(LoadHand, RefusesPlanarAndFloatingJoints) {
  for (const char* type : {"planar", "floating"}) {
    EXPECT_THAT(
        urdfRefusal("\"prismatic\"", "\"" + std::string(type) + "\""),
        StrEq("test.urdf: joint slide is planar, floating or unknown, want fixed, revolute, continuous or prismatic"));
  }
}

TEST_F(LoadHand, RefusesZeroAxis) {
  EXPECT_THAT(urdfRefusal("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0 0\"/>"),
              StrEq("test.urdf: joint slide: axis is zero, want a direction"));
}

TEST_F(LoadHand, RefusesMimicOfAMissingJoint) {
  EXPECT_THAT(urdfRefusal("<mimic joint=\"bend\"", "<mimic joint=\"bent\""),
              StrEq("test.urdf: joint bend_2 mimics bent, which is no moving joint below the root link"));
}

TEST_F(LoadHand, RefusesMimicCycle) {
  EXPECT_THAT(urdfRefusal("<origin xyz=\"0.05 0 0.01\"/>", "<origin xyz=\"0.05 0 0.01\"/><mimic joint=\"bend_2\"/>"),
              testing::MatchesRegex("test.urdf: joint bend(_2)? mimics itself through others"));
  EXPECT_THAT(urdfRefusal("<mimic joint=\"bend\"", "<mimic joint=\"bend_2\""),
              StrEq("test.urdf: joint bend_2 mimics itself through others"));
}

TEST_F(LoadHand, RefusesGeometryWithoutSize) {
  EXPECT_THAT(urdfRefusal("0.04 0.01 0.01", "0.04 0 0.01"), StrEq("test.urdf: link proximal: box size is 0, want > 0"));
  EXPECT_THAT(urdfRefusal("<box size=\"0.01 0.01 0.01\"/>", "<sphere radius=\"-1\"/>"),
              StrEq("test.urdf: link slider: sphere radius is -1, want > 0"));
  EXPECT_THAT(urdfRefusal("<box size=\"0.01 0.01 0.01\"/>", "<cylinder radius=\"1\" length=\"0\"/>"),
              StrEq("test.urdf: link slider: cylinder length is 0, want > 0"));
}

// ---- Refusals: hand.yaml ---------------------------------------------------------------------------------------

TEST_F(LoadHand, RefusesMissingRootLink) {
  EXPECT_THAT(
      configRefusal("root_link: base", "root_link: wrist"),
      StrEq("test.urdf: has no link wrist to begin at (root_link), want one of: base, distal, proximal, slider"));
}

TEST_F(LoadHand, RefusesUnknownIgnoredLink) {
  EXPECT_THAT(refusal(goodUrdf(), kGoodConfig + "ignore_links: [thumb]\n"),
              StrEq("test.urdf: has no link thumb to ignore"));
}

TEST_F(LoadHand, RefusesUnknownPalmLink) {
  EXPECT_THAT(configRefusal("{link: base", "{link: palm"),
              StrEq("hand.yaml:3: palm.link is \"palm\", want a link of the hand: base, proximal, distal, slider"));
  EXPECT_THAT(refusal(goodUrdf(), kGoodConfig + "tcp: {link: tip, position: [0, 0, 0]}\n"),
              StartsWith("hand.yaml:9: tcp.link is \"tip\""));
  EXPECT_THAT(refusal(goodUrdf(), kGoodConfig + "contact_links: [tip]\n"),
              StartsWith("hand.yaml:9: contact_links[0] is \"tip\""));
  EXPECT_THAT(refusal(goodUrdf(), kGoodConfig + "contact_links: some\n"),
              StrEq("hand.yaml:9: contact_links is \"some\", want all, or a list of links"));
}

TEST_F(LoadHand, RefusesPalmAxesThatAreNotPerpendicular) {
  EXPECT_THAT(configRefusal("closing: [1, 0, 0]", "closing: [1, 0, 0.1]"),
              StrEq("hand.yaml:3: palm has approach and closing that are not perpendicular"));
  EXPECT_THAT(configRefusal("closing: [1, 0, 0]", "closing: [0, 0, 0]"),
              HasSubstr("hand.yaml:3: palm.closing is a list of 3, want a direction"));
}

TEST_F(LoadHand, RefusesPreshapeOutsideTheLimits) {
  EXPECT_THAT(configRefusal("bend: 0.25", "bend: 1.6"),
              StrEq("hand.yaml:5: preshapes[0] puts the joint bend at 1.6, want it within -0.5 .. 1.5"));
  // A joint that is not named stands at zero, which may be outside, too.
  EXPECT_THAT(refusal(with(goodUrdf(), "lower=\"0\" upper=\"0.04\"", "lower=\"0.02\" upper=\"0.04\""),
                      with(kGoodConfig, ", slide: 0.01", "")),
              StrEq("hand.yaml:5: preshapes[0] leaves the joint slide at 0, want it within 0.02 .. 0.04"));
  EXPECT_THAT(configRefusal("bend: 0.25", "bend: 1.5000005"), StrEq("nothing was thrown"));  // decimals of a limit
}

TEST_F(LoadHand, RefusesPreshapeThatPutsAMimicJointOutsideItsLimits) {
  // bend_2 = 0.5 bend + 0.1; a steeper coupling leads beyond its own limits.
  EXPECT_THAT(urdfRefusal("multiplier=\"0.5\"", "multiplier=\"50\""),
              HasSubstr("preshapes[0] puts the mimic joint bend_2 at 12.6, want it within"));
}

TEST_F(LoadHand, RefusesAJointClosedTwice) {
  EXPECT_THAT(configRefusal("{joint: slide", "{joint: bend"),
              StrEq("hand.yaml:8: closing[1].joint is \"bend\", want a joint that no other entry closes"));
}

TEST_F(LoadHand, RefusesPreshapeOfAMimicJoint) {
  EXPECT_THAT(
      configRefusal("bend: 0.25", "bend_2: 0.25"),
      StrEq("hand.yaml:5: preshapes[0].joints.bend_2 sets a mimic joint, want the joint that it follows: bend"));
}

TEST_F(LoadHand, RefusesPreshapeWithUnknownJoint) {
  EXPECT_THAT(configRefusal("bend: 0.25", "bent: 0.25"),
              StrEq("hand.yaml:5: preshapes[0].joints.bent names the joint \"bent\", want a moving joint of the hand: "
                    "bend, bend_2, slide"));
}

TEST_F(LoadHand, RefusesTwoPreshapesOfOneName) {
  EXPECT_THAT(configRefusal("closing:\n", "  - {name: open, joints: {}}\nclosing:\n"),
              StrEq("hand.yaml:6: preshapes[1].name is \"open\", want a name that no other preshape has"));
}

TEST_F(LoadHand, RefusesNegativeStandoffAndNoPreshape) {
  EXPECT_THAT(configRefusal("standoff: 0.02", "standoff: -0.02"),
              StrEq("hand.yaml:5: preshapes[0].standoff is \"-0.02\", want a number >= 0"));
  EXPECT_THAT(configRefusal("  - {name: open, joints: {bend: 0.25, slide: 0.01}, standoff: 0.02}\n", "  []\n"),
              HasSubstr("preshapes is a list of 0, want at least one preshape"));
}

TEST_F(LoadHand, RefusesClosingOfAMimicJoint) {
  EXPECT_THAT(configRefusal("{joint: bend, direction: 1, breakaway: bend_2}", "{joint: bend_2, direction: 1}"),
              StrEq("hand.yaml:7: closing[0].joint \"bend_2\" is a mimic joint, want the joint that it follows: bend"));
}

TEST_F(LoadHand, RefusesClosingOfAnUnknownJoint) {
  EXPECT_THAT(configRefusal("{joint: slide", "{joint: wrist"),
              StartsWith("hand.yaml:8: closing[1].joint names the joint \"wrist\""));
}

TEST_F(LoadHand, RefusesClosingDirectionsBut1) {
  EXPECT_THAT(configRefusal("direction: 1", "direction: 2"),
              StrEq("hand.yaml:7: closing[0].direction is \"2\", want a whole number from -1 to 1"));
  EXPECT_THAT(configRefusal("direction: 1", "direction: 0"),
              StrEq("hand.yaml:7: closing[0].direction is \"0\", want 1 or -1"));
}

TEST_F(LoadHand, RefusesEmptyClosing) {
  EXPECT_THAT(refusal(goodUrdf(), kGoodConfig.substr(0, kGoodConfig.find("closing:\n")) + "closing: []\n"),
              StrEq("hand.yaml:6: closing is a list of 0, want at least one joint that closes"));
}

TEST_F(LoadHand, RefusesBreakawayThatDoesNotFollow) {
  EXPECT_THAT(
      configRefusal("breakaway: bend_2", "breakaway: slide"),
      StrEq("hand.yaml:7: closing[0].breakaway is \"slide\", want a joint further out on the finger that mimics bend"));
  EXPECT_THAT(configRefusal("breakaway: bend_2", "breakaway: bend"),
              HasSubstr("want a joint further out on the finger"));
  EXPECT_THAT(configRefusal("breakaway: bend_2", "breakaway: tip"),
              HasSubstr("closing[0].breakaway names the joint \"tip\""));
  // It follows, but on another finger.
  const std::string urdf =
      with(goodUrdf(), "<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0 1\"/><mimic joint=\"bend\" multiplier=\"0.01\"/>");
  const std::string config = with(with(kGoodConfig, ", slide: 0.01", ""), "  - {joint: slide, direction: -1}\n", "");
  EXPECT_THAT(refusal(urdf, with(config, "breakaway: bend_2", "breakaway: slide")),
              HasSubstr("want a joint further out on the finger"));
}

// A pair of coupled jaws, or a single joint; a finger with a clutch cannot centre itself.
TEST_F(LoadHand, SelfCenteringRules) {
  const char* wanted = "is self_centering, want a joint without mimics, or a prismatic one with one prismatic mimic";
  EXPECT_THAT(configRefusal("breakaway: bend_2", "self_centering: true"),
              StartsWith(std::string("hand.yaml:7: closing[0] ") + wanted));
  EXPECT_THAT(configRefusal("direction: -1", "direction: -1, self_centering: true"), StrEq("nothing was thrown"));
  EXPECT_THAT(configRefusal("direction: -1", "direction: -1, self_centering: 1"), HasSubstr("want true or false"));
  const auto jaws = [](const std::string& multiplier) {
    return with(
        goodUrdf(), "</robot>",
        test::boxLink("jaw", "0.01 0.01 0.01") +
            "<joint name=\"jaw_2\" type=\"prismatic\"><parent link=\"base\"/><child link=\"jaw\"/><axis xyz=\"1 0 0\"/>"
            "<limit lower=\"-1\" upper=\"1\" effort=\"1\" velocity=\"1\"/><mimic joint=\"slide\" multiplier=\"" +
            multiplier + "\"/></joint></robot>");
  };
  const std::string config = with(kGoodConfig, "direction: -1", "direction: -1, self_centering: true");
  EXPECT_TRUE(load(jaws("1"), config).closing[1].selfCentering);
  EXPECT_TRUE(load(jaws("-1"), config).closing[1].selfCentering);
  EXPECT_THAT(refusal(jaws("0.5"), config), HasSubstr(wanted));
}

TEST_F(LoadHand, RefusesHandWithoutGeometry) {
  EXPECT_THAT(refusal(goodUrdf(), kGoodConfig + "ignore_links: [base, proximal, distal, slider]\n"),
              StrEq("hand.yaml:1: the file describes a hand without any geometry that may touch"));
  EXPECT_THAT(refusal(goodUrdf(), kGoodConfig + "ignore_links: [distal]\ncontact_links: [distal]\n"),
              HasSubstr("without any geometry that may touch"));
}

// ---- hand --init -----------------------------------------------------------------------------------------------

TEST_F(LoadHand, InitialConfigIsAHandOnceThePalmIsSet) {
  write("test.urdf", goodUrdf());
  const std::string config = initialHandConfig(folder_ / "test.urdf");
  const YamlValue top = YamlValue::parseText(config, "hand.yaml");
  EXPECT_EQ(top.require("urdf").text(), "test.urdf");
  EXPECT_EQ(top.require("closing").items().size(), 2U);
  const Hand hand = load(goodUrdf(), config);
  EXPECT_EQ(hand.links[hand.palmLink].name, "base");
  EXPECT_EQ(hand.closing.size(), 2U);
}

// Zero may be outside the limits, or there may be none.
TEST_F(LoadHand, InitialConfigRespectsLimits) {
  const std::string urdf = with(goodUrdf(), "lower=\"0\" upper=\"0.04\"", "lower=\"-0.04\" upper=\"-0.01\"");
  write("test.urdf", urdf);
  const Hand hand = load(urdf, initialHandConfig(folder_ / "test.urdf"));
  for (const Preshape& preshape : hand.preshapes) {
    EXPECT_LE(preshape.jointPosition[indexOf(hand.joints, "slide")], -0.01);
    EXPECT_GE(preshape.jointPosition[indexOf(hand.joints, "slide")], -0.04);
  }
  EXPECT_THAT([&] { initialHandConfig(folder_ / "none.urdf"); },
              ThrowsMessage<InputError>(HasSubstr("none.urdf: cannot be read")));
}

// ---- Primitives ------------------------------------------------------------------------------------------------

struct Primitive {
  const char* name;
  TriangleMesh mesh;
  double volume;     // m^3, of the true shape
  double roundness;  // m^2, area that bends; the triangles lie within kChordError below it
};

std::vector<Primitive> primitives() {
  std::vector<Primitive> result = {{"box", boxMesh({0.1, 0.02, 0.3}), 0.1 * 0.02 * 0.3, 0}};
  for (const double r : {1e-5, 0.001, 0.0095, 0.05, 0.3}) {
    result.push_back({"cylinder", cylinderMesh(r, 0.07), pi * r * r * 0.07, 2 * pi * r * 0.07});
    result.push_back({"sphere", sphereMesh(r), 4.0 / 3 * pi * r * r * r, 4 * pi * r * r});
  }
  return result;
}

TEST(Primitives, AreClosedAndOutward) {
  for (const Primitive& p : primitives()) {
    SCOPED_TRACE(fmt::format("{} {}", p.name, p.volume));
    EXPECT_TRUE(isWatertight(p.mesh));
    const double volume = test::volume(p.mesh);
    EXPECT_LE(volume, p.volume * (1 + 1e-12));
    EXPECT_GE(volume, p.volume - kChordError * p.roundness);
    for (std::size_t i = 0; i < p.mesh.triangles.size(); ++i) {
      const auto [a, b, c] = p.mesh.corners(i);
      ASSERT_GT((b - a).cross(c - a).norm(), 0);
      ASSERT_GT(p.mesh.normal(i).dot(a), 0) << "triangle " << i;  // convex about the origin
    }
  }
}

// Vertices lie on the true surface, and no triangle is deeper below it than the bound.
TEST(Primitives, ChordErrorHolds) {
  for (const double radius : {1e-4, 0.001, 0.0095, 0.0123, 0.05, 0.3}) {
    SCOPED_TRACE(radius);
    for (const bool isSphere : {true, false}) {
      const TriangleMesh mesh = isSphere ? sphereMesh(radius) : cylinderMesh(radius, 0.07);
      const auto distance = [&](const Vector3d& p) { return isSphere ? p.norm() : p.head<2>().norm(); };
      double deepest = radius;
      for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
        const auto corners = mesh.corners(i);
        if (!isSphere && std::abs(mesh.normal(i).z()) > 0.5) continue;  // the flat ends
        constexpr int kSteps = 8;
        for (int u = 0; u <= kSteps; ++u) {
          for (int v = 0; u + v <= kSteps; ++v) {
            deepest =
                std::min(deepest, distance((u * corners[0] + v * corners[1] + (kSteps - u - v) * corners[2]) / kSteps));
          }
        }
        for (const auto& corner : corners) ASSERT_NEAR(distance(corner), radius, 1e-12);
      }
      EXPECT_LE(radius - deepest, kChordError * (1 + 1e-9)) << (isSphere ? "sphere" : "cylinder");
    }
  }
}

}  // namespace
}  // namespace handhold
