#include "mesh/import.h"

#include "core/error.h"
#include "mesh/files.h"
#include "mesh/shapes.h"

#include <filesystem>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

namespace handhold {
namespace {

using Eigen::Vector3d;
using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

// assimp reads decimal numbers to within a unit of the last place of a float.
constexpr double kFloatTol = 1e-7;

const TriangleMesh kBox = test::box({-0.1, 0.02, 0.3}, {0.11, 0.05, 0.37});
const char* const kPlainNode = R"([{"mesh":0}])";

/// The one-line message with which `load` refuses; it must begin with the path.
template <typename Load>
std::string refusal(const std::string& path, Load load) {
  try {
    load();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), AllOf(StartsWith(path + ": "), Not(HasSubstr("\n"))));
    return std::string(error.what()).substr(std::min(path.size() + 2, std::strlen(error.what())));
  }
  return "accepted";
}

std::string refusal(const std::string& path) {
  return refusal(path, [&] { loadObject(path, {}); });
}

std::string refusalOf(const std::string& name, const std::string& content) {
  return refusal(test::writeTemporary(name, content));
}

void expectSame(const TriangleMesh& loaded, const TriangleMesh& wanted, const Eigen::Affine3d& X) {
  ASSERT_EQ(loaded.vertices.size(), wanted.vertices.size());
  EXPECT_EQ(loaded.triangles.size(), wanted.triangles.size());
  for (const auto& vertex : wanted.vertices) {
    double nearest = 1;
    for (const auto& other : loaded.vertices) nearest = std::min(nearest, (X * vertex - other).norm());
    EXPECT_LT(nearest, 3 * kFloatTol);
  }
  EXPECT_NEAR(test::volume(loaded), std::abs(X.linear().determinant()) * test::volume(wanted), 1e-8);
}

ObjectModel expectLoads(const std::string& name, const std::string& content, const TriangleMesh& wanted,
                        const Eigen::Affine3d& X = Eigen::Affine3d::Identity()) {
  SCOPED_TRACE(name);
  const ObjectModel object = loadObject(test::writeTemporary(name, content), {});
  expectSame(object.mesh, wanted, X);
  EXPECT_TRUE(object.watertight);
  return object;
}

TEST(Import, EveryFormatGivesTheSameVerticesInTheSameFrame) {
  expectLoads("box.obj", test::objText(kBox), kBox);
  expectLoads("text.stl", test::stlText(kBox), kBox);
  expectLoads("binary.STL", test::stlBinary(kBox), kBox);
  expectLoads("text.ply", test::plyText(kBox), kBox);
  expectLoads("little.ply", test::plyBinary(kBox, false), kBox);
  expectLoads("big.ply", test::plyBinary(kBox, true), kBox);
  expectLoads("box.glb", test::glbBinary(kBox, kPlainNode), kBox);
  expectLoads("box.dae", test::daeText(kBox, "", ""), kBox);
  expectLoads("box.off", test::offText(kBox), kBox);
  expectLoads("box.3ds", test::binary3ds(kBox), kBox);
}

// Up axis and unit are the person's to know: reported, not applied.
TEST(Import, ColladaMetadataAreReportedNotApplied) {
  for (const std::string up : {"X_UP", "Y_UP", "Z_UP"}) {
    for (const std::string unit :
         {R"(<unit meter="0.01" name="centimeter"/>)", R"(<unit name='meter' meter = '0.01'/>)"}) {
      const ObjectModel object =
          expectLoads("box.dae", test::daeText(kBox, unit + "<up_axis>" + up + "</up_axis>", ""), kBox);
      EXPECT_THAT(object.notes, Contains("the file says " + up + ": reported, not applied"));
      EXPECT_THAT(object.notes, Contains("the file says unit 0.01 m: reported, not applied"));
    }
  }
  const ObjectModel object = expectLoads("empty.dae", test::daeText(kBox, "<unit/>", ""), kBox);
  EXPECT_THAT(object.notes, Not(Contains(HasSubstr("unit"))));
}

