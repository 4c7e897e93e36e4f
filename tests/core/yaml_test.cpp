#include "core/yaml.h"

#include "core/error.h"

#include <numbers>
#include <string>
#include <string_view>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using testing::HasSubstr;
using testing::StrEq;

constexpr double kQuaternionTol = 2e-3;  // of a rotation's entries: the quaternion may be 1e-3 too long or short

YamlValue parse(const std::string& text) { return YamlValue::parseText(text, "f.yaml"); }

/// The whole message of the InputError that `action` throws; a note when it throws none.
template <typename Action>
std::string messageOf(Action action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  return "nothing was thrown";
}

std::string parseMessage(const std::string& text) {
  return messageOf([&] { parse(text); });
}

/// What reading the value of `x`, in line 2, as a number, text, ... says.
template <typename Read>
std::string readMessage(const std::string& value, Read read) {
  const YamlValue top = parse("# one\nx: " + value + "\n");
  return messageOf([&] { read(top.require("x")); });
}

// ---- Lines, keys, kinds ----------------------------------------------------------------------------------------

TEST(Yaml, EveryValueKnowsItsLineAndKeyPath) {
  const YamlValue top = parse("a: 1\nlist:\n  - {name: x}\n  - name: y\n    deep:\n      end: 2\n");
  EXPECT_EQ(top.where(), "f.yaml:1");
  EXPECT_EQ(top.key(), "");
  const YamlValue& second = top.require("list").items()[1];
  EXPECT_EQ(second.where(), "f.yaml:4");
  EXPECT_EQ(second.key(), "list[1]");
  EXPECT_EQ(second.require("deep").require("end").where(), "f.yaml:6");
  EXPECT_EQ(second.require("deep").require("end").key(), "list[1].deep.end");
}

// An alias stands where it is used: its own key and line are named, not those of the anchor.
TEST(Yaml, AliasIsNamedWhereItStands) {
  const YamlValue top = parse("a: &pose [1, 2]\n\nb: *pose\n");
  EXPECT_THAT(messageOf([&] { top.require("b").vector3(); }),
              StrEq("f.yaml:3: b is a list of 2, want three numbers [x, y, z]"));
}

TEST(Yaml, UnknownKeyIsRefusedWithItsLineAndTheKnownOnes) {
  const YamlValue top = parse("seed: 1\nsede: 2\n");
  EXPECT_THAT(messageOf([&] {
                top.allowKeys({"seed", "keep"});
              }),
              StrEq("f.yaml:2: sede is not a known key, want one of: seed, keep"));
  EXPECT_NO_THROW(top.allowKeys({"sede", "seed", "keep"}));
}

TEST(Yaml, RepeatedKeyIsRefusedWithItsSecondLine) {
  EXPECT_THAT(parseMessage("a: 1\nb: 2\na: 3\n"), StrEq("f.yaml:3: a is given twice, want it once"));
  EXPECT_THAT(parseMessage("top:\n  - {x: 1}\n  - {x: 1,\n     x: 1}\n"),
              StrEq("f.yaml:4: top[1].x is given twice, want it once"));
  EXPECT_THAT(parseMessage("a: 1\n\"a\": 2\n"), HasSubstr("f.yaml:2: a is given twice"));
}

TEST(Yaml, MissingKeyIsRefused) {
  const YamlValue top = parse("a: 1\nb:\n  c: 2\n");
  EXPECT_THAT(messageOf([&] { top.require("seed"); }), StrEq("f.yaml:1: the file has no key \"seed\", want one"));
  EXPECT_THAT(messageOf([&] { top.require("b").require("d"); }), StrEq("f.yaml:2: b has no key \"d\", want one"));
  EXPECT_EQ(top.find("seed"), nullptr);
}

TEST(Yaml, KeyThatIsNoTextIsRefused) {
  EXPECT_THAT(parseMessage("a: 1\n? [x, y]\n: 2\n"), HasSubstr("f.yaml:1: the file has a key that is no plain text"));
  EXPECT_THAT(parseMessage("a:\n  ~: 2\n"), HasSubstr("a has a key that is no plain text"));
}

