// SPDX-License-Identifier: BSD-3-Clause
#include "imaging/image_run.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <mutex>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

#include "base/file_reading.h"
#include "base/grouped_warnings.h"
#include "base/parallel.h"
#include "base/ranges.h"
#include "base/text_tools.h"
#include "files/exif_gps_time.h"
#include "files/file_operations.h"
#include "files/image_reading.h"
#include "files/image_writing.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/timer.h"
#include "mgsfm/geometry/camera_models.h"

namespace mgsfm {
namespace {

// Columns that bicubic interpolation needs beyond the border.
constexpr int kPadding = 2;

// The center of the pixel, in the convention of the camera models.
Eigen::Vector2d CenterOf(int x, int y) { return {x + 0.5, y + 0.5}; }

// The size of the original at the resolution of its views, at most its own
// size.
cv::Size ReducedSize(const Camera& camera, const View& view) {
  const double pixels_per_view_pixel =
      PixelsPerRadian(camera) / view.camera.params[0];
  const auto reduced = [&](int side) {
    const double factor = std::max(1.0, pixels_per_view_pixel);
    return std::max(1, static_cast<int>(std::lround(side / factor)));
  };
  return {reduced(camera.width_px), reduced(camera.height_px)};
}

}  // namespace

ViewRenderer::ViewRenderer(const Camera& camera, const std::vector<View>& views)
    : wraps_around_(camera.model == CameraModelId::kEquirectangular),
      reduced_size_(ReducedSize(camera, views.front())) {
  for (const View& view : views) maps_.push_back(MakeMap(camera, view));
}

ViewRenderer::Map ViewRenderer::MakeMap(const Camera& camera,
                                        const View& view) const {
  const cv::Size size(view.camera.width_px, view.camera.height_px);
  Map map{cv::Mat(size, CV_32FC2), cv::Mat(size, CV_8U)};
  const double scale_x =
      static_cast<double>(reduced_size_.width) / camera.width_px;
  const double scale_y =
      static_cast<double>(reduced_size_.height) / camera.height_px;
  const double offset = wraps_around_ ? kPadding - 0.5 : -0.5;
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const auto pixel = OriginalPixel(camera, view, CenterOf(x, y));
      map.unseen.at<uint8_t>(y, x) = pixel ? 0 : 255;
      const Eigen::Vector2d place = pixel.value_or(Eigen::Vector2d::Zero());
      map.pixels.at<cv::Vec2f>(y, x) = {
          static_cast<float>(scale_x * place.x() + offset),
          static_cast<float>(scale_y * place.y() - 0.5)};
    }
  }
  return map;
}

cv::Mat ViewRenderer::Prepare(const cv::Mat& image) const {
  cv::Mat prepared = image;
  if (image.size() != reduced_size_) {
    cv::resize(image, prepared, reduced_size_, 0.0, 0.0, cv::INTER_AREA);
  }
  if (wraps_around_) {
    cv::copyMakeBorder(prepared, prepared, 0, 0, kPadding, kPadding,
                       cv::BORDER_WRAP);
  }
  return prepared;
}

std::vector<cv::Mat> ViewRenderer::Render(const cv::Mat& image) const {
  const cv::Mat prepared = Prepare(image);
  std::vector<cv::Mat> rendered(maps_.size());
  for (size_t i = 0; i < maps_.size(); ++i) {
    cv::remap(prepared, rendered[i], maps_[i].pixels, cv::noArray(),
              cv::INTER_CUBIC, cv::BORDER_REPLICATE);
    rendered[i].setTo(cv::Scalar::all(0), maps_[i].unseen);
  }
  return rendered;
}

std::vector<cv::Mat> ViewRenderer::RenderMasks(const cv::Mat& mask) const {
  const cv::Mat prepared = mask.empty() ? mask : Prepare(mask);
  std::vector<cv::Mat> rendered(maps_.size());
  for (size_t i = 0; i < maps_.size(); ++i) {
    if (mask.empty()) {
      cv::bitwise_not(maps_[i].unseen, rendered[i]);
      continue;
    }
    cv::remap(prepared, rendered[i], maps_[i].pixels, cv::noArray(),
              cv::INTER_LINEAR, cv::BORDER_REPLICATE);
    // A pixel that is partly masked is masked.
    cv::threshold(rendered[i], rendered[i], 254.0, 255.0, cv::THRESH_BINARY);
    rendered[i].setTo(cv::Scalar::all(0), maps_[i].unseen);
  }
  return rendered;
}

namespace {

namespace fs = std::filesystem;

// The maps of a camera exist only from its first image to its last.
class SharedRenderer {
 public:
  void AddImage() { ++num_left_; }

