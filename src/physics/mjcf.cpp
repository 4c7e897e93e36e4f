#include "physics/mjcf.h"

#include <fmt/format.h>

namespace handhold {
namespace {

using Eigen::Vector3d;

constexpr double kLinkDensity = 500;  // kg / m^3 of a link's bounding box: the drives' inertia outweighs it

std::string text(const Vector3d& v) { return fmt::format("{:.17g} {:.17g} {:.17g}", v.x(), v.y(), v.z()); }

std::string pose(const Eigen::Isometry3d& X) {
  const Eigen::Quaterniond q(X.linear());
  return fmt::format("pos=\"{}\" quat=\"{:.17g} {:.17g} {:.17g} {:.17g}\"", text(X.translation()), q.w(), q.x(), q.y(),
                     q.z());
}

/// A geom of each piece, its mesh of the same name.
std::string pieceGeoms(const std::string& name, const std::vector<ConvexPiece>& pieces, const std::string& attributes) {
  std::string geoms;
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    geoms += fmt::format("<geom type=\"mesh\" mesh=\"{}_{}\" {}/>\n", name, i, attributes);
  }
  return geoms;
}

std::string pieceMeshes(const std::string& name, const std::vector<ConvexPiece>& pieces) {
  std::string meshes;
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    meshes += fmt::format("<mesh name=\"{}_{}\" vertex=\"", name, i);
    for (const Vector3d& corner : pieces[i]) meshes += text(corner) + " ";
    meshes += "\"/>\n";
  }
  return meshes;
}

/// Writes the hand's links from one on, each inside its parent.
class HandBodies {
 public:
  HandBodies(const Hand& hand, const std::vector<Drive>& drives, const SceneShapes& shapes)
      : hand_(hand), shapes_(shapes), driveOf_(hand.joints.size(), nullptr) {
    for (const Drive& drive : drives) {
      driveOf_[drive.joint] = &drive;
      for (const auto& [joint, _] : drive.followers) driveOf_[joint] = &drive;
    }
  }

  std::string write(int index, bool isFree) const {
    const Link& link = hand_.links[index];
    const bool isRoot = link.parentLink < 0;
    const Joint* joint = link.joint >= 0 ? &hand_.joints[link.joint] : nullptr;
    const Eigen::Isometry3d X = isRoot ? Eigen::Isometry3d::Identity() : joint ? joint->X_PJ : link.X_PL;
    std::string body = fmt::format("<body name=\"link_{}\" {}>\n", index, pose(X));
    if (isFree) body += "<freejoint/>\n";
    if (joint != nullptr) {
      const Drive& drive = *driveOf_[link.joint];
      body += fmt::format(
          "<joint name=\"joint_{}\" type=\"{}\" axis=\"{}\" limited=\"true\" range=\"{:.17g} {:.17g}\" "
          "armature=\"{:.17g}\" damping=\"{:.17g}\"/>\n",
          link.joint, joint->type == JointType::revolute ? "hinge" : "slide", text(joint->axis), joint->lower,
          joint->upper, drive.armature, drive.damping);
    }
    const BroadShape& shape = shapes_.links[index];
    const bool hasPieces = !shapes_.linkPieces.empty();
    if (!shape.halfSize.isZero(0)) {  // with pieces it is there for its mass alone
      body +=
          fmt::format("<geom type=\"box\" pos=\"{}\" size=\"{}\" density=\"{}\" contype=\"{}\" conaffinity=\"0\"/>\n",
                      text(shape.center), text(shape.halfSize), kLinkDensity, hasPieces ? 0 : 1);
    }
    if (hasPieces) {
      body += pieceGeoms(fmt::format("link_{}", index), shapes_.linkPieces[index],
                         "mass=\"0\" contype=\"1\" conaffinity=\"0\"");
    }
    for (std::size_t child = 1; child < hand_.links.size(); ++child) {
      if (hand_.links[child].parentLink == index) body += write(static_cast<int>(child), false);
    }
    return body + "</body>\n";
  }

 private:
  const Hand& hand_;
  const SceneShapes& shapes_;
  std::vector<const Drive*> driveOf_;
};

