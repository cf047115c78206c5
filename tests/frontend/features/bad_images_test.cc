// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>

#include "files/image_reading.h"
#include "frontend/features/extraction_fixture.h"
#include "mgsfm/base/error.h"
#include "support/error_of.h"

namespace mgsfm {
namespace {

using testing::HasSubstr;

void AppendShort(int value, std::string* bytes) {
  *bytes += static_cast<char>(value & 255);
  *bytes += static_cast<char>(value >> 8 & 255);
}

// An uncompressed TIFF file of four inks (TIFF 6.0, section 16) of which only
// black, the last, is used.
std::string CmykTiff(const GrayImage& gray) {
  constexpr int kShort = 3;
  constexpr int kLong = 4;
  constexpr int kInks = 5;
  const auto width = static_cast<int>(gray.cols());
  const auto height = static_cast<int>(gray.rows());
  constexpr int kNumEntries = 10;
  constexpr int kBitsBegin = 8 + 2 + 12 * kNumEntries + 4;
  constexpr int kPixelsBegin = kBitsBegin + 8;
  const int entries[kNumEntries][4] = {{256, kShort, 1, width},
                                       {257, kShort, 1, height},
                                       {258, kShort, 4, kBitsBegin},
                                       {259, kShort, 1, 1},
                                       {262, kShort, 1, kInks},
                                       {273, kLong, 1, kPixelsBegin},
                                       {277, kShort, 1, 4},
                                       {278, kShort, 1, height},
                                       {279, kLong, 1, 4 * width * height},
                                       {284, kShort, 1, 1}};
  std::string bytes = "II";
  AppendShort(42, &bytes);
  AppendShort(8, &bytes);
  AppendShort(0, &bytes);
  AppendShort(kNumEntries, &bytes);
  for (const auto& entry : entries) {
    AppendShort(entry[0], &bytes);
    AppendShort(entry[1], &bytes);
    AppendShort(entry[2], &bytes);
    AppendShort(0, &bytes);
    AppendShort(entry[3], &bytes);
    AppendShort(entry[3] >> 16, &bytes);
  }
  bytes.append(4, '\0');
  for (int i = 0; i < 4; ++i) AppendShort(8, &bytes);
  for (Eigen::Index i = 0; i < gray.size(); ++i) {
    bytes.append(3, '\0');
    bytes += static_cast<char>(255 - gray.data()[i]);
  }
  return bytes;
}

// Appends bits, most significant first, with a zero byte after each 0xff.
class JpegBits {
 public:
  explicit JpegBits(std::string* bytes) : bytes_(bytes) {}
  void Add(int value, int num_bits) {
    for (int i = num_bits - 1; i >= 0; --i) {
      byte_ = byte_ << 1 | (value >> i & 1);
      if (++num_bits_ < 8) continue;
      *bytes_ += static_cast<char>(byte_);
      if (byte_ == 0xff) *bytes_ += '\0';
      byte_ = num_bits_ = 0;
    }
  }
  void Finish() {
    while (num_bits_ > 0) Add(1, 1);
  }

 private:
  std::string* bytes_;
  int byte_ = 0;
  int num_bits_ = 0;
};

void AppendBytes(const std::vector<int>& values, std::string* bytes) {
  for (const int value : values) *bytes += static_cast<char>(value);
}

// A baseline JPEG file of four components (ITU-T T.81) in which each 8 x 8
// block has one value, a pixel of `gray` for the last and 255 for the others:
// inverted CMYK, as is common. Only DC terms are coded, their lengths with
// codes of 4 bits; the end of a block has code 0.
std::string CmykJpeg(const GrayImage& gray) {
  const auto width = 8 * static_cast<int>(gray.cols());
  const auto height = 8 * static_cast<int>(gray.rows());
  std::string bytes;
  AppendBytes({0xff, 0xd8, 0xff, 0xdb, 0, 67, 0}, &bytes);
  AppendBytes(std::vector<int>(64, 1), &bytes);
  AppendBytes(
      {0xff,       0xc0,        0, 20,   8,    height >> 8, height & 255,
       width >> 8, width & 255, 4, 1,    0x11, 0,           2,
       0x11,       0,           3, 0x11, 0,    4,           0x11,
       0},
      &bytes);
  AppendBytes({0xff, 0xc4, 0, 31, 0, 0, 0, 0, 12, 0, 0, 0, 0, 0, 0,  0, 0,
               0,    0,    0, 0,  0, 1, 2, 3, 4,  5, 6, 7, 8, 9, 10, 11},
              &bytes);
  AppendBytes({0xff, 0xc4, 0, 20, 0x10, 1, 0, 0, 0, 0, 0,
               0,    0,    0, 0,  0,    0, 0, 0, 0, 0, 0},
              &bytes);
  AppendBytes({0xff, 0xda, 0, 14, 4, 1, 0, 2, 0, 3, 0, 4, 0, 0, 63, 0}, &bytes);
  JpegBits bits(&bytes);
  int before[4] = {};
  for (Eigen::Index i = 0; i < gray.size(); ++i) {
    for (int component = 0; component < 4; ++component) {
      const int value = component == 3 ? gray.data()[i] : 255;
      const int constant = 8 * (value - 128);
      const int change = constant - before[component];
      before[component] = constant;
      int length = 0;
      while (std::abs(change) >> length != 0) ++length;
      bits.Add(length, 4);
      bits.Add(change < 0 ? change + (1 << length) - 1 : change, length);
      bits.Add(0, 1);
    }
  }
  bits.Finish();
  AppendBytes({0xff, 0xd9}, &bytes);
  return bytes;
}

class BadImagesTest : public ExtractionTest {
 protected:
  BadImagesTest() { WriteBlobs("good.png", 1); }