TEST(Import, SceneGraphIsApplied) {
  Eigen::Affine3d X = Eigen::Affine3d::Identity();
  X.translate(Vector3d(0.1, 0.2, 0.3)).rotate(Eigen::AngleAxisd(std::numbers::pi / 2, Vector3d::UnitX())).scale(2);
  expectLoads("nodes.glb",
              test::glbBinary(kBox, R"([{"translation":[0.1,0.2,0.3],"children":[1]},)"
                                    R"({"rotation":[0.70710678,0,0,0.70710678],"scale":[2,2,2],"mesh":0}])"),
              kBox, X);
  for (const std::string asset : {"", R"(<unit meter="0.001"/><up_axis>Z_UP</up_axis>)"}) {
    expectLoads(
        "nodes.dae",
        test::daeText(kBox, asset, "<translate>0.1 0.2 0.3</translate><rotate>1 0 0 90</rotate><scale>2 2 2</scale>"),
        kBox, X);
  }
}

// A mirrored instance is turned back outward; two instances are one object.
TEST(Import, InstancesAreMergedAndMirrorsTurned) {
  const std::string nodes = R"([{"children":[1,2]},{"mesh":0},{"mesh":0,"scale":[-1,1,1],"translation":[0.5,0,0]}])";
  const ObjectModel object = loadObject(test::writeTemporary("two.glb", test::glbBinary(kBox, nodes)), {});
  EXPECT_EQ(object.mesh.vertices.size(), 16U);
  EXPECT_NEAR(object.mass.volume, 2 * test::volume(kBox), 1e-9);
  EXPECT_THAT(object.notes, Not(Contains(HasSubstr("turned"))));
  EXPECT_NEAR(boundingBox(object.mesh).max().x(), 0.6, kFloatTol);
}

// Polygons are divided, lines, points and materials ignored; negative and later indices, continued lines and numbers
// without a leading zero are understood.
TEST(Import, ObjDialects) {
  const std::string quads =
      "# cube\nmtllib none.mtl\nusemtl none\nl 1 2\np 1\nf 1 3 4 2\nf 5 6 8 7\nf 1 2 6 \\\n 5 # front\n"
      "v 0 0 0\nv .5 0 0 \nv 0 +.5 0\nv .5 .5 \\\n0 1\nv 0 0 0.5 1 0 0\nv .5 0 .5\nv 0 .5 .5\nv .5 .5 5e-1\n"
      "f -6/1/1 -2/2 -1//3 -5\nf 1 5 7 3\r\nf 2 4 8 6";
  const ObjectModel object = loadObject(test::writeTemporary("quads.obj", quads), {});
  expectSame(object.mesh, test::cube(0.5), Eigen::Affine3d::Identity());
  EXPECT_TRUE(object.watertight);
  EXPECT_THAT(object.notes, Not(Contains(HasSubstr("turned"))));
}

TEST(Import, UnitIsApplied) {
  const std::string path = test::writeTemporary("mm.stl", test::stlBinary(test::cube(20)));
  EXPECT_NEAR(loadObject(path, {0.001, true, "mm"}).mass.volume, 8e-6, 1e-11);
  EXPECT_THAT(refusal(path), HasSubstr("`unit: mm` would make it 0.0346 m"));
}

TEST(Import, LoadMeshScalesPerAxisAndKeepsMirrorsOutward) {
  const std::string path = test::writeTemporary("link.stl", test::stlText(test::cube(20)));
  const TriangleMesh mesh = loadMesh(path, {-1, 2, 3});
  EXPECT_NEAR(test::volume(mesh), 6 * 8000, 1e-3);
  EXPECT_EQ(boundingBox(mesh).min(), Vector3d(-20, 0, 0));
  EXPECT_EQ(mesh.vertices.size(), 8U);
  const std::string open = test::writeTemporary("inverted.stl", test::stlText(test::insideOut(test::cube(20))));
  EXPECT_LT(test::volume(loadMesh(open, {1, 1, 1})), 0);  // nothing is oriented
}

// ---- Refusals ----

TEST(ImportRefusal, Files) {
  EXPECT_EQ(refusal("/nowhere/mug.stl"), "cannot be read: No such file or directory");
  EXPECT_EQ(refusal(testing::TempDir()), "cannot be read: is a folder");
  EXPECT_EQ(refusal("/dev/null"), "cannot be read: is not a regular file");
  for (const char* name : {"a.obj", "a.stl", "a.ply", "a.glb", "a.gltf", "a.dae", "a.off", "a.3ds", "a.fbx"}) {
    EXPECT_EQ(refusalOf(name, ""), "is empty") << name;
  }
  EXPECT_EQ(refusalOf("mug.step", "x"),
            "is of unknown format \".step\", want one of obj, stl, ply, glb, gltf, dae, off, "
            "3ds, fbx");
  EXPECT_THAT(refusalOf("mug", "x"), StartsWith("is of unknown format \"\""));
  EXPECT_EQ(refusalOf("points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n"), "has no triangles");
}