std::string objectBody(const SceneShapes& shapes, const ObjectMass& mass) {
  const Eigen::Matrix3d& I = mass.inertia;
  const std::string inertial = fmt::format(
      "<body name=\"object\">\n<freejoint name=\"object\"/>\n<inertial pos=\"{}\" mass=\"{:.17g}\" "
      "fullinertia=\"{:.17g} {:.17g} {:.17g} {:.17g} {:.17g} {:.17g}\"/>\n",
      text(mass.centerOfMass), mass.mass, I(0, 0), I(1, 1), I(2, 2), I(0, 1), I(0, 2), I(1, 2));
  const BroadShape& shape = shapes.object;
  const std::string geoms =
      shapes.objectPieces.empty()
          ? fmt::format("<geom type=\"ellipsoid\" pos=\"{}\" size=\"{}\" contype=\"0\" conaffinity=\"1\"/>\n",
                        text(shape.center), text(Vector3d::Constant(shape.halfSize.norm())))
          : pieceGeoms("object", shapes.objectPieces, "contype=\"0\" conaffinity=\"1\"");
  return inertial + geoms + "</body>\n";
}

std::string actuators(const std::vector<Drive>& drives) {
  std::string result = "<actuator>\n";
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const Drive& drive = drives[i];
    result +=
        fmt::format("<position name=\"drive_{}\" joint=\"joint_{}\" kp=\"{:.17g}\"", i, drive.joint, drive.stiffness);
    if (drive.effort > 0)
      result += fmt::format(" forcelimited=\"true\" forcerange=\"{0:.17g} {1:.17g}\"", -drive.effort, drive.effort);
    result += "/>\n";
  }
  return result + "</actuator>\n";
}

std::string couplings(const Hand& hand, const std::vector<Drive>& drives) {
  std::string result;
  for (const Drive& drive : drives) {
    for (const auto& [joint, _] : drive.followers) {
      const Joint& follower = hand.joints[joint];
      result += fmt::format(
          "<joint joint1=\"joint_{}\" joint2=\"joint_{}\" polycoef=\"{:.17g} {:.17g} 0 0 0\" solref=\"0.008 1\"/>\n",
          joint, follower.mimicOf, follower.mimicOffset, follower.mimicMultiplier);
    }
  }
  return result;
}

}  // namespace

std::string graspMjcf(const Hand& hand, const std::vector<Drive>& drives, const SceneShapes& shapes,
                      const ObjectMass& mass, HandBase base, double tableHeight, const WorldSettings& settings) {
  const bool isCarried = base == HandBase::carried;
  std::string equalities = couplings(hand, drives);
  std::string bodies = HandBodies(hand, drives, shapes).write(0, isCarried) + objectBody(shapes, mass);
  if (isCarried) {
    bodies += "<body name=\"carrier\" mocap=\"true\"/>\n";
    bodies += fmt::format(
        "<geom name=\"table\" type=\"plane\" pos=\"0 0 {:.17g}\" size=\"1 1 1\" contype=\"1\" conaffinity=\"0\"/>\n",
        tableHeight);
    equalities += "<weld body1=\"carrier\" body2=\"link_0\" solref=\"0.008 1\" solimp=\"0.9 0.95 0.001 0.5 2\"/>\n";
  }
  std::string meshes = pieceMeshes("object", shapes.objectPieces);
  for (std::size_t i = 0; i < shapes.linkPieces.size(); ++i) {
    meshes += pieceMeshes(fmt::format("link_{}", i), shapes.linkPieces[i]);
  }
  return fmt::format(
             "<mujoco model=\"grasp\">\n<compiler angle=\"radian\" boundmass=\"0.001\" boundinertia=\"0.000001\"/>\n"
             "<option timestep=\"{:.17g}\" integrator=\"implicit\" cone=\"elliptic\" impratio=\"10\" "
             "noslip_iterations=\"2\" gravity=\"0 0 0\"/>\n<size nconmax=\"100\" njmax=\"400\"/>\n"
             "<default><geom condim=\"4\" friction=\"{:.17g} {:.17g} {:.17g}\" solref=\"0.005 1\" "
             "solimp=\"0.5 0.99 0.0001\"/></default>\n",
             settings.timeStep, settings.friction, settings.torsionFriction, settings.rollFriction) +
         "<asset>\n" + meshes + "</asset>\n<worldbody>\n" + bodies + "</worldbody>\n<equality>\n" + equalities +
         "</equality>\n" + actuators(drives) + "</mujoco>\n";
}

}  // namespace handhold