TEST(Yaml, WrongKindsAreRefusedWithWhatWasFound) {
  const auto asMap = [](const YamlValue& v) { v.entries(); };
  const auto asList = [](const YamlValue& v) { v.items(); };
  const auto asText = [](const YamlValue& v) { v.text(); };
  EXPECT_THAT(readMessage("7", asMap), StrEq("f.yaml:2: x is \"7\", want a map"));
  EXPECT_THAT(readMessage("[1, 2]", asMap), StrEq("f.yaml:2: x is a list of 2, want a map"));
  EXPECT_THAT(readMessage("", asMap), StrEq("f.yaml:2: x is empty, want a map"));
  EXPECT_THAT(readMessage("{a: 1}", asList), StrEq("f.yaml:2: x is a map, want a list"));
  EXPECT_THAT(readMessage("word", asList), StrEq("f.yaml:2: x is \"word\", want a list"));
  EXPECT_THAT(readMessage("~", asList), StrEq("f.yaml:2: x is empty, want a list"));
  EXPECT_THAT(readMessage("[a]", asText), StrEq("f.yaml:2: x is a list of 1, want a text"));
  EXPECT_THAT(readMessage("\"\"", asText), StrEq("f.yaml:2: x is \"\", want a text"));
  EXPECT_THAT(readMessage("[a, [b]]", [](const YamlValue& v) { v.texts(); }),
              StrEq("f.yaml:2: x[1] is a list of 1, want a text"));
  EXPECT_THAT(readMessage("7", [](const YamlValue& v) { v.find("key"); }),
              HasSubstr("f.yaml:2: x is \"7\", want a map"));
  EXPECT_THAT(readMessage("7", [](const YamlValue& v) { v.allowKeys({"key"}); }), HasSubstr("want a map"));
}

// What a person sees stays one line of sensible length, whatever the file holds.
TEST(Yaml, FoundTextIsCutAndStaysOnOneLine) {
  const auto asNumber = [](const YamlValue& v) { v.number(); };
  EXPECT_THAT(readMessage(std::string(500, 'z'), asNumber),
              StrEq("f.yaml:2: x is \"" + std::string(57, 'z') + "...\", want a finite number"));
  EXPECT_THAT(readMessage("\"a\\nb\"", asNumber), StrEq("f.yaml:2: x is \"a b\", want a finite number"));
}

// ---- Numbers ---------------------------------------------------------------------------------------------------

TEST(Yaml, NumbersAreRead) {
  const YamlValue top = parse("a: [0.25, -1e-3, +2, .5, 7, -0]\n");
  const double expected[] = {0.25, -1e-3, 2, 0.5, 7, 0};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_EQ(top.require("a").items()[i].number(), expected[i]) << i;
}

TEST(Yaml, NumbersThatAreNotFiniteAreRefused) {
  for (const char* text :
       {"nan", ".nan", "inf", "-inf", ".inf", "1e999", "abc", "1,5", "1.5 m", "0.5.1", "\"1\\0002\""}) {
    SCOPED_TRACE(text);
    const std::string message = readMessage(text, [](const YamlValue& v) { v.number(); });
    EXPECT_THAT(message, HasSubstr("f.yaml:2: x is "));
    EXPECT_THAT(message, HasSubstr("want a finite number"));
  }
  EXPECT_THAT(readMessage("~", [](const YamlValue& v) { v.number(); }), StrEq("f.yaml:2: x is empty, want a number"));
  EXPECT_THAT(readMessage("[1]", [](const YamlValue& v) { v.number(); }), HasSubstr("x is a list of 1, want a number"));
}

TEST(Yaml, BoundsOfNumbers) {
  EXPECT_THAT(readMessage("-0.02", [](const YamlValue& v) { v.numberAtLeast(0); }),
              StrEq("f.yaml:2: x is \"-0.02\", want a number >= 0"));
  EXPECT_EQ(parse("x: 0").require("x").numberAtLeast(0), 0);
  EXPECT_THAT(readMessage("0", [](const YamlValue& v) { v.positiveNumber(); }),
              StrEq("f.yaml:2: x is \"0\", want a number > 0"));
  EXPECT_EQ(parse("x: 1e-9").require("x").positiveNumber(), 1e-9);
}

TEST(Yaml, IntegersAreWholeAndInRange) {
  for (const char* text : {"1.0", "1e3", "7x", "", "0", "11", "99999999999999999999", "[3]", "\"3\\000\""}) {
    SCOPED_TRACE(text);
    EXPECT_THAT(readMessage(text, [](const YamlValue& v) { v.integer(1, 10); }),
                testing::AllOf(HasSubstr("f.yaml:2: x is "), HasSubstr("want a whole number from 1 to 10")));
  }
  EXPECT_EQ(parse("x: 10").require("x").integer(1, 10), 10);
  EXPECT_EQ(parse("x: -1").require("x").integer(-1, 1), -1);
}