// Every format, cut at many places, is refused or (an OBJ can end anywhere) at least not taken for a closed mesh.
TEST(ImportRefusal, NoTruncatedFilePassesForWhole) {
  const std::pair<const char*, std::string> files[] = {
      {"cut.stl", test::stlBinary(kBox)},       {"text.stl", test::stlText(kBox)},
      {"cut.ply", test::plyText(kBox)},         {"little.ply", test::plyBinary(kBox, false)},
      {"big.ply", test::plyBinary(kBox, true)}, {"cut.glb", test::glbBinary(kBox, kPlainNode)},
      {"cut.dae", test::daeText(kBox, "", "")}, {"cut.off", test::offText(kBox)},
      {"cut.3ds", test::binary3ds(kBox)},       {"cut.obj", test::objText(kBox)}};
  for (const auto& [name, whole] : files) {
    for (const double share : {0.05, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95}) {
      const auto size = static_cast<std::size_t>(share * static_cast<double>(whole.size()));
      SCOPED_TRACE(fmt::format("{} cut at {} of {}", name, size, whole.size()));
      const std::string path = test::writeTemporary(name, whole.substr(0, size));
      bool passed = false;
      refusal(path, [&] { passed = loadObject(path, {}).watertight; });
      EXPECT_FALSE(passed);
    }
  }
}

TEST(ImportRefusal, Stl) {
  const std::string binary = test::stlBinary(kBox);
  EXPECT_EQ(refusalOf("a.stl", binary.substr(0, 300)),
            "is truncated: 300 bytes, want 684 for the 12 triangles of its header");
  EXPECT_EQ(refusalOf("a.stl", binary + "x"), "is damaged: 685 bytes, want 684 for the 12 triangles of its header");
  const std::string text = test::stlText(kBox);
  EXPECT_EQ(refusalOf("a.stl", text.substr(0, text.find("endsolid"))),
            "is truncated: an ASCII STL ends with \"endsolid\", this one with \"endfacet\"");
  EXPECT_EQ(refusalOf("a.stl", "solid x\nfacet\nvertex 0 0 0\nendfacet\nendsolid x"),
            "is damaged: 1 vertices in 1 facets, want 3 in each");
}

TEST(ImportRefusal, Ply) {
  const std::string text = test::plyText(kBox);
  EXPECT_EQ(refusalOf("a.ply", text.substr(0, text.size() - 4)),
            "is truncated: its header promises 12 of element \"face\", 11 are there");
  for (const bool bigEndian : {false, true}) {
    const std::string binary = test::plyBinary(kBox, bigEndian);
    EXPECT_EQ(refusalOf("a.ply", binary.substr(0, binary.size() - 14)),
              "is truncated: its header promises 12 of element \"face\", 10 are there");
    EXPECT_EQ(refusalOf("a.ply", binary.substr(0, binary.find("end_header") + 11 + 30)),
              "is truncated: its header promises 8 of element \"vertex\", 2 are there");
  }
  TriangleMesh wrong = kBox;
  wrong.triangles[3][1] = 8;
  EXPECT_EQ(refusalOf("a.ply", test::plyBinary(wrong, true)), "has vertex index 8 in face 3, want 0 to 7");
  EXPECT_EQ(refusalOf("a.ply", "ply\nformat ascii 1.0\nelement vertex 3\n"),
            "is truncated: its header has no end_header");
  EXPECT_EQ(refusalOf("a.ply", "plx\n"), "does not begin with \"ply\"");
  EXPECT_THAT(refusalOf("a.ply", "ply\nformat zip 1.0\nend_header\n"), HasSubstr("has the format \"zip\""));
  EXPECT_THAT(refusalOf("a.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty colour x\nend_header\n"),
              HasSubstr("has an unknown property in its header: \"colour x\""));
}

