// SPDX-License-Identifier: BSD-3-Clause
// COLMAP converts a model to the same files.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <sstream>

#include "addons/exchange/exchange_fixture.h"
#include "mgsfm/models/model_io.h"
#include "support/subprocess.h"

namespace mgsfm {
namespace {

// A file of NVM, Bundler or PLY, with all items as sets: their order is free.
struct ForeignModel {
  std::map<std::string, std::vector<double>> images;
  std::multiset<std::vector<double>> points;
};

// COLMAP writes pixels with six digits.
void ExpectEqual(const ForeignModel& a, const ForeignModel& b) {
  ASSERT_EQ(a.images.size(), b.images.size());
  for (const auto& [name, values] : a.images) {
    EXPECT_THAT(values, testing::Pointwise(testing::DoubleNear(1e-9),
                                           b.images.at(name)));
  }
  ASSERT_EQ(a.points.size(), b.points.size());
  auto other = b.points.begin();
  for (const std::vector<double>& values : a.points) {
    EXPECT_THAT(values,
                testing::Pointwise(testing::DoubleNear(5.1e-3), *other));
    ++other;
  }
}

// Observations as image name, keypoint and pixel, sorted by image.
std::vector<double> PointOf(const std::vector<double>& place,
                            const std::vector<double>& numbers,
                            const std::vector<size_t>& rank_of_image) {
  std::map<size_t, std::vector<double>> observations;
  for (size_t i = 0; i + 3 < numbers.size(); i += 4) {
    const size_t rank = rank_of_image.at(static_cast<size_t>(numbers[i]));
    observations[rank] = {static_cast<double>(rank), numbers[i + 1],
                          numbers[i + 2], numbers[i + 3]};
  }
  std::vector<double> values = place;
  for (const auto& [rank, observation] : observations) {
    values.insert(values.end(), observation.begin(), observation.end());
  }
  return values;
}

std::vector<size_t> Ranks(const std::vector<std::string>& names) {
  std::vector<size_t> ranks;
  for (const std::string& name : names) {
    ranks.push_back(static_cast<size_t>(
        std::count_if(names.begin(), names.end(),
                      [&](const std::string& other) { return other < name; })));
  }
  return ranks;
}

// Points with place, color and observations, the last records of a file.
void ReadPoints(size_t num_points, const std::vector<std::string>& names,
                std::istream* file, ForeignModel* model) {
  for (size_t i = 0; i < num_points; ++i) {
    std::vector<double> place(6);
    for (double& value : place) *file >> value;
    size_t num_observations = 0;
    *file >> num_observations;
    std::vector<double> numbers(4 * num_observations);
    for (double& value : numbers) *file >> value;
    model->points.insert(PointOf(place, numbers, Ranks(names)));
  }
  EXPECT_TRUE(file->good());
}

ForeignModel ParseNvm(const std::string& text) {
  std::istringstream file(text);
  std::string word;
  size_t num_images = 0, num_points = 0;
  file >> word >> num_images;
  EXPECT_EQ(word, "NVM_V3");
  ForeignModel model;
  std::vector<std::string> names(num_images);
  for (std::string& name : names) {
    std::vector<double> values(10);
    file >> name;
    for (double& value : values) file >> value;
    model.images[name] = values;
  }
  file >> num_points;
  ReadPoints(num_points, names, &file, &model);
  return model;
}

ForeignModel ParseBundler(const std::string& text, const std::string& list) {
  const std::vector<std::string> names = Lines(list);
  std::istringstream file(text.substr(text.find('\n')));
  size_t num_images = 0, num_points = 0;
  file >> num_images >> num_points;
  EXPECT_EQ(num_images, names.size());
  ForeignModel model;
  for (const std::string& name : names) {
    std::vector<double> values(15);
    for (double& value : values) file >> value;
    model.images[name] = values;
  }
  ReadPoints(num_points, names, &file, &model);
  return model;
}

ForeignModel ParsePly(const std::string& text) {
  const std::string end = "end_header\n";
  const size_t begin = text.find(end) + end.size();
  ForeignModel model;
  constexpr size_t kSize = 3 * sizeof(float) + 3;
  EXPECT_EQ((text.size() - begin) % kSize, 0u);
  for (size_t i = begin; i + kSize <= text.size(); i += kSize) {
    float position[3];
    std::memcpy(position, text.data() + i, sizeof(position));
    std::vector<double> values(position, position + 3);
    for (size_t k = 0; k < 3; ++k) {
      values.push_back(static_cast<uint8_t>(text[i + sizeof(position) + k]));
    }
    model.points.insert(values);
  }
  return model;
}

// COLMAP converts the same model.
class ColmapConverter : public testing::Test {
 protected:
  void SetUp() override {
    if (RunShell("command -v colmap").exit_code != 0) {
      GTEST_SKIP() << "colmap is not installed";
    }
    drive_ = Drive(RigPreset::kStereo);
    for (Camera& camera : drive_.ground_truth.cameras) {
      const std::vector<double> k = camera.params;
      camera.model = CameraModelId::kSimpleRadial;
      camera.params = {k[0], k[2], k[3], -0.01};
    }
    drive_.scene.cameras = drive_.ground_truth.cameras;
    for (size_t i = 0; i < drive_.ground_truth.points.size(); ++i) {
      drive_.ground_truth.points[i].color = {static_cast<uint8_t>(i), 7, 255};
    }
    WriteModel(dir_.path(), drive_.scene, drive_.ground_truth,
               ModelFormat::kBinary);
  }
  void Convert(const std::string& type) const {
    const CommandOutput run = RunShell(
        "QT_QPA_PLATFORM=offscreen colmap model_converter --input_path " +
        dir_.path().string() + " --output_path " + Path("out") +
        " --output_type " + type);
    ASSERT_EQ(run.exit_code, 0) << run.err;
  }
  std::string Path(const std::string& name) const {
    return (dir_.path() / name).string();
  }

  const TempDir dir_;
  Simulation drive_;
};

// COLMAP leaves the pixels where they are, although NVM has no principal point.
TEST_F(ColmapConverter, WritesTheSameNvmWithoutTheShiftOfPixels) {
  Convert("NVM");
  const Camera& camera = drive_.scene.cameras[0];
  const double shift[2] = {0.5 * camera.width_px - camera.params[1],
                           0.5 * camera.height_px - camera.params[2]};
  const ForeignModel read = ParseNvm(ReadTextFile(Path("out")));
  ForeignModel expected{read.images, {}};
  for (std::vector<double> point : read.points) {
    // Behind place and color: image, keypoint, x and y of each observation.
    for (size_t i = 8; i + 1 < point.size(); i += 4) {
      for (size_t k = 0; k < 2; ++k) point[i + k] += shift[k];
    }
    expected.points.insert(std::move(point));
  }
  ExpectEqual(ParseNvm(Export("nvm", drive_)[0].content), expected);
}

TEST_F(ColmapConverter, WritesTheSameBundle) {
  Convert("Bundler");
  const std::vector<ExportedFile> files = Export("bundler", drive_);
  ASSERT_EQ(files.size(), 2u);
  ExpectEqual(ParseBundler(files[0].content, files[1].content),
              ParseBundler(ReadTextFile(Path("out" + files[0].suffix)),
                           ReadTextFile(Path("out" + files[1].suffix))));
}

TEST_F(ColmapConverter, WritesTheSamePly) {
  Convert("PLY");
  ExpectEqual(ParsePly(Export("ply", drive_)[0].content),
              ParsePly(ReadTextFile(Path("out"))));
}

}  // namespace
}  // namespace mgsfm
