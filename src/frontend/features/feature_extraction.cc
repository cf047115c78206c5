// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/features/feature_extraction.h"

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <system_error>

#include "base/fingerprint.h"
#include "base/grouped_warnings.h"
#include "base/text.h"
#include "base/text_tools.h"
#include "database/database_reader.h"
#include "database/database_shard.h"
#include "features/camera_assignment.h"
#include "features/image_file.h"
#include "features/ordered_pipeline.h"
#include "files/image_masks.h"
#include "files/image_reading.h"
#include "mgsfm/base/error.h"
#include "mgsfm/base/options_io.h"
#include "mgsfm/base/timer.h"
#include "scene/item_lists.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// Keeps all threads busy while one large image delays the order.
constexpr size_t kImagesInFlightPerThread = 4;
// Peak memory of ExtractSift. The scale space takes 9 levels of 16 bytes per
// pixel with default options; the rest is for the image itself and gradients.
constexpr size_t kBytesPerPixel = 200;
// The same for decoding: coefficients of a progressive JPEG file, or 16 bits.
constexpr size_t kDecodedBytesPerPixel = 8;

// Features and tags of one image file, or the reason for its rejection.
struct ExtractedImage {
  std::string name;
  std::optional<std::string> problem;
  std::string warning;  // of the decoder
  int width = 0;
  int height = 0;
  ImageTags tags;
  Features features;
};

[[noreturn]] void ThrowFolderError(const std::string& image_path) {
  throw Error("there is no image folder '" + image_path + "'; check the path");
}

bool IsHidden(const fs::path& path) {
  return path.filename().string().front() == '.';
}

// Adds the files below a folder, whose name is `prefix`. Skips a link to one of
// `outer`, the folders around it.
void AddFiles(const fs::path& folder, const std::string& prefix,
              std::set<fs::path> outer, std::vector<std::string>* names) {
  std::error_code error;
  if (!outer.insert(fs::canonical(folder, error)).second) return;
  for (fs::directory_iterator it(folder, error), end; !error && it != end;
       it.increment(error)) {
    std::error_code ignored;  // where a link is broken, reading will say so
    const std::string name = prefix + it->path().filename().string();
    if (IsHidden(it->path())) continue;
    if (it->is_directory(ignored)) {
      AddFiles(it->path(), name + '/', outer, names);
    } else {
      names->push_back(name);
    }
  }
  if (error) {
    throw Error("cannot read the folder '" + folder.string() +
                "': " + error.message() + "; check its permissions");
  }
}

// Half of the memory of the machine.
size_t MemoryLimit() {
  const long num_pages = sysconf(_SC_PHYS_PAGES);
  const long page_size = sysconf(_SC_PAGESIZE);
  return static_cast<size_t>(std::max(1L, num_pages)) *
         static_cast<size_t>(std::max(1L, page_size)) / 2;
}

size_t MemoryOf(const ImageSize& size, int max_image_size) {
  const auto width = static_cast<double>(size.width);
  const auto height = static_cast<double>(size.height);
  const double scale =
      std::min(1.0, max_image_size / std::max({width, height, 1.0}));
  return static_cast<size_t>(
      width * height *
      (scale * scale * kBytesPerPixel + kDecodedBytesPerPixel));
}

// Reads images and extracts their features. Thread-safe.
class ImageExtractor {
 public:
  ImageExtractor(const std::string& image_path,
                 const FeatureExtractionOptions& options)
      : image_path_(image_path),
        options_(options),
        masks_({*options.reader.mask_path, *options.reader.camera_mask_path},
               options.reader.max_num_pixels),
        memory_budget_(MemoryLimit()) {}

  // Checks the masks of all images before they are used.
  void CheckMasks(const std::vector<std::string>& names,
                  const Context& context) const {
    masks_.Check(names, "ImageReader.", context);
  }

  ExtractedImage Extract(const std::string& name) const {
    return Read(name, [&](const GrayImage& gray, const cv::Mat& mask,
                          ExtractedImage* image) {
      image->features = ExtractSift(gray, options_.sift);
      if (!mask.empty()) ApplyMask(mask, &image->features);
    });
  }