TEST(ImportRefusal, Obj) {
  const std::string vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  EXPECT_EQ(refusalOf("a.obj", vertices + "f 1 2 4\n"),
            "line 4: vertex index 4, want at most 3, the number of vertices");
  EXPECT_EQ(refusalOf("a.obj", vertices + "f 1 2\n"), "line 4: a face with 2 vertices, want 3 or more");
  EXPECT_EQ(refusalOf("a.obj", vertices + "f 1 2 -4\n"),
            "line 4: vertex index \"-4\", want a whole number from 1, or from -3 to -1");
  EXPECT_THAT(refusalOf("a.obj", vertices + "f 0 1 2\n"), StartsWith("line 4: vertex index \"0\""));
  EXPECT_EQ(refusalOf("a.obj", "v 0 0\n"), "line 1: coordinate \"\", want three numbers");
  EXPECT_EQ(refusalOf("a.obj", "v 0 0 abc\n"), "line 1: coordinate \"abc\", want three numbers");
}

TEST(ImportRefusal, GlbOffAnd3ds) {
  const std::string glb = test::glbBinary(kBox, kPlainNode);
  EXPECT_EQ(refusalOf("a.glb", glb.substr(0, 200)),
            fmt::format("is truncated: 200 bytes, its header promises {}", glb.size()));
  EXPECT_EQ(refusalOf("a.glb", "glTF"), "does not begin with the 12 bytes of a GLB header");
  TriangleMesh wrong = kBox;
  wrong.triangles[0][0] = 77;
  EXPECT_EQ(refusalOf("a.glb", test::glbBinary(wrong, kPlainNode)), "has a face with a vertex index out of range");
  EXPECT_EQ(refusalOf("a.off", test::offText(wrong)), "has a face with a vertex index out of range");
  const std::string off = test::offText(kBox);
  EXPECT_EQ(refusalOf("a.off", off.substr(0, off.size() - 8)),
            "is truncated: 19 lines of data, want 8 vertices and 12 faces");
  EXPECT_EQ(refusalOf("a.3ds", std::string("\x4d\x4d\x00\x01\x00\x00", 6)),
            "is truncated: 6 bytes, its main chunk has 256");
}

TEST(ImportRefusal, NotFinite) {
  TriangleMesh mesh = kBox;
  mesh.vertices[2].z() = std::nan("");
  for (const auto& [name, content] : {std::pair<const char*, std::string>{"a.stl", test::stlBinary(mesh)},
                                      {"b.ply", test::plyBinary(mesh, false)},
                                      {"c.ply", test::plyText(mesh)},
                                      {"d.glb", test::glbBinary(mesh, kPlainNode)},
                                      {"e.obj", test::objText(mesh)},
                                      {"f.stl", test::stlText(mesh)}}) {
    EXPECT_THAT(refusalOf(name, content), HasSubstr("nan")) << name;
  }
}

TEST(ImportRefusal, DamagedContentIsRefusedInWords) {
  EXPECT_THAT(refusalOf("a.dae", "<COLLADA><library"), StartsWith("is not a readable dae file: "));
  EXPECT_THAT(refusalOf("a.gltf", "{\"asset\": {"), StartsWith("is not a readable gltf file: "));
  EXPECT_THAT(refusalOf("a.fbx", "what is this"), StartsWith("is not a readable fbx file: "));
}

