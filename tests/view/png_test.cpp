#include "view/png.h"

#include "core/error.h"
#include "core/file.h"

#include <string>

#include <gtest/gtest.h>
#include <png.h>
#include <stdlib.h>

namespace handhold {
namespace {

namespace fs = std::filesystem;

class Png : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "handhold-png-XXXXXX").string();
    folder_ = ::mkdtemp(name.data());
  }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path folder_;
};

/// 5 x 3 pixels, all bytes different.
Image countingImage() {
  Image image{5, 3, {}};
  for (int i = 0; i < 45; ++i) image.rgb.push_back(static_cast<std::uint8_t>(5 * i));
  return image;
}

Image readPng(const fs::path& path) {
  png_image header{};
  header.version = PNG_IMAGE_VERSION;
  EXPECT_NE(png_image_begin_read_from_file(&header, path.c_str()), 0) << header.message;
  EXPECT_EQ(header.format, static_cast<png_uint_32>(PNG_FORMAT_RGB));
  Image image{static_cast<int>(header.width), static_cast<int>(header.height), {}};
  image.rgb.resize(PNG_IMAGE_SIZE(header));
  EXPECT_NE(png_image_finish_read(&header, nullptr, image.rgb.data(), 0, nullptr), 0) << header.message;
  return image;
}

TEST_F(Png, ReadsBackEqual) {
  writePng(countingImage(), folder_ / "a.png");
  const Image read = readPng(folder_ / "a.png");
  EXPECT_EQ(read.width, 5);
  EXPECT_EQ(read.height, 3);
  EXPECT_EQ(read.rgb, countingImage().rgb);
}

// The same picture gives the same bytes, without a time; an old file is replaced and no other is left behind.
TEST_F(Png, SameBytesAndNothingElse) {
  writePng(countingImage(), folder_ / "a.png");
  const std::string first = readFile(folder_ / "a.png");
  writePng(Image{1, 1, {1, 2, 3}}, folder_ / "a.png");
  EXPECT_NE(readFile(folder_ / "a.png"), first);
  writePng(countingImage(), folder_ / "a.png");
  EXPECT_EQ(readFile(folder_ / "a.png"), first);
  EXPECT_EQ(first.find("tIME"), std::string::npos);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 1);
}

TEST_F(Png, RefusesAFolderThatIsNotThere) {
  const fs::path path = folder_ / "missing" / "a.png";
  try {
    writePng(countingImage(), path);
    FAIL() << "written";
  } catch (const SystemError& error) {
    EXPECT_EQ(error.what(), path.string() + ": cannot be written: No such file or directory");
  }
}

TEST_F(Png, RefusesAFolderInItsPlace) {
  fs::create_directory(folder_ / "a.png");
  EXPECT_THROW(writePng(countingImage(), folder_ / "a.png"), SystemError);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 1);
}

}  // namespace
}  // namespace handhold
