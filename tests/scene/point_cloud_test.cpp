// Files of points: every form that is read, every way to be refused, and thinning that leaves nothing uncovered.
#include "scene/point_cloud.h"

#include "core/random.h"
#include "scene/scene_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using Eigen::Vector3d;
using ::testing::ElementsAre;
using ::testing::StartsWith;

class PointCloud : public test::SceneFolder {
 protected:
  std::vector<Vector3d> read(const std::string& name, const std::string& content) const {
    return readPointCloud(write(name, content));
  }
  std::string refusal(const std::string& name, const std::string& content) const {
    return refusalOf([&] { read(name, content); });
  }
};

const std::vector<Vector3d> kThree = {{0.5, -0.25, 1}, {-0.0625, 2, 0}, {3, 4, -5}};

/// Colours before, between and after, a list, and an element before the vertices.
std::string plyHeader(const std::string& format, const std::string& type, std::size_t count) {
  return fmt::format(
      "ply\nformat {0} 1.0\ncomment x y z\nelement camera 1\nproperty float view\nproperty list uchar short lens\n"
      "element vertex {2}\nproperty uchar red\nproperty {1} x\nproperty {1} y\nproperty list uchar int seen\n"
      "property {1} z\nproperty double confidence\nend_header\n",
      format, type, count);
}

template <typename T>
std::string plyBody(bool bigEndian) {
  std::string bytes =
      test::raw(1.5F, bigEndian) + '\2' + test::raw<std::int16_t>(1, bigEndian) + test::raw<std::int16_t>(2, bigEndian);
  for (std::size_t i = 0; i < kThree.size(); ++i) {
    bytes += '\7' + test::raw(static_cast<T>(kThree[i].x()), bigEndian) +
             test::raw(static_cast<T>(kThree[i].y()), bigEndian) + static_cast<char>(i);
    for (std::size_t k = 0; k < i; ++k) bytes += test::raw<std::int32_t>(9, bigEndian);
    bytes += test::raw(static_cast<T>(kThree[i].z()), bigEndian) + test::raw(0.5, bigEndian);
  }
  return bytes;
}

TEST_F(PointCloud, ReadsText) {
  EXPECT_EQ(read("a.xyz", "# a comment\n0.5 -0.25 1 255 0 0\n\n-0.0625,2,0 # end\r\n3\t4\t-5\n"), kThree);
  EXPECT_EQ(read("b.xyz", "1 2 3"), std::vector<Vector3d>{Vector3d(1, 2, 3)});  // no line end
}

TEST_F(PointCloud, ReadsPlyInAllItsForms) {
  EXPECT_EQ(read("a.ply", plyHeader("ascii", "float", 3) +
                              "1.5 2 1 2\n7 0.5 -0.25 0 1 0.5\n7 -0.0625 2 1 9 0 0.5\n\n7 3 4 2 9 9 -5 0.5\n"),
            kThree);
  EXPECT_EQ(read("b.ply", plyHeader("binary_little_endian", "float", 3) + plyBody<float>(false)), kThree);
  EXPECT_EQ(read("c.ply", plyHeader("binary_little_endian", "double", 3) + plyBody<double>(false)), kThree);
  EXPECT_EQ(read("d.ply", plyHeader("binary_big_endian", "float32", 3) + plyBody<float>(true)), kThree);
  EXPECT_EQ(read("e.ply", plyHeader("binary_big_endian", "float64", 3) + plyBody<double>(true)), kThree);
}

TEST_F(PointCloud, RefusesBadText) {
  EXPECT_EQ(refusal("a.xyz", "0 0 0\n1 2 x\n"), "a.xyz:2: is \"1 2 x\", want three numbers x y z");
  EXPECT_EQ(refusal("a.xyz", "0 0 0\n1 2 # 3\n"), "a.xyz:2: is \"1 2 # 3\", want three numbers x y z");
  EXPECT_EQ(refusal("a.xyz", "0 0 nan\n"), "a.xyz:1: the point is (0, 0, nan), want finite metres within 10000");
  EXPECT_EQ(refusal("a.xyz", "\n0 inf 0\n"), "a.xyz:2: the point is (0, inf, 0), want finite metres within 10000");
  EXPECT_EQ(refusal("a.xyz", "0 20000 0\n"), "a.xyz:1: the point is (0, 20000, 0), want finite metres within 10000");
  EXPECT_EQ(refusal("a.xyz", "# nothing\n"), "a.xyz: has no points, want at least one");
  EXPECT_EQ(refusal("a.xyz", ""), "a.xyz: has no points, want at least one");
  EXPECT_EQ(refusal("a.xyz", std::string("\x01\x02\xff\n", 4)), "a.xyz:1: is \"???\", want three numbers x y z");
}