  // The same without features.
  ExtractedImage ReadTags(const std::string& name) const {
    return Read(name, [](const auto&...) {});
  }

  // Whether masks hide any of the keypoints of an image.
  bool HidesAny(const std::string& name,
                const std::vector<FeatureKeypoint>& keypoints) const;

  void WarnOfMasks(const Context& context) const {
    masks_.WarnOfUselessMasks(context);
  }

 private:
  template <class Function>
  ExtractedImage Read(const std::string& name, const Function& use) const;
  static bool Hides(const cv::Mat& mask, const FeatureKeypoint& keypoint);
  static void ApplyMask(const cv::Mat& mask, Features* features);

  const std::string image_path_;
  const FeatureExtractionOptions options_;
  const ImageMasks masks_;
  mutable MemoryBudget memory_budget_;
};

// Calls `use` with the pixels and the mask, which may be empty, of a usable
// image.
template <class Function>
ExtractedImage ImageExtractor::Read(const std::string& name,
                                    const Function& use) const {
  ExtractedImage image;
  image.name = name;
  if (const auto problem = WhyUnusable(name)) {
    image.problem = "has a name that " + *problem + "; rename the file";
    return image;
  }
  try {
    const std::string bytes = ReadImageFile(fs::path(image_path_) / name);
    const MemoryBudget::Share share(
        &memory_budget_, MemoryOf(ReadImageSize(bytes).value_or(ImageSize()),
                                  options_.sift.max_image_size));
    ImageFile file = DecodeImageFile(bytes, options_.reader.max_num_pixels);
    image.warning = file.warning;
    image.width = static_cast<int>(file.gray.cols());
    image.height = static_cast<int>(file.gray.rows());
    image.tags = file.tags;
    use(file.gray, masks_.Read(name, cv::Size(image.width, image.height)),
        &image);
  } catch (const Error& error) {
    image.problem = error.what();
  }
  return image;
}

bool ImageExtractor::Hides(const cv::Mat& mask,
                           const FeatureKeypoint& keypoint) {
  const int x = std::clamp(static_cast<int>(keypoint.x_px), 0, mask.cols - 1);
  const int y = std::clamp(static_cast<int>(keypoint.y_px), 0, mask.rows - 1);
  return mask.at<uint8_t>(y, x) == 0;
}

bool ImageExtractor::HidesAny(
    const std::string& name,
    const std::vector<FeatureKeypoint>& keypoints) const {
  cv::Mat mask;
  try {
    mask = masks_.Read(name);
  } catch (const Error&) {
    return false;  // the image was extracted without it
  }
  return !mask.empty() && std::any_of(keypoints.begin(), keypoints.end(),
                                      [&](const FeatureKeypoint& keypoint) {
                                        return Hides(mask, keypoint);
                                      });
}

void ImageExtractor::ApplyMask(const cv::Mat& mask, Features* features) {
  Eigen::Index num_kept = 0;
  for (size_t i = 0; i < features->keypoints.size(); ++i) {
    const FeatureKeypoint keypoint = features->keypoints[i];
    if (Hides(mask, keypoint)) continue;
    features->keypoints[num_kept] = keypoint;
    features->descriptors.row(num_kept) =
        features->descriptors.row(static_cast<Eigen::Index>(i)).eval();
    ++num_kept;
  }
  features->keypoints.resize(static_cast<size_t>(num_kept));
  features->descriptors.conservativeResize(num_kept, Eigen::NoChange);
}

// Writes features, cameras and priors to the database.
class FeatureWriter {
 public:
  FeatureWriter(const ImageReaderOptions& options,
                const std::vector<std::string>& names,
                FeatureDatabase* database, const Context& context)
      : structure_(database->ReadStructure(context)),
        cameras_(options, structure_, names, context),
        database_(database),
        context_(context) {
    for (const ImageRow& image : structure_.images) {
      id_of_name_.emplace(image.name, image.id);
    }
  }

