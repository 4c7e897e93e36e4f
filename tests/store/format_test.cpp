#include "store/database.h"
#include "store/synthetic_set.h"

#include <cstdlib>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace handhold {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

const std::string kSource = HANDHOLD_SOURCE_DIR;

/// Holds sets against a table with tests/store/check_format.py.
class FormatPage : public testing::Test {
 protected:
  void SetUp() override {
    if (std::system("/usr/bin/python3 -c 'import h5py' 2>/dev/null") != 0) GTEST_SKIP() << "needs python3-h5py";
    set_ = Database(folder_.path()).write(syntheticSet());
    empty_ = Database(folder_.path()).write(syntheticSet({.samples = 2, .rolls = 1, .preshapes = 1, .grasps = 0}));
  }

  /// True when the sets are as `page` says; what the script prints is kept in `output_`.
  bool holds(const std::string& page) {
    const fs::path pagePath = folder_.path() / "FORMAT.md", output = folder_.path() / "output.txt";
    writeBytes(pagePath, page);
    const std::string command = "/usr/bin/python3 " + kSource + "/tests/store/check_format.py --format " +
                                pagePath.string() + " " + set_.string() + " " + empty_.string() + " > " +
                                output.string() + " 2>&1";
    const bool good = std::system(command.c_str()) == 0;
    output_ = bytesOf(output);
    return good;
  }

  /// The page with one text in it replaced by another.
  static std::string pageWith(const std::string& text, const std::string& other) {
    std::string page = bytesOf(kSource + "/db/FORMAT.md");
    const std::size_t position = page.find(text);
    EXPECT_NE(position, std::string::npos) << text;
    return page.replace(position, text.size(), other);
  }

  TestFolder folder_;
  fs::path set_, empty_;
  std::string output_;
};

TEST_F(FormatPage, DescribesWhatIsWritten) {
  EXPECT_TRUE(holds(bytesOf(kSource + "/db/FORMAT.md"))) << output_;
  EXPECT_EQ(std::count(output_.begin(), output_.end(), '\n'), 2) << output_;
}

// The guard itself: each kind of difference between page and file is found.
TEST_F(FormatPage, DifferencesAreFound) {
  struct Case {
    const char *text, *other, *message;
  };
  const Case cases[] = {
      {"| `/grasps/roll` |", "| /grasps/roll |", "/grasps/roll is not in the table"},
      {"| `/@seed` |", "| `/@sed` |", "/@sed is missing"},
      {"| `/@seed` |", "| `/@sed` |", "/@seed is not in the table"},
      {"| `/hand/links/<link>/vertices` |", "| `/hand/links/<link>/points` |", "/hand/links/%2E/points is missing"},
      {"| `/grasps/backoff` | (n) | f4 |", "| `/grasps/backoff` | (n) | f8 |",
       "/grasps/backoff is of type f4, want f8"},
      {"| `/@job` | () | text |", "| `/@job` | () | u4 |", "/@job is of type text, want u4"},
      {"| `/grasps/contact_begin` | (n+1) |", "| `/grasps/contact_begin` | (n) |",
       "/grasps/contact_begin has shape (18,)"},
      {"| `/contacts/link` | (C) |", "| `/contacts/link` | (C, 1) |", "/contacts/link has shape "},
      {"| `/samples/point` | (N, 3) | f4 | m |", "| `/samples/point` | (N, 3) | f4 | direction |",
       "whose length is off"},
      {"| `/samples/normal` | (N, 3) | f4 | direction |", "| `/samples/normal` | (N, 3) | f4 | share |",
       "whose sum is off"},
  };
  for (const Case& c : cases) {
    EXPECT_FALSE(holds(pageWith(c.text, c.other))) << c.text;
    EXPECT_THAT(output_, HasSubstr(c.message));
  }
}

// The page explains every outcome that the policy knows.
TEST(FormatPageText, ExplainsEveryOutcome) {
  const std::string page = bytesOf(kSource + "/db/FORMAT.md");
  for (const std::string_view name : kOutcomeNames) {
    EXPECT_THAT(page, HasSubstr("\n| `" + std::string(name) + "` | "));
  }
}

}  // namespace
}  // namespace handhold
