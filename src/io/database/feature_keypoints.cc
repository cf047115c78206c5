// SPDX-License-Identifier: BSD-3-Clause
#include "database/feature_keypoints.h"

#include <cmath>
#include <cstring>

namespace mgsfm {

FeatureKeypoint FeatureKeypoint::FromScale(float x_px, float y_px,
                                           float scale_px,
                                           float orientation_rad) {
  const float c = scale_px * std::cos(orientation_rad);
  const float s = scale_px * std::sin(orientation_rad);
  return {x_px, y_px, c, -s, s, c};
}

float FeatureKeypoint::ScalePx() const {
  return 0.5f * (std::hypot(a11, a21) + std::hypot(a12, a22));
}

float FeatureKeypoint::OrientationRad() const { return std::atan2(a21, a11); }

std::vector<FeatureKeypoint> MakeFeatureKeypoints(const KeypointBlob& blob) {
  std::vector<FeatureKeypoint> keypoints(blob.rows);
  for (size_t i = 0; i < blob.rows; ++i) {
    float values[6] = {};
    std::memcpy(values, blob.data + i * blob.cols * sizeof(float),
                blob.cols * sizeof(float));
    keypoints[i].x_px = values[0];
    keypoints[i].y_px = values[1];
    if (blob.cols == 4) {
      keypoints[i] = FeatureKeypoint::FromScale(values[0], values[1], values[2],
                                                values[3]);
    } else if (blob.cols == 6) {
      keypoints[i] = {values[0], values[1], values[2],
                      values[3], values[4], values[5]};
    }
  }
  return keypoints;
}

DescriptorMatrix DecodeDescriptors(const SqliteStatement& row,
                                   const std::string& path,
                                   const std::string& name) {
  const int64_t rows = row.Int(1);
  const BlobView blob = row.Blob(3);
  if (rows == 0 && blob.size == 0) return DescriptorMatrix(0, kSiftColumns);
  if (rows < 0 || row.Int(2) != kSiftColumns || blob.size % kSiftColumns != 0 ||
      blob.size / kSiftColumns != static_cast<size_t>(rows)) {
    ThrowDatabaseError(
        path, "the descriptors of " + name +
                  " are not SIFT's: " + std::to_string(blob.size) +
                  " bytes for " + std::to_string(rows) + " x " +
                  std::to_string(row.Int(2)) + " values" + kExtractAgain);
  }
  DescriptorMatrix descriptors(rows, kSiftColumns);
  std::memcpy(descriptors.data(), blob.data, blob.size);
  return descriptors;
}

}  // namespace mgsfm
