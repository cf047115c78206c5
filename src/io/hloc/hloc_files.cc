// SPDX-License-Identifier: BSD-3-Clause
#include "hloc/hloc_files.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/text.h"
#include "files/image_reading.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

[[noreturn]] void ThrowBadPair(const std::string& path,
                               const std::string& group,
                               const std::string& problem) {
  throw Error("'" + path + "': the pair '" + Printable(group) + "' " + problem);
}

std::string WithDashes(std::string name) {
  std::replace(name.begin(), name.end(), '/', '-');
  return name;
}

// The columns of a matrix as rows of bytes.
DescriptorMatrix BytesOfRows(const Hdf5Matrix<float>& columns) {
  DescriptorMatrix bytes(
      static_cast<Eigen::Index>(columns.cols),
      static_cast<Eigen::Index>(columns.rows * sizeof(float)));
  for (size_t r = 0; r < columns.rows; ++r) {
    for (size_t c = 0; c < columns.cols; ++c) {
      std::memcpy(bytes.data() + (c * columns.rows + r) * sizeof(float),
                  &columns.values[r * columns.cols + c], sizeof(float));
    }
  }
  return bytes;
}

bool AreFinite(const std::vector<float>& values) {
  return std::all_of(values.begin(), values.end(),
                     [](float value) { return std::isfinite(value); });
}

}  // namespace

HlocFeatureFile::HlocFeatureFile(const std::string& path)
    : file_(OpenHdf5(path)), image_names_(file_->GroupsWith("keypoints")) {
  if (image_names_.empty()) {
    throw Error("'" + path +
                "' has no image with keypoints; give the features of hloc");
  }
  for (const std::string& name : image_names_) {
    if (const auto problem = WhyUnusable(name)) {
      Throw(Printable(name), "has a name that " + *problem);
    }
  }
}

void HlocFeatureFile::Throw(const std::string& image_name,
                            const std::string& problem) const {
  throw Error("'" + file_->path() + "': image '" + image_name + "' " + problem +
              "; extract its features again");
}

HlocFeatures HlocFeatureFile::Read(const std::string& image_name) const {
  HlocFeatures features;
  const auto keypoints = file_->ReadFloats(image_name + "/keypoints");
  if (keypoints.rows > 0 && keypoints.cols != 2) {
    Throw(image_name, "has keypoints of " + std::to_string(keypoints.cols) +
                          " columns instead of 2");
  }
  if (!AreFinite(keypoints.values)) {
    Throw(image_name, "has a keypoint that is not finite");
  }
  features.keypoints.resize(keypoints.rows);
  for (size_t i = 0; i < keypoints.rows; ++i) {
    features.keypoints[i].x_px = keypoints.values[2 * i] + 0.5f;
    features.keypoints[i].y_px = keypoints.values[2 * i + 1] + 0.5f;
  }
  if (file_->Has(image_name + "/descriptors")) {
    const auto columns = file_->ReadFloats(image_name + "/descriptors");
    if (columns.cols != keypoints.rows || !AreFinite(columns.values)) {
      Throw(image_name, "has " + std::to_string(columns.cols) +
                            " descriptors for " +
                            std::to_string(keypoints.rows) +
                            " keypoints, or ones that are not finite");
    }
    features.descriptors = BytesOfRows(columns);
  }
  if (file_->Has(image_name + "/image_size")) {
    const auto size = file_->ReadFloats(image_name + "/image_size").values;
    if (size.size() != 2 || !(size[0] >= 1.0f && size[1] >= 1.0f) ||
        !(std::max(size[0], size[1]) <= kMaxImageSide_px)) {
      Throw(image_name, "has an image_size that is not [width, height]");
    }
    features.size_px.emplace(static_cast<int>(size[0]),
                             static_cast<int>(size[1]));
  }
  return features;
}

HlocMatchFile::HlocMatchFile(const std::string& path,
                             const std::vector<std::string>& image_names)
    : file_(OpenHdf5(path)) {
  std::map<std::string, int> image_of_name;
  for (size_t i = 0; i < image_names.size(); ++i) {
    const auto [other, is_new] =
        image_of_name.emplace(WithDashes(image_names[i]), static_cast<int>(i));
    if (!is_new) {
      throw Error("'" + path + "' cannot tell the images '" +
                  image_names[other->second] + "' and '" + image_names[i] +
                  "' apart, which differ in '-' and '/' only; rename one");
    }
  }
  for (const std::string& group : file_->GroupsWith("matches0")) {
    const size_t slash = group.find('/');
    const auto find = [&](const std::string& name) {
      const auto found = image_of_name.find(name);
      if (found != image_of_name.end()) return found->second;
      ThrowBadPair(path, group,
                   "has an image without features; give the features that were "
                   "matched");
    };
    const int image1 = find(group.substr(0, slash));
    const int image2 =
        find(slash == std::string::npos ? "" : group.substr(slash + 1));
    if (image1 == image2) {
      ThrowBadPair(path, group, "is of one image; remove it");
    }
    pairs_.push_back({image1, image2, group});
  }
}

std::vector<Match> HlocMatchFile::Read(const Pair& pair, size_t num_keypoints1,
                                       size_t num_keypoints2) const {
  const auto partners = file_->ReadInts(pair.group + "/matches0");
  const auto fail = [&](const std::string& problem) {
    throw Error("'" + file_->path() + "': the pair '" + pair.group + "' " +
                problem + "; match it again");
  };
  if (partners.rows != 1 && !partners.values.empty()) {
    fail("has a matches0 that is not a vector");
  }
  if (partners.values.size() != num_keypoints1) {
    fail("has " + std::to_string(partners.values.size()) +
         " entries, but its first image has " + std::to_string(num_keypoints1) +
         " keypoints");
  }
  std::vector<Match> matches;
  for (size_t i = 0; i < partners.values.size(); ++i) {
    const int32_t partner = partners.values[i];
    if (partner < 0) continue;
    if (static_cast<size_t>(partner) >= num_keypoints2) {
      fail("matches keypoint " + std::to_string(partner) +
           ", but its second image has " + std::to_string(num_keypoints2));
    }
    matches.push_back(
        {static_cast<uint32_t>(i), static_cast<uint32_t>(partner)});
  }
  return matches;
}

}  // namespace mgsfm
