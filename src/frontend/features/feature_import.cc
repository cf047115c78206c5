// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/features/feature_import.h"

#include <filesystem>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "base/text_tools.h"
#include "features/camera_assignment.h"
#include "features/image_file.h"
#include "files/image_reading.h"
#include "hloc/hloc_files.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

// A float32 descriptor of this many bytes would be mistaken for SIFT.
constexpr Eigen::Index kSiftBytes = 128;

class FeatureImporter {
 public:
  FeatureImporter(const FeatureImportOptions& options,
                  FeatureDatabase* database, const Context& context)
      : options_(options),
        file_(options.import_path),
        structure_(database->ReadStructure(context)),
        cameras_(options.reader, structure_, file_.image_names(), context),
        database_(*database),
        context_(context) {
    for (const ImageRow& image : structure_.images) {
      id_of_name_.emplace(image.name, image.id);
    }
  }

  FeatureImportSummary Import() {
    summary_.num_images = file_.image_names().size();
    DatabaseTransaction transaction(&database_);
    for (const std::string& name : file_.image_names()) {
      context_.CheckInterrupted();
      ImportImage(name);
    }
    if (!options_.matches_path->empty()) ImportMatches();
    transaction.Commit();
    return summary_;
  }

 private:
  [[noreturn]] void Throw(const std::string& image_name,
                          const std::string& problem) const {
    throw Error("'" + *options_.import_path + "': image '" + image_name + "' " +
                problem);
  }
  void ImportImage(const std::string& name);
  // Throws Error if the image size in the file differs from `size_px`, the size
  // in `owner`, or if a keypoint is outside of it.
  void CheckSize(const std::string& name, const HlocFeatures& features,
                 const std::pair<int, int>& size_px,
                 const std::string& owner) const;
  ImageId AddImage(const std::string& name, const HlocFeatures& features);
  void ImportMatches();

  const FeatureImportOptions& options_;
  const HlocFeatureFile file_;
  const DatabaseContents structure_;
  CameraAssignment cameras_;
  FeatureDatabase& database_;
  const Context& context_;
  std::map<std::string, ImageId> id_of_name_;
  std::vector<size_t> num_keypoints_;  // per image of the file
  FeatureImportSummary summary_;
};

void FeatureImporter::ImportImage(const std::string& name) {
  const HlocFeatures features = file_.Read(name);
  num_keypoints_.push_back(features.keypoints.size());
  const auto known = id_of_name_.find(name);
  if (known != id_of_name_.end() && database_.HasKeypoints(known->second)) {
    const size_t num_before = database_.ReadKeypoints(known->second).size();
    if (num_before != features.keypoints.size()) {
      Throw(name, "has " + std::to_string(features.keypoints.size()) +
                      " keypoints, but " + std::to_string(num_before) +
                      " in the database; import into a new database");
    }
    ++summary_.num_present;
    return;
  }
  if (known != id_of_name_.end()) {
    const Camera& camera = cameras_.Find(name, 0, 0, std::nullopt).camera;
    CheckSize(name, features, {camera.width_px, camera.height_px},
              "the database");
  }
  const ImageId id =
      known != id_of_name_.end() ? known->second : AddImage(name, features);
  database_.WriteKeypoints(id, features.keypoints);
  if (features.descriptors.cols() != kSiftBytes) {
    database_.WriteDescriptors(id, features.descriptors);
  }
  summary_.num_features += features.keypoints.size();
}

void FeatureImporter::CheckSize(const std::string& name,
                                const HlocFeatures& features,
                                const std::pair<int, int>& size_px,
                                const std::string& owner) const {
  constexpr float kMargin_px = 1.0f;
  const auto text = [](const std::pair<int, int>& size) {
    return SizeText(size.first, size.second) + " px";
  };
  if (features.size_px && *features.size_px != size_px) {
    Throw(name, "has the image_size " + text(*features.size_px) + ", but " +
                    owner + " has " + text(size_px) +
                    "; extract its features from the images that you use");
  }
  for (const FeatureKeypoint& keypoint : features.keypoints) {
    if (keypoint.x_px >= -kMargin_px && keypoint.y_px >= -kMargin_px &&
        keypoint.x_px <= static_cast<float>(size_px.first) + kMargin_px &&
        keypoint.y_px <= static_cast<float>(size_px.second) + kMargin_px) {
      continue;
    }
    Throw(name, "has a keypoint outside of its " + text(size_px) +
                    "; scale the keypoints to the size of the images");
  }
}

ImageId FeatureImporter::AddImage(const std::string& name,
                                  const HlocFeatures& features) {
  ImageTags tags;
  auto size_px = features.size_px;
  if (!options_.image_path->empty()) {
    const std::filesystem::path path =
        std::filesystem::path(*options_.image_path) / name;
    std::string bytes;
    try {
      bytes = ReadImageFile(path);
    } catch (const Error& error) {
      throw Error("image '" + path.string() + "' " + error.what());
    }
    if (const auto size = ReadImageSize(bytes)) {
      size_px.emplace(static_cast<int>(size->width),
                      static_cast<int>(size->height));
      CheckSize(name, features, *size_px, "its file");
      tags = ReadTags(bytes, size_px->first, size_px->second);
    }
  }
  if (!size_px) {
    Throw(name, "has no image_size; set image_path to the folder of images");
  }
  CheckSize(name, features, *size_px, "the file");
  CameraAssignment::Result found = cameras_.Find(
      name, size_px->first, size_px->second, tags.focal_length_px);
  if (found.problem) Throw(name, *found.problem);
  if (found.is_new) {
    found.camera.id = database_.AddCamera(found.camera);
    cameras_.Add(name, found.camera);
  }
  const ImageId id = database_.AddImage(name, found.camera.id);
  id_of_name_.emplace(name, id);
  if (!structure_.frames.empty()) {
    database_.AddSingleImageFrame(id, found.camera.id);
  }
  if (tags.position_wgs84) {
    database_.WritePosePrior({id, PosePriorRow::CoordinateSystem::kWgs84,
                              *tags.position_wgs84, std::nullopt});
  }
  return id;
}

void FeatureImporter::ImportMatches() {
  const std::vector<std::string>& names = file_.image_names();
  const HlocMatchFile file(options_.matches_path, names);
  std::set<std::pair<int, int>> done;
  for (const HlocMatchFile::Pair& pair : file.pairs()) {
    context_.CheckInterrupted();
    // Pairs in both orders have the same matches in hloc.
    if (!done.insert(std::minmax(pair.image1, pair.image2)).second) continue;
    const std::vector<Match> matches = file.Read(
        pair, num_keypoints_[pair.image1], num_keypoints_[pair.image2]);
    database_.WriteMatches(id_of_name_.at(names[pair.image1]),
                           id_of_name_.at(names[pair.image2]), matches);
    ++summary_.num_pairs;
    summary_.num_matches += matches.size();
  }
}

}  // namespace

FeatureImportSummary ImportFeatures(const FeatureImportOptions& options,
                                    FeatureDatabase* database,
                                    const Context& context) {
  const ImageReaderOptions& reader = options.reader;
  for (const Option<std::string>* mask :
       {&reader.mask_path, &reader.camera_mask_path}) {
    if ((*mask)->empty()) continue;
    throw Error("ImageReader." + std::string(mask->Info().name) +
                " hides no features of other programs, whose matches name "
                "them by their numbers; give the masks to the program that "
                "extracts them");
  }
  return FeatureImporter(options, database, context).Import();
}

}  // namespace mgsfm