  std::shared_ptr<const ViewRenderer> Get(const Camera& camera,
                                          const std::vector<View>& views) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (!renderer_) {
      renderer_ = std::make_shared<const ViewRenderer>(camera, views);
    }
    return renderer_;
  }

  void FinishImage() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (--num_left_ == 0) renderer_.reset();
  }

 private:
  std::mutex mutex_;
  std::shared_ptr<const ViewRenderer> renderer_;
  size_t num_left_ = 0;
};

class ImageRun {
 public:
  ImageRun(const std::vector<Camera>& cameras,
           const std::vector<std::vector<View>>& views_of_camera,
           const ImageRunOptions& options)
      : cameras_(cameras),
        views_of_camera_(views_of_camera),
        options_(options),
        masks_(options.mask_paths, kDefaultMaxNumPixels),
        renderers_(cameras.size()) {}

  bool IsDone(const ImageTask& task) const {
    for (const std::string& name : task.view_names) {
      if (!IsWritten(ImagePath(name))) return false;
      if (options_.writes_masks && !IsWritten(MaskPath(name))) return false;
    }
    return true;
  }

  void Prepare(const std::vector<ImageTask>& tasks) {
    for (const ImageTask& task : tasks) {
      renderers_[task.camera_idx].AddImage();
      for (const std::string& name : task.view_names) {
        folders_.insert(ImagePath(name).parent_path());
        if (options_.writes_masks) {
          folders_.insert(MaskPath(name).parent_path());
        }
      }
    }
    for (const fs::path& folder : folders_) fs::create_directories(folder);
  }

  void Finish(const Context& context) const {
    if (!folders_.empty()) SyncFolders();
    masks_.WarnOfUselessMasks(context);
    warnings_.Log(context);
  }

  void Run(const ImageTask& task) {
    try {
      WriteTask(task);
    } catch (const Error& error) {
      throw Error("image '" + task.name + "' " + error.what());
    }
    renderers_[task.camera_idx].FinishImage();
  }

 private:
  fs::path ImagePath(const std::string& view_name) const {
    return options_.output_path / "images" / view_name;
  }
  fs::path MaskPath(const std::string& view_name) const {
    return options_.output_path / "masks" / (view_name + ".png");
  }

  // The names of all files, and of the folders that hold them.
  void SyncFolders() const {
    std::set<fs::path> folders;
    const size_t size = options_.output_path.native().size();
    for (fs::path folder : folders_) {
      for (; folder.native().size() > size; folder = folder.parent_path()) {
        folders.insert(folder);
      }
    }
    folders.insert(options_.output_path);
    FileOperations operations;
    for (const fs::path& folder : folders) operations.Sync(folder);
  }

  void WriteTask(const ImageTask& task) {
    const Camera& camera = cameras_[task.camera_idx];
    const std::vector<View>& views = views_of_camera_[task.camera_idx];
    const fs::path original_path = options_.image_path / task.name;
    const std::string file = ReadFile(original_path);
    const bool is_unchanged = IsUnchanged(camera, views);
    const DecodedImage decoded = Decode(file, camera);
    if (decoded.is_nearly_black) {
      const std::lock_guard<std::mutex> lock(warnings_mutex_);
      warnings_.Add("image '" + task.name +
                    "' has 16 bits per channel, but uses the lower 12 only, so "
                    "that it is nearly black in 8 bits; multiply its values by "
                    "16 and start again in another folder");
    }
    std::shared_ptr<const ViewRenderer> renderer;
    if (!is_unchanged || options_.writes_masks) {
      renderer = renderers_[task.camera_idx].Get(camera, views);
    }
    if (options_.writes_masks) WriteMasks(task, camera, *renderer);
    if (is_unchanged) {
      ReplaceOneOfMany(ImagePath(task.view_names.front()),
                       WithoutOrientation(file));
      return;
    }
    const ExifGpsTime tags(file);
    const std::vector<cv::Mat> rendered = renderer->Render(decoded.pixels);
    for (size_t i = 0; i < rendered.size(); ++i) {
      const fs::path path = ImagePath(task.view_names[i]);
      ReplaceOneOfMany(path, tags.AddTo(Encode(path, rendered[i])));
    }
  }

  void WriteMasks(const ImageTask& task, const Camera& camera,
                  const ViewRenderer& renderer) {
    const cv::Mat mask =
        masks_.Read(task.name, cv::Size(camera.width_px, camera.height_px));
    const std::vector<cv::Mat> rendered = renderer.RenderMasks(mask);
    for (size_t i = 0; i < rendered.size(); ++i) {
      const fs::path path = MaskPath(task.view_names[i]);
      ReplaceOneOfMany(path, Encode(path, rendered[i]));
    }
  }

