#include "physics/grasp_physics.h"

#include "core/error.h"
#include "quality/force_closure.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>
#include <numbers>

#include <fmt/format.h>
#include <mujoco/mujoco.h>

namespace handhold {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using Matrix3Row = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

constexpr std::size_t kContactsPerLink = 4;
constexpr double kWatchSeconds = 0.02;

struct DeleteModel {
  void operator()(mjModel* model) const { mj_deleteModel(model); }
};
struct DeleteData {
  void operator()(mjData* data) const { mj_deleteData(data); }
};

/// What the collision function needs beside the engine's own; set while a thread simulates. Without it nothing touches:
/// MuJoCo's compiler makes a step of its own.
struct CollisionWorld {
  const Solid* object = nullptr;
  std::vector<const Solid*> solidOfGeom;  // of the links; null for other geoms
  std::vector<TouchFinder> finderOfGeom;
};
thread_local CollisionWorld* collisionWorld = nullptr;

Isometry3d poseOf(const double* position, const double* rotation) {
  Isometry3d X;
  X.translation() = Eigen::Map<const Vector3d>(position);
  X.linear() = Eigen::Map<const Matrix3Row>(rotation);
  return X;
}

Isometry3d bodyPose(const mjData& data, int body) { return poseOf(data.xpos + 3 * body, data.xmat + 9 * body); }

int writeContacts(const std::vector<Touch>& touches, const Isometry3d& X_WO, double turn, mjContact* contacts) {
  for (std::size_t i = 0; i < touches.size(); ++i) {
    const Vector3d position = X_WO * touches[i].position, normal = X_WO.linear() * (turn * touches[i].normal);
    contacts[i].dist = touches[i].distance;
    mju_copy3(contacts[i].pos, position.data());
    mju_copy3(contacts[i].frame, normal.data());
    mju_zero3(contacts[i].frame + 3);
  }
  return static_cast<int>(touches.size());
}

/// In the place of MuJoCo's ellipsoid against box: the object (geom a) against a link (geom b). The engine completes
/// frames and friction.
int collideLink(const mjModel* model, const mjData* data, mjContact* contacts, int a, int b, mjtNum margin) {
  thread_local std::vector<Touch> touches;
  if (collisionWorld == nullptr) return 0;
  CollisionWorld& world = *collisionWorld;
  const Isometry3d X_WO = bodyPose(*data, model->geom_bodyid[a]);
  const Isometry3d X_OL = X_WO.inverse() * bodyPose(*data, model->geom_bodyid[b]);
  world.finderOfGeom[b].find(*world.object, *world.solidOfGeom[b], X_OL, margin, touches);
  keepSpread(touches, kContactsPerLink);
  return writeContacts(touches, X_WO, 1, contacts);
}

/// In the place of plane against ellipsoid: the table (geom a) against the object's surface points.
int collideTable(const mjModel* model, const mjData* data, mjContact* contacts, int a, int b, mjtNum margin) {
  thread_local std::vector<Touch> touches;
  if (collisionWorld == nullptr) return 0;
  touches.clear();
  const Isometry3d X_WO = bodyPose(*data, model->geom_bodyid[b]);
  const Isometry3d X_OT = X_WO.inverse() * poseOf(data->geom_xpos + 3 * a, data->geom_xmat + 9 * a);
  const Vector3d up = X_OT.linear().col(2);
  for (const SurfacePoints::Point& point : collisionWorld->object->points.points()) {
    const double height = up.dot(point.position - X_OT.translation());
    if (height < margin) touches.push_back({point.position - height / 2 * up, up, height});
  }
  keepSpread(touches, kContactsPerLink);
  return writeContacts(touches, X_WO, 1, contacts);
}

void ignoreWarning(const char*) {}

/// MuJoCo's tables and handlers are one a process.
void prepareMujoco() {
  static std::once_flag once;
  std::call_once(once, [] {
    mjCOLLISIONFUNC[mjGEOM_ELLIPSOID][mjGEOM_BOX] = collideLink;
    mjCOLLISIONFUNC[mjGEOM_PLANE][mjGEOM_ELLIPSOID] = collideTable;
    mju_user_warning = ignoreWarning;  // they are counted in mjData, the default writes a file
  });
}

std::unique_ptr<mjModel, DeleteModel> loadModel(const std::string& text) {
  static std::mutex mutex;  // guards the parser and the file system below
  static mjVFS files;       // some megabytes
  const std::lock_guard lock(mutex);
  mj_defaultVFS(&files);
  if (mj_makeEmptyFileVFS(&files, "grasp.xml", static_cast<int>(text.size())) != 0) {
    throw SystemError("MuJoCo has no room for the model");
  }
  std::memcpy(files.filedata[0], text.data(), text.size());
  char error[500] = "";
  collisionWorld = nullptr;
  mjModel* model = mj_loadXML("grasp.xml", &files, error, sizeof error);
  mj_deleteVFS(&files);
  if (model == nullptr) throw SystemError(fmt::format("MuJoCo cannot load the model: {}", error));
  return std::unique_ptr<mjModel, DeleteModel>(model);
}

int idOf(const mjModel& model, mjtObj kind, const std::string& name) { return mj_name2id(&model, kind, name.c_str()); }

double turnBetween(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  return 2 * std::acos(std::min(1.0, std::abs(a.dot(b))));
}

}  // namespace