  // Adds the cameras of `names[begin..]` whose intrinsics come from images
  // before `begin`.
  void AddCamerasOfOthers(const std::vector<std::string>& names, size_t begin,
                          size_t end, const ImageExtractor& extractor);
  // The names without keypoints or descriptors in the database.
  std::vector<std::string> NamesToExtract(
      const std::vector<std::string>& names) const;
  // Warns if features in the database lie in pixels that masks hide.
  void CheckMasksWereUsed(const std::vector<std::string>& names,
                          const ImageExtractor& extractor) const;
  // Writes in one transaction.
  void Write(const std::vector<ExtractedImage>& images,
             FeatureExtractionSummary* summary);
  // Warns of images that were rejected or may be incorrect.
  void LogWarnings() const { warnings_.Log(context_); }

 private:
  void WriteImage(const ExtractedImage& image, CameraId camera_id);
  // Returns the reason if the image is rejected.
  std::optional<std::string> TryToWrite(const ExtractedImage& image);
  // Warns if the zoom of an image differs from the first image of its camera.
  void WarnOfZoom(const ExtractedImage& image);
  void Warn(const std::string& name, const std::string& problem) {
    warnings_.Add("image '" + name + "' " + problem);
  }

  DatabaseContents structure_;
  CameraAssignment cameras_;
  FeatureDatabase* database_;
  const Context& context_;
  std::map<std::string, ImageId> id_of_name_;
  // The focal length in the tags of the first image of each camera, by key.
  std::map<std::string, double> focal_length_px_of_key_;
  GroupedWarnings warnings_;
};

void FeatureWriter::AddCamerasOfOthers(const std::vector<std::string>& names,
                                       size_t begin, size_t end,
                                       const ImageExtractor& extractor) {
  std::set<std::string> keys;  // of cameras to find
  for (size_t i = begin; i < end; ++i) keys.insert(cameras_.KeyOf(names[i]));
  const auto camera_of_id = IndexById(structure_.cameras);
  for (const auto& [id, name] : database_->ReadShardCameras()) {
    cameras_.Add(name, structure_.cameras[camera_of_id.at(id)]);
    keys.erase(cameras_.KeyOf(name));
  }
  DatabaseTransaction transaction(database_);
  for (size_t i = 0; i < begin && !keys.empty(); ++i) {
    context_.CheckInterrupted();
    const std::string key = cameras_.KeyOf(names[i]);
    if (keys.count(key) == 0) continue;
    const ExtractedImage image = extractor.ReadTags(names[i]);
    if (image.problem) continue;
    Camera camera = cameras_
                        .Find(image.name, image.width, image.height,
                              image.tags.focal_length_px)
                        .camera;
    camera.id = database_->AddCamera(camera);
    database_->WriteShardCamera(camera.id, image.name);
    cameras_.Add(image.name, camera);
    keys.erase(key);
  }
  transaction.Commit();
}

std::vector<std::string> FeatureWriter::NamesToExtract(
    const std::vector<std::string>& names) const {
  const std::vector<ImageId> with_keypoints = database_->ImagesWithKeypoints();
  const std::vector<ImageId> with_descriptors =
      database_->ImagesWithDescriptors();
  const auto has = [](const std::vector<ImageId>& ids, ImageId id) {
    return std::binary_search(ids.begin(), ids.end(), id);
  };
  std::vector<std::string> missing;
  for (const std::string& name : names) {
    const auto id = id_of_name_.find(name);
    if (id == id_of_name_.end() || !has(with_keypoints, id->second) ||
        !has(with_descriptors, id->second)) {
      missing.push_back(name);
    }
  }
  return missing;
}

void FeatureWriter::CheckMasksWereUsed(const std::vector<std::string>& names,
                                       const ImageExtractor& extractor) const {
  // Either all images of a run have masks or none has, so a few suffice.
  constexpr size_t kMaxNumChecked = 20;
  std::vector<std::string> present;
  for (const std::string& name : names) {
    if (id_of_name_.count(name) > 0) present.push_back(name);
  }
  const size_t num_checked = std::min(present.size(), kMaxNumChecked);
  size_t num_unmasked = 0;
  std::string example;
  for (size_t i = 0; i < num_checked; ++i) {
    const std::string& name = present[i * present.size() / num_checked];
    const auto keypoints = database_->ReadKeypoints(id_of_name_.at(name));
    if (!extractor.HidesAny(name, keypoints)) continue;
    if (num_unmasked++ == 0) example = name;
  }
  if (num_unmasked == 0) return;
  context_.Warning("features of " + std::to_string(num_unmasked) + " of " +
                   std::to_string(num_checked) +
                   " images were made without their masks, such as those of '" +
                   example + "'; extract all features into a new database");
}