TEST_F(PointCloud, RefusesABadPlyHeader) {
  const auto header = [&](const std::string& rest) { return refusal("a.ply", "ply\n" + rest); };
  const std::string start = "format ascii 1.0\n";
  EXPECT_EQ(header(""), "a.ply: ends in its header, want end_header");
  EXPECT_EQ(header("end_header\n"), "a.ply:2: is \"end_header\", want a format line before it");
  EXPECT_EQ(header("format text 1.0\n"),
            "a.ply:2: is \"format text 1.0\", want format ascii, binary_little_endian or binary_big_endian");
  EXPECT_EQ(header(start + "element vertex -3\n"), "a.ply:3: is \"element vertex -3\", want element NAME COUNT");
  EXPECT_EQ(header(start + "element vertex many\n"), "a.ply:3: is \"element vertex many\", want element NAME COUNT");
  EXPECT_EQ(header(start + "element vertex 1\nproperty half x\n"),
            "a.ply:4: is \"property half x\", want a number type of PLY, such as float");
  EXPECT_EQ(header(start + "property float x\n"),
            "a.ply:3: is \"property float x\", want format, element, property, comment or end_header");
  EXPECT_EQ(header(start + "element vertex 1\nproperty x\n"), "a.ply:4: is \"property x\", want property TYPE NAME");
  EXPECT_EQ(header(start + "end_header\n"), "a.ply: has no \"element vertex\", want one with x, y and z");
  EXPECT_EQ(header(start + "element vertex 1\nproperty float x\nproperty float y\nend_header\n0 0\n"),
            "a.ply: vertices have no z, want it as float or double");
  EXPECT_EQ(header(start + "element vertex 1\nproperty int x\nproperty float y\nproperty float z\nend_header\n0 0 0\n"),
            "a.ply: vertices have another type of x, want it as float or double");
}

TEST_F(PointCloud, RefusesABadPlyBody) {
  const std::string xyz = "property float x\nproperty float y\nproperty float z\nend_header\n";
  const std::string ascii = "ply\nformat ascii 1.0\nelement vertex 2\n" + xyz;
  EXPECT_EQ(refusal("a.ply", ascii + "0 0 0\n"), "a.ply: vertex 1 is missing, want 2 of them, as the header says");
  EXPECT_EQ(refusal("a.ply", ascii + "0 0 0\n0 0\n"), "a.ply:9: is \"0 0\", want 3 numbers of vertex 1");
  EXPECT_EQ(refusal("a.ply", ascii + "0 0 0\n0 a 0\n"), "a.ply:9: is \"0 a 0\", want 3 numbers of vertex 1");
  EXPECT_EQ(refusal("a.ply", ascii + "0 0 0\n0 nan 0\n"),
            "a.ply: vertex 1 is (0, nan, 0), want finite metres within 10000");
  EXPECT_EQ(refusal("a.ply", "ply\nformat ascii 1.0\nelement vertex 0\n" + xyz),
            "a.ply: has no points, want at least one");
  const std::string whole = plyHeader("binary_little_endian", "float", 3) + plyBody<float>(false);
  EXPECT_EQ(refusal("a.ply", whole.substr(0, whole.size() - 1)),
            "a.ply: vertex 2 is missing, want 3 of them, as the header says");
  EXPECT_EQ(refusal("a.ply", "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty list char int l\n" +
                                 xyz + '\xff'),
            "a.ply: vertex 0 has a list of -1, want a length >= 0");
  EXPECT_EQ(
      refusal("a.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty list char int l\n" + xyz + "-1 0 0 0\n"),
      "a.ply:9: is \"-1 0 0 0\", want a list as long as it says");
  // A count that no memory could hold is refused by the body, not by the machine.
  EXPECT_EQ(refusal("a.ply", "ply\nformat binary_little_endian 1.0\nelement vertex 1000000000\n" + xyz + "abc"),
            "a.ply: vertex 0 is missing, want 1000000000 of them, as the header says");
}

// Whatever was cut off or flipped: points or one line, never a crash.
TEST_F(PointCloud, SurvivesDamage) {
  const std::string whole = plyHeader("binary_big_endian", "double", 3) + plyBody<double>(true);
  int refused = 0;
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const RandomStream random(seed);
    std::string damaged = whole.substr(0, random.bits(0) % (whole.size() + 1));
    for (std::uint64_t i = 0; i < 3 && !damaged.empty(); ++i) {
      damaged[random.bits(2 * i + 1) % damaged.size()] = static_cast<char>(random.bits(2 * i + 2));
    }
    const std::string message = refusal("a.ply", damaged);
    if (message == "nothing was thrown") continue;
    ++refused;
    EXPECT_THAT(message, StartsWith("a.ply:"));
  }
  EXPECT_GT(refused, 200);
}

TEST(ThinPoints, KeepsTheFirstOfEachVoxelAndCoversTheRest) {
  std::vector<Vector3d> points;
  const RandomStream random(1);
  for (std::uint64_t i = 0; i < 20'000; ++i) {
    points.push_back(0.1 * Vector3d(random.uniform(3 * i), random.uniform(3 * i + 1), random.uniform(3 * i + 2)) -
                     Vector3d::Constant(0.05));
  }
  std::vector<Vector3d> thinned = points;
  const double farthest = thinPoints(thinned, 0.01);
  EXPECT_EQ(thinned.size(), 1000U);
  EXPECT_EQ(thinned[0], points[0]);
  EXPECT_LE(farthest, 0.01 * std::sqrt(3.0));
  EXPECT_GT(farthest, 0.01);
  for (const Vector3d& p : points) {
    double nearest = 1;
    for (const Vector3d& kept : thinned) nearest = std::min(nearest, (p - kept).norm());
    EXPECT_LE(nearest, farthest);
  }
  std::vector<Vector3d> again = thinned;
  EXPECT_EQ(thinPoints(again, 0.01), 0);
  EXPECT_EQ(again, thinned);
}

}  // namespace
}  // namespace handhold