std::string mujocoVersion() {
  const int version = mj_version();
  return fmt::format("{}.{}.{}", version / 100, version / 10 % 10, version % 10);
}

bool isHeld(const TestResult& result) {
  return std::all_of(result.directions.begin(), result.directions.end(),
                     [](const DirectionResult& each) { return each.outcome == PhysicsOutcome::held; });
}

LinkSolids linkSolids(const Hand& hand) {
  LinkSolids solids;
  for (const Link& link : hand.links) {
    solids.push_back(link.mesh.triangles.empty() ? nullptr : std::make_shared<Solid>(linkSolid(link.mesh)));
  }
  return solids;
}

/// A model of one test with the addresses in it.
struct TestModel {
  std::unique_ptr<mjModel, DeleteModel> model;
  CollisionWorld world;
  int objectBody = 0, objectPosition = 0, rootPosition = -1;
  std::vector<int> jointPosition;  // address in qpos of each joint
  std::vector<int> linkBody;
  std::vector<int> linkOfGeom;  // -1: another's
};

struct PhysicsModel::Impl {
  Hand hand;
  std::vector<Drive> drives;
  LinkSolids links;
  std::shared_ptr<const Solid> object;
  Vector3d centerOfMass;
  WrenchModel wrenches;
  double ownMass;
  PhysicsSettings settings;
  std::vector<ConvexPiece> pieces;  // empty: the solids collide
  std::vector<TestModel> tests;     // by PhysicsTest

  TestModel makeTest(const MassProperties& properties, double mass, HandBase base) const {
    SceneShapes shapes;
    shapes.object = {object->box.center(), object->box.sizes() / 2};
    shapes.objectPieces = pieces;
    for (std::size_t i = 0; i < links.size(); ++i) {
      shapes.links.push_back(links[i] ? BroadShape{links[i]->box.center(), links[i]->box.sizes() / 2} : BroadShape{});
      if (!pieces.empty()) shapes.linkPieces.push_back(connectedHulls(hand.links[i].mesh));
    }
    // An open mesh has its area in the place of a volume.
    const double measure = properties.volume > 0 ? properties.volume : properties.area;
    const ObjectMass objectMass{mass, properties.centerOfMass, mass / measure * properties.inertia};
    TestModel test;
    test.model = loadModel(graspMjcf(hand, drives, shapes, objectMass, base, object->box.min().z(), settings.world));
    const mjModel& model = *test.model;
    test.world.object = object.get();
    test.world.solidOfGeom.assign(model.ngeom, nullptr);
    test.world.finderOfGeom.resize(model.ngeom);
    test.linkOfGeom.assign(model.ngeom, -1);
    for (std::size_t i = 0; i < links.size(); ++i) {
      const int body = idOf(model, mjOBJ_BODY, fmt::format("link_{}", i));
      test.linkBody.push_back(body);
      for (int k = 0; k < model.body_geomnum[body]; ++k) {
        const int geom = model.body_geomadr[body] + k;
        test.linkOfGeom[geom] = static_cast<int>(i);
        test.world.solidOfGeom[geom] = links[i].get();
      }
    }
    for (std::size_t i = 0; i < hand.joints.size(); ++i) {
      const int joint = idOf(model, mjOBJ_JOINT, fmt::format("joint_{}", i));
      test.jointPosition.push_back(model.jnt_qposadr[joint]);
    }
    test.objectBody = idOf(model, mjOBJ_BODY, "object");
    test.objectPosition = model.jnt_qposadr[idOf(model, mjOBJ_JOINT, "object")];
    if (base == HandBase::carried) test.rootPosition = model.jnt_qposadr[model.body_jntadr[test.linkBody[0]]];
    return test;
  }
};

