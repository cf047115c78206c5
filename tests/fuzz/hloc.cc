// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>

#include "fuzz/fuzz_target.h"
#include "hloc/hloc_files.h"

#ifdef MGSFM_FUZZER
// The library keeps memory of files that it rejects.
extern "C" const char* __lsan_default_suppressions() { return "leak:libhdf5"; }
#endif

namespace mgsfm {
namespace {

void ReadFeatures(const std::string& path) {
  const HlocFeatureFile file(path);
  for (const std::string& name : file.image_names()) {
    Accepts([&] {
      const HlocFeatures features = file.Read(name);
      for (const FeatureKeypoint& keypoint : features.keypoints) {
        FUZZ_CHECK(std::isfinite(keypoint.x_px) &&
                   std::isfinite(keypoint.y_px));
      }
      FUZZ_CHECK(features.descriptors.size() == 0 ||
                 static_cast<size_t>(features.descriptors.rows()) ==
                     features.keypoints.size());
    });
  }
}

void ReadMatches(const std::string& path) {
  constexpr size_t kNumKeypoints = 3;
  const HlocMatchFile file(path, {"a/1.png", "b/1.png", "c.png"});
  for (const HlocMatchFile::Pair& pair : file.pairs()) {
    FUZZ_CHECK(pair.image1 != pair.image2);
    Accepts([&] {
      for (const Match& match : file.Read(pair, kNumKeypoints, kNumKeypoints)) {
        FUZZ_CHECK(match.keypoint_idx1 < kNumKeypoints &&
                   match.keypoint_idx2 < kNumKeypoints);
      }
    });
  }
}

}  // namespace

// The input is an HDF5 file, of features and of matches.
void FuzzHloc(const std::string& input) {
  const std::string path = (FuzzFolder() / "in.h5").string();
  WriteTextFile(path, input);
  Accepts([&] { ReadFeatures(path); });
  Accepts([&] { ReadMatches(path); });
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(hloc, mgsfm::FuzzHloc)
