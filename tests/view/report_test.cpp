#include "core/error.h"
#include "support/toy_box_set.h"
#include "view/report_plan.h"
#include "view/report_sets.h"

#include <cmath>
#include <cstring>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace handhold {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Json = nlohmann::json;

std::size_t occurrences(const std::string& text, const std::string& part) {
  std::size_t count = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

/// The block of a page, as a browser finds it: up to the first tag that ends it.
Json blockOf(const std::string& page, const std::string& name) {
  const std::string start = "id=\"" + name + "\">";
  const std::size_t begin = page.find(start) + start.size();
  return Json::parse(page.substr(begin, page.find("</script>", begin) - begin));
}

/// What `packed` wrote, by a decoder of its own.
template <class T>
std::vector<T> unpacked(const std::string& text, const std::string& type) {
  EXPECT_EQ(text.substr(0, 3), type + ":");
  std::vector<unsigned char> bytes;
  std::uint32_t bits = 0;
  int count = 0;
  for (const char c : text.substr(3)) {
    if (c == '=') break;
    const int value = c >= 'A' && c <= 'Z'   ? c - 'A'
                      : c >= 'a' && c <= 'z' ? c - 'a' + 26
                      : c >= '0' && c <= '9' ? c - '0' + 52
                      : c == '+'             ? 62
                                             : 63;
    bits = bits << 6 | static_cast<std::uint32_t>(value);
    if ((count += 6) < 8) continue;
    count -= 8;
    bytes.push_back(static_cast<unsigned char>(bits >> count));
  }
  std::vector<T> values(bytes.size() / sizeof(T));
  std::memcpy(values.data(), bytes.data(), values.size() * sizeof(T));
  return values;
}

const Hand& jaw() {
  static const Hand hand = loadHand(HANDHOLD_SOURCE_DIR "/hands/jaw");
  return hand;
}

ReportedSet reported(std::size_t top = 1000) {
  return {testing::toyBoxSet(jaw()), "db/toy_box/jaw/v0001.h5", 4711, top, {}};
}

std::string pageOf(const ReportedSet& set) {
  SetsReport report(false);
  report.add(set);
  return report.html("db");
}

// The examples of RFC 4648, 10.
TEST(ReportPage, Base64) {
  const auto encoded = [](const std::string& text) { return base64(text.data(), text.size()); };
  EXPECT_EQ(encoded(""), "");
  EXPECT_EQ(encoded("f"), "Zg==");
  EXPECT_EQ(encoded("fo"), "Zm8=");
  EXPECT_EQ(encoded("foo"), "Zm9v");
  EXPECT_EQ(encoded("foobar"), "Zm9vYmFy");
  const unsigned char high[] = {0xFB, 0xFF, 0xBF};
  EXPECT_EQ(base64(high, 3), "+/+/");
}

// Whatever a name or note says, it ends no element of the page and stays what it was.
TEST(ReportPage, TextOfTheDataCannotBecomeMarkup) {
  const std::string harm = "</script><script>alert(1)</script><!-- scripts --> <b>&amp;";
  const std::string plain = assemblePage("t", {{"sets", "{}"}});
  const std::string page = assemblePage(harm, {{"sets", Json({{"note", harm}}).dump()}});
  EXPECT_EQ(blockOf(page, "sets")["note"], harm);
  EXPECT_EQ(occurrences(page, "<script"), occurrences(plain, "<script"));
  EXPECT_EQ(occurrences(page, "</script"), occurrences(plain, "</script"));
  EXPECT_EQ(page.find("alert(1)</script>"), std::string::npos);
}

// Nothing is loaded from anywhere; three.js comes with its licence.
TEST(ReportPage, IsSelfContained) {
  const std::string page = assemblePage("t", {{"sets", "{}"}});
  for (const char* loads : {" src=\"", "@import", "url(", "import("}) {
    const std::string own = page.substr(0, page.find("three.js, release"));
    EXPECT_EQ(own.find(loads), std::string::npos) << loads;
  }
  EXPECT_THAT(page, HasSubstr("REVISION=\"111\""));
  EXPECT_THAT(page, HasSubstr("Permission is hereby granted, free of charge"));
  EXPECT_EQ(page.find("<!-- three.js -->"), std::string::npos);
}

TEST(ReportPage, CoarserMeshHasFewerTrianglesInTheSamePlace) {
  const TriangleMesh sphere = sphereMesh(0.04);
  EXPECT_EQ(coarserMesh(sphere, sphere.triangles.size()).triangles, sphere.triangles);
  const TriangleMesh coarser = coarserMesh(sphere, sphere.triangles.size() / 4);
  EXPECT_LE(coarser.triangles.size(), sphere.triangles.size() / 4);
  EXPECT_GT(coarser.triangles.size(), sphere.triangles.size() / 20);
  for (const Eigen::Vector3d& v : coarser.vertices) EXPECT_NEAR(v.norm(), 0.04, 0.008);
}

TEST(SetsReport, HoldsTheGraspsAsStored) {
  ReportedSet set = reported();
  // A trial that is force closed, but with the hand in itself, is no grasp.
  set.set.outcome[1] = 4;
  set.set.trialEpsilon[1] = 0.9f;
  const Json json = blockOf(pageOf(set), "set-0");
  EXPECT_EQ(json["stored"], set.set.graspCount());
  EXPECT_EQ(json["shown"], set.set.graspCount());
  const std::vector<float> pose = unpacked<float>(json["grasps"]["pose"], "f4");
  ASSERT_EQ(pose.size(), set.set.handPose.size());
  for (std::size_t i = 0; i < pose.size(); ++i) EXPECT_EQ(pose[i], static_cast<float>(set.set.handPose[i]));
  EXPECT_EQ(unpacked<std::uint32_t>(json["grasps"]["trial"], "u4"), set.set.trial);
  EXPECT_EQ(unpacked<std::uint16_t>(json["grasps"]["contact_link"], "u2"), set.set.contactLink);
  EXPECT_EQ(unpacked<float>(json["grasps"]["contact_position"], "f4"), set.set.contactPosition);
  // One trial a sample is force closed, with the epsilon of its grasp.
  const std::vector<float> best = unpacked<float>(json["samples"]["best"], "f4");
  for (std::size_t i = 0; i < best.size(); ++i) EXPECT_EQ(best[i], static_cast<float>(set.set.epsilon[i]));
  EXPECT_EQ(json["outcomes"][0]["name"], "force_closed");
  EXPECT_EQ(json["outcomes"][0]["count"], set.set.samples);
  EXPECT_EQ(json["outcomes"][1]["count"], set.set.trialCount() - set.set.samples - 1);
  EXPECT_EQ(json["outcomes"][4]["name"], "self_collision");
  EXPECT_EQ(json["outcomes"][4]["count"], 1);
}

// Columns that no grasp has are left out; physics is one where it was simulated.
TEST(SetsReport, ColumnsAreThoseThatAreKnown) {
  const auto keys = [](const ReportedSet& set) {
    std::vector<std::string> found;
    const Json json = blockOf(pageOf(set), "set-0");
    for (const Json& column : json["columns"]) found.push_back(column["key"]);
    return found;
  };
  ReportedSet set = reported();
  EXPECT_THAT(keys(set), ElementsAre("epsilon"));
  set.set.criticalFriction[3] = 0.2f;
  EXPECT_THAT(keys(set), ElementsAre("epsilon", "critical_friction"));
  set.physics.assign(set.set.graspCount(), std::nanf(""));
  EXPECT_THAT(keys(set), ElementsAre("epsilon", "critical_friction"));
  set.physics[0] = 0.5f;
  EXPECT_THAT(keys(set), ElementsAre("epsilon", "critical_friction", "physics"));
}

TEST(SetsReport, TopLeavesTheBestWithTheirContacts) {
  const Json json = blockOf(pageOf(reported(5)), "set-0");
  EXPECT_EQ(json["shown"], 5);
  EXPECT_EQ(json["stored"], 26);
  EXPECT_EQ(unpacked<float>(json["columns"][0]["values"], "f4").size(), 5u);
  EXPECT_EQ(unpacked<std::uint32_t>(json["grasps"]["contact_begin"], "u4").size(), 6u);
  EXPECT_EQ(unpacked<std::uint16_t>(json["grasps"]["contact_link"], "u2").size(), 10u);
}

TEST(SetsReport, SetsShareHandsAndMeshes) {
  SetsReport report(true);
  report.add(reported());
  ReportedSet other = reported();
  other.set.object = "other_box";
  report.add(other);
  report.addFailure("db/broken.h5: is damaged");
  const std::string page = report.html("db");
  EXPECT_EQ(occurrences(page, "id=\"hand-"), 1u);
  EXPECT_EQ(occurrences(page, "id=\"object-"), 1u);
  const Json sets = blockOf(page, "sets");
  EXPECT_EQ(sets["sets"].size(), 2u);
  EXPECT_EQ(sets["sets"][1]["object"], "other_box");
  EXPECT_THAT(sets["sets"][1]["picture"].get<std::string>(), HasSubstr("data:image/png;base64,iVBORw0KGgo"));
  EXPECT_THAT(sets["failures"], ElementsAre("db/broken.h5: is damaged"));
}

TEST(SetsReport, RefusesASetWhoseHandCannotBeRestored) {
  ReportedSet set = reported();
  set.set.urdf = "<robot";
  try {
    pageOf(set);
    FAIL() << "nothing was thrown";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("db/toy_box/jaw/v0001.h5: "));
  }
}

// A body that never moves has one pose, one that does has one for each time.
TEST(PlanReport, PosesThatStayAreWrittenOnce) {
  ReportedPlan plan;
  plan.title = "toy";
  plan.status = "planned";
  plan.time = {0, 1, 2};
  const Eigen::Isometry3d here = Eigen::Isometry3d::Identity(), there(Eigen::Translation3d(0, 0, 0.05));
  plan.bodies.push_back({"rest", ReportedBody::Role::robot, boxMesh({1, 1, 1}), {here, here, here}});
  plan.bodies.push_back({"lifted", ReportedBody::Role::object, boxMesh({1, 1, 1}), {here, here, there}});
  const Json json = blockOf(planReportHtml(plan), "plan");
  EXPECT_EQ(unpacked<float>(json["bodies"][0]["poses"], "f4"), (std::vector<float>{0, 0, 0, 0, 0, 0, 1}));
  const std::vector<float> moving = unpacked<float>(json["bodies"][1]["poses"], "f4");
  ASSERT_EQ(moving.size(), 21u);
  EXPECT_EQ(moving[16], 0.05f);
  EXPECT_EQ(json["bodies"][1]["role"], "object");
}

}  // namespace
}  // namespace handhold