  // The image is rejected with a warning that names it and the reason; the good
  // image is processed.
  void ExpectRejected(const std::string& name, const std::string& why,
                      const FeatureExtractionOptions& options = {}) {
    const FeatureExtractionSummary summary = Extract(options);
    EXPECT_EQ(summary.num_rejected, 1u);
    EXPECT_EQ(warnings_.size(), 1u);
    EXPECT_TRUE(IsWarned(name, why)) << testing::PrintToString(warnings_);
    const auto images = Images();
    EXPECT_EQ(images.size(), 1u);
    EXPECT_EQ(images.count("good.png"), 1u);
    EXPECT_EQ(Structure().cameras.size(), 1u);
  }
  // Writes a mask that hides the last row of good.png.
  std::string WriteSoundMask() const {
    const std::filesystem::path folder = dir_.path() / "masks";
    std::filesystem::create_directories(folder);
    cv::Mat mask(90, 120, CV_8U, cv::Scalar(255));
    mask.row(89).setTo(0);
    EXPECT_TRUE(cv::imwrite((folder / "good.png.png").string(), mask));
    return folder.string();
  }
  // Truncates the file.
  void Truncate(const std::string& name, double part) const {
    const auto size = std::filesystem::file_size(ImagePath(name));
    std::filesystem::resize_file(
        ImagePath(name),
        static_cast<uintmax_t>(part * static_cast<double>(size)));
  }
};

TEST_F(BadImagesTest, ZeroBytes) {
  WriteTextFile(ImagePath("bad.jpg"), "");
  ExpectRejected("bad.jpg", "is empty");
}

TEST_F(BadImagesTest, Text) {
  WriteTextFile(ImagePath("notes.txt"), "no image\n");
  ExpectRejected("notes.txt", "not an image");
}

TEST_F(BadImagesTest, TextNamedAsImage) {
  WriteTextFile(ImagePath("bad.png"), std::string(5000, 'x'));
  ExpectRejected("bad.png", "not an image");
}

TEST_F(BadImagesTest, TruncatedJpeg) {
  for (const double part : {0.99, 0.5, 0.05}) {
    WriteBlobs("bad.jpg", 2);
    Truncate("bad.jpg", part);
    std::filesystem::remove(DatabasePath());
    warnings_.clear();
    ExpectRejected("bad.jpg", "is truncated");
  }
}

TEST_F(BadImagesTest, TruncatedPng) {
  for (const double part : {0.9, 0.5, 0.05}) {
    WriteBlobs("bad.png", 2);
    Truncate("bad.png", part);
    std::filesystem::remove(DatabasePath());
    warnings_.clear();
    ExpectRejected("bad.png", "is truncated");
  }
}

TEST_F(BadImagesTest, SizeDiffersFromCamera) {
  WriteBlobs("later.png", 2, 121, 90);
  ExpectRejected("later.png",
                 "has 121 x 90 pixels, but its camera has 120 x 90");
}

TEST_F(BadImagesTest, MaskOfDifferentSize) {
  WriteBlobs("later.png", 2);
  FeatureExtractionOptions options;
  options.reader.mask_path = WriteSoundMask();
  cv::imwrite((dir_.path() / "masks/later.png.png").string(),
              cv::Mat(90, 100, CV_8U, cv::Scalar(255)));
  ExpectRejected("later.png", "100 x 90", options);
}

TEST_F(BadImagesTest, MaskIsNotAnImage) {
  WriteBlobs("later.png", 2);
  FeatureExtractionOptions options;
  options.reader.mask_path = WriteSoundMask();
  WriteTextFile(dir_.path() / "masks/later.png.png", "no image");
  ExpectRejected("later.png", "has a mask", options);
}

TEST_F(BadImagesTest, MasksThatAreNoFolderOrFile) {
  FeatureExtractionOptions options;
  for (const std::string& path :
       {(dir_.path() / "nowhere").string(), ImagePath("good.png").string()}) {
    options.reader.mask_path = path;
    EXPECT_THAT(ErrorOf([&] { Extract(options); }),
                AllOf(HasSubstr(path), HasSubstr("is not a folder")));
  }
  options.reader.mask_path = "";
  options.reader.camera_mask_path = dir_.path().string();
  EXPECT_THAT(ErrorOf([&] { Extract(options); }),
              HasSubstr("the image folder itself"));
}

TEST_F(BadImagesTest, MasksThatHideEverything) {
  cv::Mat black(90, 120, CV_8U, cv::Scalar(0));
  const std::filesystem::path folder = dir_.path() / "masks";
  std::filesystem::create_directory(folder);
  ASSERT_TRUE(cv::imwrite((folder / "good.png.png").string(), black));
  FeatureExtractionOptions options;
  options.reader.mask_path = folder.string();
  Extract(options);
  options.reader.mask_path = "";
  options.reader.camera_mask_path = (folder / "good.png.png").string();
  std::filesystem::remove(DatabasePath());
  Extract(options);
  EXPECT_EQ(std::count_if(warnings_.begin(), warnings_.end(),
                          [](const std::string& warning) {
                            return warning.find("hide the whole image") !=
                                   std::string::npos;
                          }),
            2);
}

// Such images are kept, as in COLMAP, with a warning.
TEST_F(BadImagesTest, NoFeatures) {
  WriteImage("flat.png", cv::Mat(90, 120, CV_8U, cv::Scalar(99)));
  EXPECT_EQ(Extract().num_extracted, 2u);
  EXPECT_TRUE(IsWarned("flat.png", "has no features"));
  EXPECT_TRUE(Images().at("flat.png").keypoints.empty());
  EXPECT_EQ(Extract().num_present, 2u);
}

// Bit depth and color do not change the features.
TEST_F(BadImagesTest, ReadsSixteenBitAndColorImages) {
  GrayImage gray = RenderBlobs(RandomBlobs(80, 120, 90, 1), 120, 90);
  gray(0, 0) = 255;  // the brightest
  cv::Mat image(90, 120, CV_8U);
  std::copy_n(gray.data(), gray.size(), image.data);
  WriteImage("good.png", image);
  cv::Mat deep;
  image.convertTo(deep, CV_16U, 257.0);
  WriteImage("deep.png", deep);
  WriteImage("deep.tif", deep);
  // 12 bits in 16, as of many industrial cameras.
  image.convertTo(deep, CV_16U, 16.0);
  WriteImage("twelve.png", deep);
  cv::Mat color;
  cv::merge(std::vector<cv::Mat>{image, image, image}, color);
  WriteImage("color.png", color);
  cv::merge(std::vector<cv::Mat>{image, image, image, image}, color);
  WriteImage("transparent.png", color);
  WriteTextFile(ImagePath("cmyk.tif"), CmykTiff(gray));
  Extract();
  EXPECT_TRUE(warnings_.empty()) << testing::PrintToString(warnings_);
  const auto images = Images();
  const size_t num = images.at("good.png").keypoints.size();
  for (const char* name :
       {"deep.png", "deep.tif", "twelve.png", "color.png", "transparent.png"}) {
    EXPECT_EQ(images.at(name).descriptors, images.at("good.png").descriptors)
        << name;
  }
  EXPECT_NEAR(static_cast<double>(images.at("cmyk.tif").keypoints.size()),
              static_cast<double>(num), 0.2 * static_cast<double>(num));
}

TEST_F(BadImagesTest, ReadsCmykJpeg) {
  GrayImage small(20, 30);
  Random random(4);
  for (auto& pixel : small.reshaped()) {
    pixel = static_cast<uint8_t>(random.Index(256));
  }
  cv::Mat image(160, 240, CV_8U);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      image.at<uint8_t>(y, x) = small(y / 8, x / 8);
    }
  }
  WriteImage("cam/gray.png", image);
  WriteTextFile(ImagePath("cam/cmyk.jpg"), CmykJpeg(small));
  Extract();
  EXPECT_TRUE(warnings_.empty()) << testing::PrintToString(warnings_);
  const auto images = Images();
  const auto num =
      static_cast<double>(images.at("cam/gray.png").keypoints.size());
  EXPECT_GT(num, 50.0);
  EXPECT_NEAR(static_cast<double>(images.at("cam/cmyk.jpg").keypoints.size()),
              num, 0.1 * num);
}