TEST(Yaml, Booleans) {
  EXPECT_TRUE(parse("x: true").require("x").boolean());
  EXPECT_FALSE(parse("x: false").require("x").boolean());
  for (const char* text : {"yes", "1", "True", "", "[true]"}) {
    EXPECT_THAT(readMessage(text, [](const YamlValue& v) { v.boolean(); }), HasSubstr("want true or false")) << text;
  }
}

// ---- Vectors and poses -----------------------------------------------------------------------------------------

TEST(Yaml, Vectors) {
  EXPECT_EQ(parse("x: [1, -2.5, 0]").require("x").vector3(), Eigen::Vector3d(1, -2.5, 0));
  const auto read = [](const YamlValue& v) { v.vector3(); };
  EXPECT_THAT(readMessage("[1, 2]", read), StrEq("f.yaml:2: x is a list of 2, want three numbers [x, y, z]"));
  EXPECT_THAT(readMessage("[1, 2, 3, 4]", read), HasSubstr("a list of 4"));
  EXPECT_THAT(readMessage("1 2 3", read), HasSubstr("want three numbers [x, y, z]"));
  EXPECT_THAT(readMessage("[1, two, 3]", read), StrEq("f.yaml:2: x[1] is \"two\", want a finite number"));
  EXPECT_THAT(readMessage("[1, 2, .inf]", read), HasSubstr("x[2] is \".inf\", want a finite number"));
}

TEST(Yaml, DirectionsAreNormalised) {
  EXPECT_TRUE(parse("x: [0, 3, 4]").require("x").direction().isApprox(Eigen::Vector3d(0, 0.6, 0.8)));
  EXPECT_THAT(readMessage("[0, 0, 0]", [](const YamlValue& v) { v.direction(); }),
              StrEq("f.yaml:2: x is a list of 3, want a direction [x, y, z] that is not zero"));
}

TEST(Yaml, PosePartsAreOptional) {
  const auto pose = [](const std::string& text) { return parse("x: " + text).require("x").pose(); };
  EXPECT_TRUE(pose("{}").isApprox(Eigen::Isometry3d::Identity()));
  EXPECT_TRUE(pose("{position: [1, 2, 3]}").isApprox(Eigen::Isometry3d(Eigen::Translation3d(1, 2, 3))));
  // A quarter turn about z: x becomes y. The scalar stands last.
  const double half = std::numbers::sqrt2 / 2;
  const Eigen::Isometry3d X = pose(fmt::format("{{position: [0, 0, 1], orientation: [0, 0, {}, {}]}}", half, half));
  EXPECT_TRUE((X * Eigen::Vector3d::UnitX()).isApprox(Eigen::Vector3d(0, 1, 1)));
}

TEST(Yaml, QuaternionsMustBeOfUnitLength) {
  const auto read = [](const YamlValue& v) { v.pose(); };
  for (const char* q : {"[0, 0, 0, 0]", "[0, 0, 0, 2]", "[1, 1, 1, 1]", "[0, 0, 0, 1.002]", "[0, 0, 0, 0.998]"}) {
    EXPECT_THAT(readMessage(fmt::format("{{orientation: {}}}", q), read),
                StrEq("f.yaml:2: x.orientation is not of length 1, want a unit quaternion [x, y, z, w]"))
        << q;
  }
  // Within the tolerance it is normalised: the rotation is rigid.
  const Eigen::Isometry3d X = parse("x: {orientation: [0, 0, 0.7075, 0.7075]}").require("x").pose();
  EXPECT_NEAR(X.linear().determinant(), 1, 1e-12);
  EXPECT_NEAR(X.linear()(1, 0), 1, kQuaternionTol);
}

TEST(Yaml, PoseRefusals) {
  const auto read = [](const YamlValue& v) { v.pose(); };
  EXPECT_THAT(readMessage("{orientation: [0, 0, 1]}", read),
              StrEq("f.yaml:2: x.orientation is a list of 3, want four numbers [x, y, z, w]"));
  EXPECT_THAT(readMessage("{orientation: {w: 1}}", read), HasSubstr("want four numbers [x, y, z, w]"));
  EXPECT_THAT(readMessage("{position: [0, 0]}", read), HasSubstr("x.position is a list of 2"));
  EXPECT_THAT(readMessage("{position: [0, 0, 0], rpy: [0, 0, 0]}", read),
              StrEq("f.yaml:2: x.rpy is not a known key, want one of: position, orientation"));
  EXPECT_THAT(readMessage("[0, 0, 0]", read), HasSubstr("x is a list of 3, want a map"));
}

// ---- Whole files -----------------------------------------------------------------------------------------------

