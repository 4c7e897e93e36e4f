// The server: every operation, every refusal, ten thousand mutated requests, and a record that replays.
#include "plan/server.h"

#include "core/random.h"
#include "plan_world.h"
#include "support/sanitized.h"

#include <sstream>

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>

namespace handhold::testing {
namespace {

using ::testing::HasSubstr;
using ::testing::StrEq;
using Json = nlohmann::json;

constexpr const char* kScene =
    R"({"id":1,"op":"scene","scene":{"robot":{"joints":"home"},"target":{"object":"toy_box","pose":{"position":[0.5,0.1,0]}},)"
    R"("obstacles":[{"name":"table","box":[0.7,1.2,0.04],"pose":{"position":[0.6,0,-0.02]}}]}})";

class ServerTest : public PlanWorld {
 protected:
  Json ask(const std::string& line) { return Json::parse(server_.answer(line)); }
  std::string errorOf(const std::string& line) {
    const Json answer = ask(line);
    EXPECT_FALSE(answer["ok"].get<bool>()) << answer.dump();
    return answer.value("error", "");
  }

  Planner planner_ = puma();
  PlanServer server_{planner_};
};

TEST_F(ServerTest, AnswersEveryOperation) {
  Json answer = ask(kScene);
  ASSERT_TRUE(answer["ok"]) << answer.dump();
  EXPECT_EQ(answer["id"], 1);
  EXPECT_EQ(answer["result"]["obstacles"], 1);
  answer = ask(
      R"({"id":"a","op":"add","obstacle":{"name":"post","cylinder":{"radius":0.03,"length":0.2},"pose":{"position":[0.5,-0.1,0.1]}}})");
  ASSERT_TRUE(answer["ok"]) << answer.dump();
  EXPECT_EQ(answer["id"], "a");
  EXPECT_EQ(answer["result"]["obstacles"], 2);
  EXPECT_TRUE(ask(R"({"op":"move","name":"post","pose":{"position":[0.5,-0.2,0.1]}})")["ok"]);
  EXPECT_EQ(planner_.scene().obstacles[1].X_WS.translation().y(), -0.2);
  answer = ask(R"({"op":"rank","top":3,"score":"reach"})");
  ASSERT_TRUE(answer["ok"]);
  EXPECT_EQ(answer["result"]["grasps"].size(), 3u);
  answer = ask(R"({"op":"plan"})");
  ASSERT_TRUE(answer["ok"]);
  ASSERT_EQ(answer["result"]["status"], "planned") << answer.dump();
  const Json& trajectory = answer["result"]["trajectory"];
  EXPECT_EQ(trajectory["joint_names"].size(), trajectory["points"][0]["positions"].size());
  // Where the plan ends, the next one begins.
  Json joints;
  for (std::size_t i = 0; i < 6; ++i)
    joints[trajectory["joint_names"][i].get<std::string>()] = trajectory["points"].back()["positions"][i];
  EXPECT_TRUE(ask(Json{{"op", "joints"}, {"joints", joints}}.dump())["ok"]);
  EXPECT_TRUE(ask(R"({"op":"joints","joints":"home"})")["ok"]);
  EXPECT_TRUE(ask(R"({"op":"target","pose":{"position":[0.45,0.1,0]}})")["ok"]);
  EXPECT_EQ(planner_.scene().X_WO.translation().x(), 0.45);
  EXPECT_TRUE(ask(R"({"op":"remove","name":"post"})")["ok"]);
  EXPECT_EQ(planner_.scene().obstacles.size(), 1u);
  EXPECT_FALSE(server_.hasQuit());
  EXPECT_TRUE(ask(R"({"op":"quit"})")["ok"]);
  EXPECT_TRUE(server_.hasQuit());
}

TEST_F(ServerTest, RefusesInOneLine) {
  EXPECT_THAT(errorOf("{"), StrEq("is no JSON: byte 2 is not what was expected"));
  EXPECT_THAT(errorOf("[1]"), StrEq("want one JSON object a line"));
  EXPECT_THAT(errorOf("{}"), StrEq("op is missing"));
  EXPECT_THAT(errorOf(R"({"op":3})"), StrEq("op is 3, want a text"));
  EXPECT_THAT(errorOf(R"({"op":"dance"})"),
              StrEq("op is \"dance\", want scene, add, move, remove, target, joints, rank, plan or quit"));
  EXPECT_THAT(errorOf(R"({"op":"rank"})"), StrEq("no scene was given, want one first"));
  ASSERT_TRUE(ask(kScene)["ok"]);
  EXPECT_THAT(errorOf(R"({"op":"rank","colour":1})"), StrEq("colour is no key of rank, want one of: score, top"));
  EXPECT_THAT(errorOf(R"({"op":"rank","score":"best"})"), StrEq("score is \"best\", want paper or reach"));
  EXPECT_THAT(errorOf(R"({"op":"rank","top":-1})"), StrEq("top is -1, want a whole number >= 0"));
  EXPECT_THAT(errorOf(R"({"op":"plan","deadline_ms":0})"), StrEq("deadline_ms is 0, want a number > 0"));
  EXPECT_THAT(errorOf(R"({"op":"move","name":"chair","pose":{}})"),
              StrEq("name is \"chair\", want an obstacle of the scene"));
  EXPECT_THAT(errorOf(R"({"op":"target","pose":{"orientation":[0,0,0,2]}})"), HasSubstr("orientation"));
  EXPECT_THAT(errorOf(R"({"op":"target","object":"teapot"})"), HasSubstr("has no object teapot"));
  EXPECT_THAT(errorOf(R"({"op":"joints","joints":{"elbow":1}})"), HasSubstr("robot.joints.elbow is no joint"));
  EXPECT_THAT(errorOf(R"({"op":"add","obstacle":{"name":"table","sphere":{"radius":0.1}}})"),
              HasSubstr("obstacle.name is \"table\", which the scene has"));
  EXPECT_THAT(errorOf(R"({"op":"scene","scene":{"target":{"object":"toy_box"}}})"), HasSubstr("pose"));
  EXPECT_EQ(errorOf(R"({"op":"scene","file":"/nowhere.yaml"})").find('\n'), std::string::npos);
  // The scene is the one before.
  EXPECT_EQ(planner_.scene().obstacles.size(), 1u);
  EXPECT_EQ(planner_.scene().target, "toy_box");
}

/// Requests of all kinds with bytes changed, cut, doubled: each gets one answer, and the server still plans.
TEST_F(ServerTest, MutatedRequestsNeverStopIt) {
  const std::vector<std::string> seeds = {
      kScene,
      R"({"id":2,"op":"add","obstacle":{"name":"b","box":[0.1,0.1,0.1],"pose":{"position":[0.3,-0.4,0.05],"orientation":[0,0,0,1]}}})",
      R"({"id":3,"op":"add","obstacle":{"name":"c","sphere":{"radius":0.02},"pose":{"position":[0.3,-0.5,0.05]}}})",
      R"({"id":4,"op":"move","name":"b","pose":{"position":[0.3,-0.4,0.06]}})",
      R"({"id":5,"op":"remove","name":"c"})",
      R"({"id":6,"op":"target","object":"toy_box","pose":{"position":[0.5,0.1,0]}})",
      R"({"id":7,"op":"joints","joints":{"joint_1":0.1,"finger_1":0.02}})",
      R"({"id":8,"op":"rank","top":2,"score":"paper"})",
      R"({"id":9,"op":"plan","deadline_ms":1,"prefer":3,"trace":true})",
  };
  ASSERT_TRUE(ask(kScene)["ok"]);
  const int count = kSanitized ? 1000 : 10'000;
  const RandomStream stream(2007);
  int good = 0;
  for (int i = 0; i < count; ++i) {
    const RandomStream item = stream.child(static_cast<std::uint64_t>(i));
    std::string line = seeds[item.bits(0) % seeds.size()];
    const std::size_t changes = item.bits(1) % 4;
    for (std::size_t k = 0; k < changes && !line.empty(); ++k) {
      const std::size_t at = item.bits(2 + 3 * k) % line.size();
      switch (item.bits(3 + 3 * k) % 5) {
        case 0:
          line[at] = static_cast<char>(item.bits(4 + 3 * k) % 256);
          break;
        case 1:
          line.erase(at, 1 + item.bits(4 + 3 * k) % 5);
          break;
        case 2:
          line.insert(at, line.substr(at, item.bits(4 + 3 * k) % 20));
          break;
        case 3:
          line[at] = "0123456789-.eE[]{}\",:"[item.bits(4 + 3 * k) % 21];
          break;
        default:
          line.resize(at);
          break;
      }
    }
    if (line.find("\"quit\"") != std::string::npos) continue;
    const std::string answer = server_.answer(line);
    const Json parsed = Json::parse(answer, nullptr, false);
    ASSERT_FALSE(parsed.is_discarded()) << line << "\n" << answer;
    ASSERT_TRUE(parsed.contains("id") && parsed.contains("ok")) << line;
    ASSERT_NE(parsed.contains("result"), parsed.contains("error")) << line;
    ASSERT_EQ(answer.find('\n'), std::string::npos);
    good += parsed["ok"].get<bool>() ? 1 : 0;
  }
  EXPECT_GT(good, count / 8);  // not all were turned away at the door
  ASSERT_TRUE(ask(kScene)["ok"]);
  EXPECT_EQ(ask(R"({"op":"plan"})")["result"]["status"], "planned");
}

TEST_F(ServerTest, ARecordReplays) {
  std::istringstream in(std::string(kScene) + "\n\nnonsense\n" + R"({"id":2,"op":"rank","top":5})" + "\n" +
                        R"({"id":3,"op":"plan"})" + "\n" + R"({"id":4,"op":"plan","deadline_ms":0.001})" + "\n" +
                        R"({"id":5,"op":"quit"})" + "\n{\"op\":\"rank\"}\n");
  std::ostringstream out, record;
  serve(server_, in, out, &record);
  std::istringstream lines(out.str());
  std::vector<std::string> answers;
  for (std::string line; std::getline(lines, line);) answers.push_back(line);
  ASSERT_EQ(answers.size(), 6u);  // the empty line is none, nothing is read after quit
  EXPECT_TRUE(Json::parse(answers[4])["result"]["stopped"]) << answers[4];

  Planner another = puma();
  PlanServer fresh(another);
  std::istringstream recorded(record.str());
  std::ostringstream report;
  EXPECT_TRUE(replay(fresh, recorded, "record", report)) << report.str();
  EXPECT_THAT(report.str(), StrEq("replayed 6 requests, 0 answers differ\n"));

  std::string changed = record.str();
  changed.replace(changed.find("\"ok\":false"), 10, "\"ok\":true ");
  std::istringstream tampered(changed);
  std::ostringstream differing;
  EXPECT_FALSE(replay(fresh, tampered, "record", differing));
  EXPECT_THAT(differing.str(), HasSubstr("record:2: the answer differs"));
  std::istringstream broken("{}\n");
  EXPECT_THAT(refusalOf([&] { replay(fresh, broken, "record", differing); }),
              StrEq("record:1: is no line of a record, want request and answer"));
}

}  // namespace
}  // namespace handhold::testing