TEST_F(BadImagesTest, NoUsableImageIsAnError) {
  std::filesystem::remove(ImagePath("good.png"));
  EXPECT_THROW(Extract(), Error);  // an empty folder
  WriteTextFile(ImagePath("notes.txt"), "no image\n");
  EXPECT_THROW(Extract(), Error);
  std::filesystem::remove_all(ImagePath(""));
  EXPECT_THROW(Extract(), Error);  // no folder
}

// A decompression bomb: a small file that states more pixels than it has.
TEST_F(BadImagesTest, TooManyPixels) {
  WriteBlobs("bad.png", 2);
  std::string file = ReadTextFile(ImagePath("bad.png"));
  file.replace(16, 8, std::string("\0\1\0\0\0\1\0\0", 8));
  WriteTextFile(ImagePath("bad.png"), file);
  ExpectRejected("bad.png", "has 65536 x 65536 pixels, more than 200000000");
}

TEST_F(BadImagesTest, ThePixelBudgetIsAnOption) {
  WriteBlobs("later.png", 2, 121, 90);
  FeatureExtractionOptions options;
  options.reader.single_camera_per_image = true;
  options.reader.max_num_pixels = 120 * 90;
  ExpectRejected("later.png", "has 121 x 90 pixels, more than 10800", options);
}