PhysicsModel::PhysicsModel(const Hand& hand, LinkSolids links, std::shared_ptr<const Solid> object,
                           const MassProperties& properties, double ownMass, const PhysicsSettings& settings,
                           std::vector<ConvexPiece> pieces)
    : impl_(new Impl{hand,
                     drivesOf(hand),
                     std::move(links),
                     std::move(object),
                     properties.centerOfMass,
                     {},
                     ownMass,
                     settings,
                     std::move(pieces),
                     {}}) {
  prepareMujoco();
  impl_->wrenches = {properties.centerOfMass, properties.radius, settings.world.friction, 8, 0};
  impl_->tests.push_back(impl_->makeTest(properties, settings.pullMass, HandBase::fixed));
  if (ownMass > 0) {
    impl_->tests.push_back(impl_->makeTest(properties, ownMass, HandBase::fixed));
    impl_->tests.push_back(impl_->makeTest(properties, ownMass, HandBase::carried));
  }
}

PhysicsModel::~PhysicsModel() = default;
PhysicsModel::PhysicsModel(PhysicsModel&&) noexcept = default;

bool PhysicsModel::knowsMass() const { return impl_->ownMass > 0; }
const Hand& PhysicsModel::hand() const { return impl_->hand; }

std::vector<Contact> PhysicsModel::contactsWithin(const GraspPosture& posture, double distance) const {
  const std::vector<Isometry3d> X_HL = forwardKinematics(impl_->hand, posture.joints);
  std::vector<Contact> contacts;
  std::vector<Touch> touches;
  for (std::size_t i = 0; i < impl_->links.size(); ++i) {
    if (!impl_->links[i]) continue;
    TouchFinder().find(*impl_->object, *impl_->links[i], posture.X_OH * X_HL[i], distance, touches);
    keepSpread(touches, kContactsPerLink);
    for (const Touch& touch : touches) {
      contacts.push_back({touch.position, -touch.normal, static_cast<std::uint16_t>(i)});
    }
  }
  return contacts;
}

bool PhysicsModel::closes(std::span<const Contact> contacts) const {
  if (contacts.size() < impl_->wrenches.fewestContacts()) return false;
  const WrenchMatrix wrenches = frictionConeWrenches(contacts, impl_->wrenches);
  return testForceClosure(wrenches).verdict == ForceClosure::closed;
}

struct GraspSimulator::Impl {
  const PhysicsModel::Impl& model;
  const PhysicsModel& owner;
  std::vector<std::unique_ptr<mjData, DeleteData>> data;  // of each test
  std::vector<CollisionWorld> worlds;                     // of each test

  // of the run
  const TestModel* test = nullptr;
  mjData* d = nullptr;
  Isometry3d X_WO = Isometry3d::Identity();  // at first
  double penetration = 0;                    // the deepest since it was set to 0
  const Watch* watch = nullptr;
  std::string_view phase;
  int direction = -1;

  explicit Impl(const PhysicsModel& physics) : model(*physics.impl_), owner(physics) {
    for (const TestModel& each : model.tests) {
      data.emplace_back(mj_makeData(each.model.get()));
      worlds.push_back(each.world);
    }
  }

  double step() const { return model.settings.world.timeStep; }
  int stepsOf(double seconds) const { return static_cast<int>(std::lround(seconds / step())); }

  void place(int address, const Isometry3d& X) const {
    const Eigen::Quaterniond q(X.linear());
    Eigen::Map<Vector3d>(d->qpos + address) = X.translation();
    Eigen::Map<Eigen::Vector4d>(d->qpos + address + 3) = Eigen::Vector4d(q.w(), q.x(), q.y(), q.z());
  }

  Isometry3d objectPose() const {
    const double* q = d->qpos + test->objectPosition;
    return Eigen::Translation3d(q[0], q[1], q[2]) * Eigen::Quaterniond(q[3], q[4], q[5], q[6]).normalized();
  }

  void show() const {
    PhysicsFrame frame{d->time, phase, direction, objectPose(), {}};
    for (const int body : test->linkBody) frame.X_WL.push_back(bodyPose(*d, body));
    (*watch)(frame);
  }

  /// The link that touches the object in a contact, -1 where it is the table.
  int linkOf(const mjContact& contact) const {
    return std::max(test->linkOfGeom[contact.geom1], test->linkOfGeom[contact.geom2]);
  }