std::optional<std::string> FeatureWriter::TryToWrite(
    const ExtractedImage& image) {
  if (image.problem) return image.problem;
  CameraAssignment::Result found = cameras_.Find(
      image.name, image.width, image.height, image.tags.focal_length_px);
  if (found.problem) return found.problem;
  if (found.is_new) {
    found.camera.id = database_->AddCamera(found.camera);
    cameras_.Add(image.name, found.camera);
  }
  WriteImage(image, found.camera.id);
  WarnOfZoom(image);
  return std::nullopt;
}

void FeatureWriter::WarnOfZoom(const ExtractedImage& image) {
  // Tags are rounded to 1 mm of about 28 mm.
  constexpr double kMaxRatio = 1.05;
  if (!image.tags.focal_length_px) return;
  const auto first =
      focal_length_px_of_key_
          .emplace(cameras_.KeyOf(image.name), *image.tags.focal_length_px)
          .first;
  const double ratio = *image.tags.focal_length_px / first->second;
  if (std::max(ratio, 1.0 / ratio) < kMaxRatio) return;
  Warn(image.name,
       "shares a camera with images of another focal length by their EXIF "
       "tags; set ImageReader.single_camera_per_image, or put the images of "
       "each zoom into a folder of their own");
}

void FeatureWriter::WriteImage(const ExtractedImage& image,
                               CameraId camera_id) {
  const auto known = id_of_name_.find(image.name);
  const ImageId id = known != id_of_name_.end()
                         ? known->second
                         : database_->AddImage(image.name, camera_id);
  if (known == id_of_name_.end() && !structure_.frames.empty()) {
    database_->AddSingleImageFrame(id, camera_id);
  }
  database_->WriteKeypoints(id, image.features.keypoints);
  database_->WriteDescriptors(id, image.features.descriptors);
  if (image.tags.position_wgs84) {
    database_->WritePosePrior({id, PosePriorRow::CoordinateSystem::kWgs84,
                               *image.tags.position_wgs84, std::nullopt});
  }
}

void FeatureWriter::Write(const std::vector<ExtractedImage>& images,
                          FeatureExtractionSummary* summary) {
  DatabaseTransaction transaction(database_);
  for (const ExtractedImage& image : images) {
    const std::optional<std::string> problem = TryToWrite(image);
    if (problem) {
      Warn(image.name, "is rejected: it " + *problem);
      ++summary->num_rejected;
      continue;
    }
    const size_t num_features = image.features.keypoints.size();
    if (!image.warning.empty()) {
      Warn(image.name, "may be damaged: " + image.warning);
    }
    if (num_features == 0) Warn(image.name, "has no features");
    ++summary->num_extracted;
    summary->num_features += num_features;
  }
  transaction.Commit();
}

}  // namespace

std::vector<std::string> ListImages(const std::string& image_path,
                                    const std::string& list_path,
                                    const std::string& mask_path,
                                    const std::string& camera_mask_path) {
  std::error_code ignored;
  if (!fs::is_directory(image_path, ignored)) ThrowFolderError(image_path);
  std::vector<std::string> names;
  if (list_path.empty()) {
    AddFiles(image_path, "", {}, &names);
    RemoveMasks(image_path, {mask_path, camera_mask_path}, &names);
  } else {
    names = ReadImageList(list_path);
  }
  std::sort(names.begin(), names.end());
  names.erase(std::unique(names.begin(), names.end()), names.end());
  if (names.empty()) {
    throw Error(list_path.empty()
                    ? "there are no images in '" + image_path + "'"
                    : "'" + list_path + "' (image_list_path) names no image");
  }
  return names;
}

