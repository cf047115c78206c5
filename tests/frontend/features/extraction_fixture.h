// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "frontend/features/blob_images.h"
#include "mgsfm/features/feature_extraction.h"
#include "support/temp_dir.h"

namespace mgsfm {

// A folder of images and databases made of them.
class ExtractionTest : public testing::Test {
 protected:
  // The contents of the database that later steps read, per image.
  struct StoredImage {
    ImageId id{0};
    CameraId camera_id{0};
    std::vector<FeatureKeypoint> keypoints;
    DescriptorMatrix descriptors;
  };

  std::filesystem::path ImagePath(const std::string& name) const {
    return dir_.path() / "images" / name;
  }
  std::string DatabasePath(const std::string& name = "a.db") const {
    return (dir_.path() / name).string();
  }
  void WriteImage(const std::string& name, const cv::Mat& image) const {
    std::filesystem::create_directories(ImagePath(name).parent_path());
    ASSERT_TRUE(cv::imwrite(ImagePath(name).string(), image));
  }
  void WriteBlobs(const std::string& name, uint64_t seed, int width = 120,
                  int height = 90) const {
    const GrayImage gray =
        RenderBlobs(RandomBlobs(80, width, height, seed), width, height);
    cv::Mat image(height, width, CV_8U);
    std::copy_n(gray.data(), gray.size(), image.data);
    WriteImage(name, image);
  }

  FeatureExtractionSummary Extract(const FeatureExtractionOptions& options = {},
                                   const std::string& database = "a.db",
                                   int num_threads = 2) {
    Context context;
    context.num_threads = num_threads;
    context.log = [this](LogLevel level, const std::string& message) {
      if (level == LogLevel::kWarning) warnings_.push_back(message);
    };
    return ExtractWith(context, options, database);
  }
  FeatureExtractionSummary ExtractWith(const Context& context,
                                       const FeatureExtractionOptions& options,
                                       const std::string& database) const {
    FeatureDatabase file(DatabasePath(database),
                         FeatureDatabase::OpenMode::kOrCreate);
    return ExtractFeatures((dir_.path() / "images").string(), options, &file,
                           context);
  }

  DatabaseContents Structure(const std::string& database = "a.db") const {
    return FeatureDatabase(DatabasePath(database),
                           FeatureDatabase::OpenMode::kExisting)
        .ReadStructure(Context());
  }
  std::map<std::string, StoredImage> Images(
      const std::string& database = "a.db") const {
    const FeatureDatabase file(DatabasePath(database),
                               FeatureDatabase::OpenMode::kExisting);
    std::map<std::string, StoredImage> images;
    for (const ImageRow& row : file.ReadStructure(Context()).images) {
      images[row.name] = {row.id, row.camera_id, file.ReadKeypoints(row.id),
                          file.ReadDescriptors(row.id)};
    }
    return images;
  }
  static void ExpectEqual(const std::map<std::string, StoredImage>& a,
                          const std::map<std::string, StoredImage>& b) {
    ASSERT_EQ(a.size(), b.size());
    for (const auto& [name, image] : a) {
      ASSERT_EQ(b.count(name), 1u) << name;
      const StoredImage& other = b.at(name);
      EXPECT_EQ(image.id, other.id) << name;
      EXPECT_EQ(image.camera_id, other.camera_id) << name;
      EXPECT_EQ(image.descriptors, other.descriptors) << name;
      ASSERT_EQ(image.keypoints.size(), other.keypoints.size()) << name;
      for (size_t i = 0; i < image.keypoints.size(); ++i) {
        const FeatureKeypoint& k = image.keypoints[i];
        const FeatureKeypoint& l = other.keypoints[i];
        EXPECT_TRUE(k.x_px == l.x_px && k.y_px == l.y_px && k.a11 == l.a11 &&
                    k.a12 == l.a12 && k.a21 == l.a21 && k.a22 == l.a22)
            << name << " " << i;
      }
    }
  }
  bool IsWarned(const std::string& name, const std::string& problem) const {
    return std::any_of(
        warnings_.begin(), warnings_.end(), [&](const std::string& warning) {
          return warning.find("'" + name + "'") != std::string::npos &&
                 warning.find(problem) != std::string::npos;
        });
  }

  TempDir dir_;
  std::vector<std::string> warnings_;
};

}  // namespace mgsfm