  void advance() {
    mj_step(test->model.get(), d);
    for (int i = 0; i < d->ncon; ++i) {
      if (linkOf(d->contact[i]) >= 0) {
        penetration = std::max(penetration, -d->contact[i].dist);
      }
    }
    if (watch != nullptr && std::lround(d->time / step()) % stepsOf(kWatchSeconds) == 0) show();
  }

  bool isUnstable() const {
    const auto& warnings = d->warning;
    return warnings[mjWARN_BADQPOS].number + warnings[mjWARN_BADQVEL].number + warnings[mjWARN_BADQACC].number > 0;
  }

  /// Displacement and rotation of the object from `start`.
  void measure(const Isometry3d& start, double& displacement, double& rotation) const {
    const Isometry3d X = objectPose();
    displacement = (X * model.centerOfMass - start * model.centerOfMass).norm();
    rotation = turnBetween(Eigen::Quaterniond(X.linear()), Eigen::Quaterniond(start.linear()));
  }

  PhysicsOutcome judge(double displacement, double rotation) const {
    if (isUnstable() || !std::isfinite(displacement + rotation)) return PhysicsOutcome::unstable;
    if (displacement >= model.settings.largestMove) return PhysicsOutcome::moved;
    if (rotation >= model.settings.largestTurn * std::numbers::pi / 180) return PhysicsOutcome::turned;
    return PhysicsOutcome::held;
  }

  /// The force on the object's centre of mass, in W.
  void load(const Vector3d& force) const { Eigen::Map<Vector3d>(d->xfrc_applied + 6 * test->objectBody) = force; }

  void begin(const GraspPosture& posture) {
    mj_resetData(test->model.get(), d);
    penetration = 0;
    for (std::size_t i = 0; i < test->jointPosition.size(); ++i) d->qpos[test->jointPosition[i]] = posture.preshape[i];
    if (test->rootPosition >= 0) {
      const Eigen::Quaterniond q(posture.X_OH.linear());
      X_WO = Isometry3d::Identity();
      place(test->rootPosition, posture.X_OH);
      Eigen::Map<Vector3d>(d->mocap_pos) = posture.X_OH.translation();
      Eigen::Map<Eigen::Vector4d>(d->mocap_quat) = Eigen::Vector4d(q.w(), q.x(), q.y(), q.z());
    } else {
      X_WO = posture.X_OH.inverse();
    }
    place(test->objectPosition, X_WO);
  }

  double startDepth() const {
    mj_forward(test->model.get(), d);
    double depth = 0;
    for (int i = 0; i < d->ncon; ++i) depth = std::max(depth, -d->contact[i].dist);
    return depth;
  }

  /// Targets of the drives: from the preshape to the posture, all arriving together, then on by the squeeze.
  void closeAndSqueeze(const GraspPosture& posture, const Squeeze& squeeze) {
    const auto aim = [&](double closed, double squeezed) {
      for (std::size_t i = 0; i < model.drives.size(); ++i) {
        const Drive& drive = model.drives[i];
        d->ctrl[i] = closingTarget(model.hand, drive, posture, closed) +
                     squeezed * squeeze.torque[static_cast<Eigen::Index>(i)] / drive.stiffness;
      }
    };
    const int closing = stepsOf(model.settings.closeSeconds), squeezing = stepsOf(model.settings.squeezeSeconds);
    phase = "close";
    for (int i = 0; i < closing; ++i) aim(static_cast<double>(i + 1) / closing, 0), advance();
    phase = "squeeze";
    for (int i = 0; i < squeezing; ++i) aim(1, std::min(1.0, (i + 1) / (0.8 * squeezing))), advance();
  }

  SettledResult settled(double squeeze) const {
    SettledResult result;
    measure(X_WO, result.displacement, result.rotation);
    result.penetration = penetration;
    result.squeeze = squeeze;
    const Isometry3d X_OW = objectPose().inverse();
    for (int i = 0; i < d->ncon; ++i) {
      const mjContact& contact = d->contact[i];
      const int link = linkOf(contact);
      if (link < 0 || contact.efc_address < 0) continue;
      // MuJoCo's normals point from geom 1 to geom 2.
      const double inward = test->linkOfGeom[contact.geom1] >= 0 ? 1 : -1;
      result.contacts.push_back({X_OW * Vector3d(Eigen::Map<const Vector3d>(contact.pos)),
                                 X_OW.linear() * (inward * Eigen::Map<const Vector3d>(contact.frame)),
                                 static_cast<std::uint16_t>(link)});
    }
    result.closed = owner.closes(result.contacts);
    return result;
  }

