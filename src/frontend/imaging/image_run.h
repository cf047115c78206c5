// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "files/image_masks.h"
#include "mgsfm/base/context.h"
#include "mgsfm/imaging/views.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Resamples images of one camera to its views by bicubic interpolation. Area
// averaging first reduces the image if views have a lower resolution. Pixels
// that the camera does not see are black. Thread-safe.
class ViewRenderer {
 public:
  ViewRenderer(const Camera& camera, const std::vector<View>& views);

  // The images of all views. `image` has the size of the camera.
  std::vector<cv::Mat> Render(const cv::Mat& image) const;
  // A mask of the original, black in unusable pixels, resampled to the views.
  // An empty mask masks nothing. White where the view shows the original.
  std::vector<cv::Mat> RenderMasks(const cv::Mat& mask) const;

 private:
  struct Map {
    cv::Mat pixels;  // CV_32FC2: positions in the reduced, padded original
    cv::Mat unseen;  // CV_8U
  };
  cv::Mat Prepare(const cv::Mat& image) const;
  Map MakeMap(const Camera& camera, const View& view) const;

  bool wraps_around_ = false;  // left and right border are adjacent
  cv::Size reduced_size_;
  std::vector<Map> maps_;
};

// One image and the names of its views, in the order of the views of its
// camera.
struct ImageTask {
  std::string name;
  int camera_idx = 0;
  std::vector<std::string> view_names;
};

struct ImageRunOptions {
  std::filesystem::path image_path;
  MaskPaths mask_paths;
  std::filesystem::path output_path;
  bool writes_masks = false;
  int jpeg_quality = 95;
  // Keeps depths above 8 bits, although most programs expect 8.
  bool keeps_depth = false;
};

struct ImageRunSummary {
  size_t num_written = 0;  // original images
  size_t num_present = 0;  // of an earlier run
  double seconds = 0.0;
};

// Writes the views of images to output_path/images, in the format of the
// original, and their masks to output_path/masks under COLMAP's names: the name
// of the view with ".png" appended. Copies an image that is its own only view.
// Views have the GPS position and time of the original in their EXIF tags.
//
// Files appear only when complete, and images whose files all exist are
// skipped, so an interrupted run continues. Parallel over images.
//
// Throws Error, naming the image, if one is damaged or differs in size from its
// camera.
ImageRunSummary WriteViews(
    const std::vector<ImageTask>& tasks, const std::vector<Camera>& cameras,
    const std::vector<std::vector<View>>& views_of_camera,
    const ImageRunOptions& options, const Context& context);

// Throws Error, naming the first missing image, unless all are in the folder.
void CheckImagesExist(const std::vector<ImageTask>& tasks,
                      const std::filesystem::path& image_path);

// Checks the masks of the images of the tasks.
void CheckMasksOf(const std::vector<ImageTask>& tasks,
                  const MaskPaths& mask_paths, const Context& context);

// Throws Error if the outputs would be among input images or masks.
void CheckIsApart(const std::filesystem::path& output_path,
                  const std::filesystem::path& image_path,
                  const MaskPaths& mask_paths);

// Images of a run may be kept if they were written with the same settings, a
// text in a file of output_path, which a new run writes first. Throws Error if
// there are images of other or unknown settings.
void ContinueOrBegin(const std::filesystem::path& output_path,
                     const std::string& settings,
                     const std::string& file_name = "undistortion.json");

}  // namespace mgsfm