// The header is read by our own code, the pixels by OpenCV.
TEST_F(BadImagesTest, SizesAreThoseOfTheDecoder) {
  const cv::Mat image(37, 1023, CV_8UC3, cv::Scalar(9, 99, 199));
  for (const char* extension :
       {".jpg", ".png", ".tif", ".bmp", ".webp", ".ppm"}) {
    std::vector<uint8_t> bytes;
    ASSERT_TRUE(cv::imencode(extension, image, bytes)) << extension;
    const std::string file(bytes.begin(), bytes.end());
    const auto size = ReadImageSize(file);
    ASSERT_TRUE(size) << extension;
    EXPECT_EQ(size->width, 1023) << extension;
    EXPECT_EQ(size->height, 37) << extension;
    // Headers that are cut off anywhere, or changed, do no harm.
    for (size_t i = 0; i < std::min<size_t>(file.size(), 200); ++i) {
      (void)ReadImageSize(file.substr(0, i));
      std::string changed = file;
      changed[i] = static_cast<char>(~changed[i]);
      (void)ReadImageSize(changed);
    }
  }
  EXPECT_EQ(ReadImageSize("P2 # a comment\n#another\n 640\t480 255 ")->height,
            480);
  EXPECT_FALSE(ReadImageSize("P5 0 480 255 "));
}

// Bytes between two segments, which libjpeg skips with a message.
TEST_F(BadImagesTest, MessagesOfDecodersBecomeOneWarning) {
  WriteBlobs("odd.jpg", 1);
  std::string file = ReadTextFile(ImagePath("odd.jpg"));
  constexpr size_t kEndOfFirstSegment = 20;
  file.insert(kEndOfFirstSegment, "some bytes");
  WriteTextFile(ImagePath("odd.jpg"), file);
  testing::internal::CaptureStderr();
  EXPECT_EQ(Extract().num_extracted, 2u);
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_TRUE(IsWarned("odd.jpg", "may be damaged: Corrupt JPEG data"))
      << warnings_[0];
}

// Some decoders of OpenCV print their exceptions.
TEST_F(BadImagesTest, ExceptionsOfDecodersBecomeOneWarning) {
  WriteTextFile(ImagePath("bad.ppm"), "P6 30 20 255\n123");
  testing::internal::CaptureStderr();
  ExpectRejected("bad.ppm", "is damaged");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST_F(BadImagesTest, NamesThatNoDatabaseHolds) {
  WriteBlobs("bad\xff.png", 2);
  ExpectRejected("bad\xff.png", "is not valid UTF-8; rename the file");
}

TEST_F(BadImagesTest, LinksToOuterFolders) {
  WriteBlobs("a/b/inner.png", 2);
  for (const char* link : {"self", "a/up", "a/b/up"}) {
    std::filesystem::create_directory_symlink(ImagePath(""), ImagePath(link));
  }
  std::filesystem::create_directory_symlink(ImagePath("a/b"), ImagePath("c"));
  EXPECT_EQ(
      ListImages(ImagePath("").string(), ""),
      (std::vector<std::string>{"a/b/inner.png", "c/inner.png", "good.png"}));
}

}  // namespace
}  // namespace mgsfm