TEST(Yaml, EmptyFileIsRefused) {
  for (const char* text : {"", "\n\n", "# only a comment\n", "---\n", "~"}) {
    EXPECT_THAT(parseMessage(text), StrEq("f.yaml: is empty, want keys and values")) << text;
  }
}

TEST(Yaml, SyntaxErrorsNameTheirLine) {
  EXPECT_THAT(parseMessage("a: 1\nb: [1, 2\nc: 3\n"), HasSubstr("is no valid YAML: "));
  EXPECT_THAT(parseMessage("a: 1\nb: 2\n  c: 3\n"), HasSubstr("f.yaml:3: is no valid YAML: "));
  EXPECT_THAT(parseMessage("a: 1\n\tb: 2\n"), HasSubstr("f.yaml:2: is no valid YAML: "));
  EXPECT_THAT(parseMessage("a: 1\nb: *nobody\n"), HasSubstr("f.yaml:2: is no valid YAML: "));
  EXPECT_THAT(parseMessage("a: 1\n}\n"), HasSubstr("f.yaml:"));
}

// Only the first of two documents would be read, and nobody would notice.
TEST(Yaml, SecondDocumentIsRefused) {
  EXPECT_THAT(parseMessage("a: 1\n---\nb: 2\n"), HasSubstr("f.yaml:2: begins another document, want one in the file"));
  EXPECT_EQ(parse("# top\n%YAML 1.2\n---\na: 1 --- 2\nb: -- -\n...\n").require("a").text(), "1 --- 2");
}

TEST(Yaml, MissingFileIsNamed) {
  EXPECT_THAT(messageOf([] { YamlValue::parseFile("/nowhere/job.yaml"); }),
              StrEq("/nowhere/job.yaml: cannot be read: No such file or directory"));
}

// Neither our recursion nor yaml-cpp's may meet the end of the stack.
TEST(Yaml, DeepNestingIsRefused) {
  const auto nested = [](int depth) { return "a: " + std::string(depth, '[') + std::string(depth, ']'); };
  EXPECT_NO_THROW(parse(nested(45)));
  EXPECT_THAT(parseMessage(nested(60)), HasSubstr("is nested too deeply or too large"));
  for (const char* opener : {"[", "{", "- ", "{a: ", "? "}) {
    std::string text;
    for (int i = 0; i < 100'000; ++i) text += opener;
    EXPECT_THAT(parseMessage(text), HasSubstr("f.yaml:")) << opener;
  }
}

// Nine levels of nine aliases are 387 million values in 600 bytes.
TEST(Yaml, AliasBombIsRefused) {
  std::string text = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n";
  for (int i = 1; i < 9; ++i) {
    text += fmt::format("a{0}: &a{0} [*a{1}, *a{1}, *a{1}, *a{1}, *a{1}, *a{1}, *a{1}, *a{1}, *a{1}]\n", i, i - 1);
  }
  EXPECT_THAT(parseMessage(text), HasSubstr("is nested too deeply or too large"));
}

TEST(Yaml, AliasOfItselfIsRefused) {
  EXPECT_THAT(parseMessage("a: &a [1, *a]\n"), HasSubstr("f.yaml:1: "));
  EXPECT_THAT(parseMessage("a: &a {b: *a}\n"), HasSubstr("f.yaml:1: "));
}

// No damage to a good file may end in anything but values or an InputError.
TEST(Yaml, DamagedTextEndsInValuesOrARefusal) {
  const std::string good =
      "catalog:\n  - {name: mug, mesh: \"../mug.obj\", unit: m, pose: {position: [0, 1, 2]}}\nlist: &l\n  - a\n  - "
      "'b'\n"
      "again: *l\ntext: |\n  x\n  y\nseed: 1\n";
  constexpr char kBytes[] = "[]{}:,-&*!|>'\"#%@?~ \n\t\0\xff\x80";
  const std::string_view bytes(kBytes, sizeof kBytes - 1);
  int refused = 0;
  const auto isRefused = [](const std::string& text) {
    const std::string message = parseMessage(text);
    if (message == "nothing was thrown") return 0;
    EXPECT_THAT(message, testing::MatchesRegex("f.yaml:([1-9][0-9]*:)? [^\n]*")) << text;
    return 1;
  };
  for (std::size_t i = 0; i < good.size(); ++i) {
    for (const char byte : bytes) {
      std::string text = good;
      text[i] = byte;
      refused += isRefused(text);
    }
    refused += isRefused(good.substr(0, i));
  }
  EXPECT_GT(refused, 100);
}

}  // namespace
}  // namespace handhold