  DirectionResult pull(const Vector3d& force) {
    DirectionResult result;
    penetration = 0;
    phase = "pull";
    load(force);
    const int steps = stepsOf(model.settings.pullSeconds), check = stepsOf(model.settings.checkSeconds);
    for (int i = 1; i <= steps; ++i) {
      advance();
      if (i % check != 0) continue;
      measure(X_WO, result.displacement, result.rotation);
      result.outcome = judge(result.displacement, result.rotation);
      result.fallSeconds = i * step();
      if (result.outcome != PhysicsOutcome::held) break;
    }
    if (result.outcome == PhysicsOutcome::held) result.fallSeconds = std::numeric_limits<double>::infinity();
    result.penetration = penetration;
    return result;
  }

  DirectionResult lift() {
    DirectionResult result;
    penetration = 0;
    phase = "lift";
    const int steps = stepsOf(model.settings.liftSeconds);
    for (int i = 0; i < steps; ++i) {
      d->mocap_pos[2] += model.settings.liftHeight / steps;
      advance();
    }
    Isometry3d lifted = X_WO;
    lifted.translation().z() += model.settings.liftHeight;
    measure(lifted, result.displacement, result.rotation);
    result.outcome = judge(result.displacement, result.rotation);
    const double infinity = std::numeric_limits<double>::infinity();
    result.fallSeconds = result.outcome == PhysicsOutcome::held ? infinity : steps * step();
    result.penetration = penetration;
    return result;
  }

  /// The six directions, each from the same state to the last bit.
  std::vector<DirectionResult> pullAllWays(double newtons) {
    const mjModel& m = *test->model;
    const std::vector<double> qpos(d->qpos, d->qpos + m.nq), qvel(d->qvel, d->qvel + m.nv);
    const std::vector<double> warmstart(d->qacc_warmstart, d->qacc_warmstart + m.nv);
    const double time = d->time;
    std::vector<DirectionResult> results;
    for (direction = 0; direction < 6; ++direction) {
      std::copy(qpos.begin(), qpos.end(), d->qpos);
      std::copy(qvel.begin(), qvel.end(), d->qvel);
      std::copy(warmstart.begin(), warmstart.end(), d->qacc_warmstart);
      d->time = time;
      const double sign = direction % 2 == 0 ? 1 : -1;
      results.push_back(pull(newtons * sign * X_WO.linear().col(direction / 2)));
      watch = nullptr;
    }
    return results;
  }
};

GraspSimulator::GraspSimulator(const PhysicsModel& model) : impl_(new Impl(model)) {}
GraspSimulator::~GraspSimulator() = default;
GraspSimulator::GraspSimulator(GraspSimulator&&) noexcept = default;

TestResult GraspSimulator::run(const GraspPosture& posture, PhysicsTest test, const Watch& watch) {
  constexpr double kGravity = 9.81;
  Impl& run = *impl_;
  const PhysicsSettings& settings = run.model.settings;
  run.test = &run.model.tests[static_cast<std::size_t>(test)];
  run.d = run.data[static_cast<std::size_t>(test)].get();
  run.watch = watch ? &watch : nullptr;
  run.direction = -1;
  collisionWorld = &run.worlds[static_cast<std::size_t>(test)];
  TestResult result;
  result.test = test;
  run.begin(posture);
  const double newtons = test == PhysicsTest::pull ? settings.pullForce : kGravity * run.model.ownMass;
  const std::size_t directions = test == PhysicsTest::lift ? 1 : 6;
  if (const double depth = run.startDepth(); depth > settings.startDepth) {
    result.directions.assign(directions, {PhysicsOutcome::inside, 0, 0, 0, depth});
    return result;
  }
  const Squeeze squeeze = balancedSqueeze(run.model.hand, run.model.drives, posture, run.model.centerOfMass,
                                          settings.squeezeForce * std::max(1.0, newtons / settings.pullForce));
  if (test == PhysicsTest::lift) run.load(Vector3d(0, 0, -newtons));
  run.closeAndSqueeze(posture, squeeze);
  result.settled = run.settled(squeeze.normalForce);
  if (test == PhysicsTest::lift) {
    result.directions.push_back(run.lift());
  } else {
    result.directions = run.pullAllWays(newtons);
  }
  return result;
}

}  // namespace handhold