namespace {

// Extracts the images that the database lacks.
void ExtractMissing(const std::vector<std::string>& missing,
                    const ImageExtractor& extractor, const Context& context,
                    FeatureWriter* writer, FeatureExtractionSummary* summary) {
  const auto num_threads = static_cast<size_t>(context.num_threads);
  OrderedPipeline<ExtractedImage> pipeline(
      missing.size(), context.num_threads,
      kImagesInFlightPerThread * num_threads,
      [&](size_t i) { return extractor.Extract(missing[i]); });
  size_t num_done = 0;
  while (num_done < missing.size()) {
    context.ReportProgress("extracting features", num_done, missing.size());
    const std::vector<ExtractedImage> images = pipeline.Take();
    if (!images.empty()) writer->Write(images, summary);
    num_done += images.size();
  }
}

FeatureExtractionSummary ExtractRange(const std::vector<std::string>& names,
                                      size_t begin, size_t end,
                                      const std::string& image_path,
                                      const FeatureExtractionOptions& options,
                                      FeatureDatabase* database,
                                      const Context& context) {
  const Timer timer;
  const QuietImageLibraries quiet;
  const ImageExtractor extractor(image_path, options);
  extractor.CheckMasks(names, context);
  FeatureWriter writer(options.reader, names, database, context);
  writer.CheckMasksWereUsed(names, extractor);
  if (begin > 0) writer.AddCamerasOfOthers(names, begin, end, extractor);
  const std::vector<std::string> missing =
      writer.NamesToExtract({names.begin() + static_cast<std::ptrdiff_t>(begin),
                             names.begin() + static_cast<std::ptrdiff_t>(end)});
  FeatureExtractionSummary summary;
  summary.num_images = end - begin;
  summary.num_present = summary.num_images - missing.size();
  ExtractMissing(missing, extractor, context, &writer, &summary);
  extractor.WarnOfMasks(context);
  writer.LogWarnings();
  summary.seconds = timer.Seconds();
  return summary;
}

// Paths are omitted: they may differ from machine to machine.
std::string FingerprintOf(const std::vector<std::string>& names,
                          FeatureExtractionOptions options) {
  Fingerprint fingerprint;
  for (const std::string& name : names) fingerprint.Add(name);
  options.image_list_path = "";
  options.reader.mask_path = "";
  options.reader.camera_mask_path = "";
  options.reader.camera_params_path = "";
  return fingerprint.Add(OptionsToJsonOf(options)).ToString();
}

}  // namespace

FeatureExtractionSummary ExtractFeatures(
    const std::string& image_path, const FeatureExtractionOptions& options,
    FeatureDatabase* database, const Context& context) {
  if (const auto shard = database->ReadShard()) {
    throw Error("database '" + database->path() + "' is shard " +
                shard->share.ToString() + "; set --shard " +
                shard->share.ToString() + " or choose another database");
  }
  const std::vector<std::string> names =
      ListImages(image_path, options.image_list_path, options.reader.mask_path,
                 options.reader.camera_mask_path);
  const FeatureExtractionSummary summary = ExtractRange(
      names, 0, names.size(), image_path, options, database, context);
  if (summary.num_present + summary.num_extracted == 0) {
    throw Error("none of the " + std::to_string(names.size()) + " files in '" +
                image_path + "' can be used; the warnings give the reasons");
  }
  return summary;
}

FeatureExtractionSummary ExtractFeatureShard(
    const std::string& image_path, const FeatureExtractionOptions& options,
    const Share& share, FeatureDatabase* database, const Context& context) {
  const std::vector<std::string> names =
      ListImages(image_path, options.image_list_path, options.reader.mask_path,
                 options.reader.camera_mask_path);
  ShardManifest manifest{ShardKind::kFeatures, share,
                         FingerprintOf(names, options), false};
  BeginShard(manifest, database);
  const FeatureExtractionSummary summary =
      ExtractRange(names, share.Begin(names.size()), share.End(names.size()),
                   image_path, options, database, context);
  manifest.is_complete = true;
  database->WriteShard(manifest);
  return summary;
}

}  // namespace mgsfm