TEST(ImportRefusal, TooManyTriangles) {
  const std::string path = test::writeTemporary("fine.stl", test::stlBinary(test::sphere(0.1, 3)));
  ImportLimits limits;
  limits.triangles = 511;
  EXPECT_EQ(refusal(path, [&] { loadObject(path, {}, limits); }), "has more than 511 triangles, the limit");
  limits.triangles = 512;
  EXPECT_EQ(refusal(path, [&] { loadObject(path, {}, limits); }), "accepted");
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST(ImportRefusal, TooMuchMemory) {
  const std::string path = test::writeTemporary("fine.stl", test::stlBinary(test::sphere(0.1, 8)));
  ImportLimits limits;
  limits.bytes = std::size_t{128} << 20;
  EXPECT_EQ(refusal(path, [&] { loadObject(path, {}, limits); }), "needs more than 128 MiB of memory to be read");
}
#endif

// ---- The parent, against helpers that misbehave ----

/// A shell script in the place of handhold-import.
std::string script(const std::string& body) {
  const std::string path = test::writeTemporary("helper.sh", "#!/bin/sh\n" + body + "\n");
  ::chmod(path.c_str(), 0755);
  return path;
}

std::string refusalBy(const std::string& body, const ImportLimits& limits = {}) {
  const std::string helper = script(body);
  return refusal("some/mug.stl", [&] { importInChild(helper, "some/mug.stl", limits); });
}

std::string systemErrorBy(const std::string& helper) {
  try {
    importInChild(helper, "some/mug.stl", {});
  } catch (const SystemError& error) {
    return error.what();
  }
  return "none";
}

std::size_t openDescriptors() {
  const std::filesystem::directory_iterator folder("/proc/self/fd");
  return static_cast<std::size_t>(std::distance(begin(folder), end(folder)));
}

TEST(ImportProcess, HangingHelperIsKilled) {
  ImportLimits limits;
  limits.seconds = 0.2;
  const auto start = std::chrono::steady_clock::now();
  EXPECT_EQ(refusalBy("sleep 60", limits), "the importer took longer than 0.2 s");
  EXPECT_EQ(refusalBy("exec 1>&- 2>&-; sleep 60", limits), "the importer took longer than 0.2 s");
  EXPECT_EQ(refusalBy("while true; do echo spam >&2; done", limits), "the importer took longer than 0.2 s");
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(20));
}

TEST(ImportProcess, CrashAndExitAreToldApart) {
  EXPECT_EQ(refusalBy("kill -SEGV $$"), "the importer crashed on it (signal 11)");
  // The kernel's choice when memory runs out says nothing about the file.
  EXPECT_EQ(systemErrorBy(script("kill -KILL $$")),
            "some/mug.stl: the importer was killed (signal 9), perhaps for want of memory");
  EXPECT_EQ(refusalBy("echo assertion failed >&2; exit 1"), "the importer crashed on it (exit status 1)");
  EXPECT_EQ(refusalBy("echo noise >&2; echo 'some/mug.stl: is odd' >&2; exit 2"), "is odd");
  EXPECT_EQ(refusalBy("exit 4"), "needs more than 4096 MiB of memory to be read");
}

TEST(ImportProcess, DamagedAnswersAreSystemErrors) {
  const std::string damaged = "some/mug.stl: handhold-import gave a damaged answer";
  EXPECT_EQ(systemErrorBy(script("exit 0")), damaged);
  EXPECT_EQ(systemErrorBy(script("echo hello")), damaged);
  EXPECT_EQ(systemErrorBy(script("head -c 100000 /dev/zero")), damaged);
  EXPECT_THAT(systemErrorBy("/nowhere/helper"), HasSubstr("/nowhere/helper: cannot be started: No such file"));
  EXPECT_EQ(systemErrorBy(script("echo 'stdout is closed' >&2; exit 3")),
            "some/mug.stl: handhold-import: stdout is closed");
}

// Counts are checked before anything of that size is allocated.
TEST(ImportProcess, CountsBeyondTheLimitsAreRefused) {
  const std::string header = test::raw(kImportMagic) + test::raw(std::uint64_t{1} << 60) +
                             test::raw(std::uint64_t{1} << 61) + test::raw(std::uint64_t{0});
  const std::string answer = test::writeTemporary("answer", header);
  EXPECT_THAT(refusalBy("cat " + answer), StartsWith("has 2305843009213693952 triangles"));
}

TEST(ImportProcess, ManyThreadsAtOnce) {
  const std::string good = test::writeTemporary("good.stl", test::stlBinary(test::sphere(0.1, 4)));
  const std::string bad = test::writeTemporary("bad.stl", test::stlBinary(kBox).substr(0, 200));
  const std::size_t before = openDescriptors();
  std::vector<int> done(6, 0);
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < done.size(); ++t) {
    threads.emplace_back([&, t] {
      for (int i = 0; i < 5; ++i) {
        done[t] += loadObject(good, {}).watertight ? 1 : 0;
        try {
          loadObject(bad, {});
        } catch (const InputError&) {
          ++done[t];
        }
      }
    });
  }
  for (auto& thread : threads) thread.join();
  for (const int count : done) EXPECT_EQ(count, 10);
  EXPECT_EQ(openDescriptors(), before);
}

}  // namespace
}  // namespace handhold