  DecodedImage Decode(const std::string& file, const Camera& camera) const {
    DecodedImage decoded =
        DecodeImage(file,
                    cv::IMREAD_ANYCOLOR | cv::IMREAD_IGNORE_ORIENTATION |
                        (options_.keeps_depth ? cv::IMREAD_ANYDEPTH : 0),
                    kDefaultMaxNumPixels);
    const cv::Mat& image = decoded.pixels;
    if (image.cols == camera.width_px && image.rows == camera.height_px) {
      return decoded;
    }
    throw Error("has " + SizeText(image.cols, image.rows) +
                " pixels, but its camera has " +
                SizeText(camera.width_px, camera.height_px) +
                "; images of one camera must have one size, that of the model");
  }

  std::string Encode(const fs::path& path, const cv::Mat& image) const {
    return EncodeImage(path.extension().string(), image,
                       {cv::IMWRITE_JPEG_QUALITY, options_.jpeg_quality});
  }

  const std::vector<Camera>& cameras_;
  const std::vector<std::vector<View>>& views_of_camera_;
  const ImageRunOptions& options_;
  const ImageMasks masks_;
  std::vector<SharedRenderer> renderers_;
  std::set<fs::path> folders_;  // of the files to write
  std::mutex warnings_mutex_;
  GroupedWarnings warnings_;
};

}  // namespace

void CheckImagesExist(const std::vector<ImageTask>& tasks,
                      const fs::path& image_path) {
  for (const ImageTask& task : tasks) {
    std::error_code ignored;
    if (fs::is_regular_file(image_path / task.name, ignored)) continue;
    throw Error("image '" + task.name + "' of the model is missing in '" +
                image_path.string() +
                "'; use the folder from which the model was made");
  }
}

void CheckMasksOf(const std::vector<ImageTask>& tasks,
                  const MaskPaths& mask_paths, const Context& context) {
  ImageMasks(mask_paths, kDefaultMaxNumPixels)
      .Check(Transformed(tasks, &ImageTask::name), "", context);
}

void CheckIsApart(const fs::path& output_path, const fs::path& image_path,
                  const MaskPaths& mask_paths) {
  for (const fs::path& input :
       {image_path, mask_paths.of_images, mask_paths.of_cameras}) {
    if (input.empty()) continue;
    const fs::path originals = fs::weakly_canonical(fs::absolute(input));
    for (const char* name : {"images", "masks"}) {
      fs::path folder = fs::weakly_canonical(fs::absolute(output_path / name));
      for (; folder != folder.root_path(); folder = folder.parent_path()) {
        if (folder != originals) continue;
        throw Error("the output '" + output_path.string() +
                    "' would lie in the folder of original images '" +
                    input.string() + "'; choose another output folder");
      }
    }
  }
}

void ContinueOrBegin(const fs::path& output_path, const std::string& settings,
                     const std::string& file_name) {
  const fs::path path = output_path / file_name;
  const bool is_continued = fs::is_regular_file(path);
  if (is_continued && ReadFile(path) == settings) return;
  for (const char* name : {"images", "masks"}) {
    const fs::path folder = output_path / name;
    if (!fs::is_directory(folder) || fs::is_empty(folder)) continue;
    throw Error("'" + folder.string() + "' holds images " +
                (is_continued ? "of other settings or another input"
                              : "that this program did not write") +
                "; remove them or choose another folder");
  }
  fs::create_directories(output_path);
  ReplaceFile(path, settings);
}

ImageRunSummary WriteViews(
    const std::vector<ImageTask>& tasks, const std::vector<Camera>& cameras,
    const std::vector<std::vector<View>>& views_of_camera,
    const ImageRunOptions& options, const Context& context) {
  const Timer timer;
  ImageRun run(cameras, views_of_camera, options);
  std::vector<ImageTask> left = tasks;
  EraseIf(&left, [&](const ImageTask& task) { return run.IsDone(task); });
  run.Prepare(left);
  // Images of one camera are consecutive, so that few maps exist at a time.
  StableSortBy(&left, &ImageTask::camera_idx);
  const QuietImageLibraries quiet;
  ParallelFor(left.size(), context, "undistortion: images", [&](size_t i) {
    context.CheckInterrupted();
    run.Run(left[i]);
  });
  run.Finish(context);
  return {left.size(), tasks.size() - left.size(), timer.Seconds()};
}

}  // namespace mgsfm
