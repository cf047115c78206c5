// SPDX-License-Identifier: BSD-3-Clause
#include <optional>
#include <string>
#include <vector>

#include "base/text.h"
#include "exchange/import_formats.h"
#include "exchange/import_text.h"
#include "exchange/imported_model.h"
#include "geometry/rigid_matrix.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

namespace fs = std::filesystem;

// The place of a camera in the images of the model; nullopt without a pose.
using PlaceOfCamera = std::vector<std::optional<size_t>>;

// "a/list.txt" of "a/bundle.out", "a/b.list.txt" of "a/b.bundle.out".
fs::path ListBeside(const fs::path& bundle) {
  constexpr std::string_view kEnd = "bundle.out";
  std::string name = bundle.filename().string();
  const bool has_end =
      name.size() >= kEnd.size() &&
      name.compare(name.size() - kEnd.size(), kEnd.size(), kEnd) == 0;
  if (has_end) name.resize(name.size() - kEnd.size());
  const fs::path list =
      bundle.parent_path() / ((has_end ? name : "") + "list.txt");
  if (fs::exists(list)) return list;
  throw Error("'" + bundle.string() + "' needs its list of images, but '" +
              list.string() + "' does not exist; give it (list_path)");
}

// A line is a name, which Bundler follows by 0 and a focal length.
std::vector<std::string> ReadNames(const fs::path& path) {
  ImportText text(path);
  std::vector<std::string> names;
  for (std::string_view line = text.NextLine(); !line.empty();
       line = text.NextLine()) {
    const size_t last = line.find_last_of(" \t");
    const size_t before = last == std::string_view::npos
                              ? last
                              : line.substr(0, last).find_last_of(" \t");
    const bool has_focal_length =
        before != std::string_view::npos &&
        line.substr(before + 1, last - before - 1) == "0" &&
        ParseDouble(line.substr(last + 1));
    std::string_view name = has_focal_length ? line.substr(0, before) : line;
    if (name.substr(0, 2) == "./") name.remove_prefix(2);
    names.emplace_back(name);
  }
  return names;
}

// Bundler's cameras look along -z, with y up. nullopt if it is not registered.
std::optional<ImportedImage> ReadImage(const std::string& name,
                                       const ImportInput& input,
                                       ImportText* text) {
  double intrinsics[3];
  for (double& value : intrinsics) value = text->Number("f, k1 and k2");
  RigidMatrix pose;
  for (int k = 0; k < 9; ++k) {
    pose(k / 3, k % 3) = text->Number("an element of a rotation matrix");
  }
  for (int k = 0; k < 3; ++k) {
    pose(k, 3) = text->Number("an element of a translation");
  }
  if (intrinsics[0] == 0.0) return std::nullopt;
  pose.bottomRows<2>() *= -1.0;
  const std::optional<Rigid3> cam_from_world = RigidFromMatrix(pose);
  if (!cam_from_world) {
    text->Throw("the pose of image '" + Printable(name) +
                "' has no rotation matrix; export the file again");
  }
  const Eigen::Vector2i size_px =
      ReadSizeOfImage(input.image_path, name, input.path);
  return ImportedImage{
      name, *cam_from_world,
      MakeRadialCamera(intrinsics[0], 0.5 * size_px.cast<double>(),
                       intrinsics[1], intrinsics[2], size_px)};
}

// Pixels count from the center of the image, with y up.
ImportedPoint ReadPoint(const PlaceOfCamera& place_of_camera,
                        const ImportedModel& model, ImportText* text) {
  ImportedPoint point = ReadPositionAndColor(text);
  const uint64_t num_observations = text->Count("a number of observations");
  for (uint64_t i = 0; i < num_observations; ++i) {
    const uint64_t camera = text->Count("the index of a camera");
    if (camera >= place_of_camera.size() || !place_of_camera[camera]) {
      text->Throw("a point refers to camera " + std::to_string(camera) +
                  ", which has no pose; export the file again");
    }
    text->Count("the index of a feature");
    const double x = text->Number("a pixel coordinate");
    const double y = text->Number("a pixel coordinate");
    const size_t place = *place_of_camera[camera];
    const Camera& intrinsics = model.images[place].camera;
    point.track.push_back(
        {place,
         {0.5 * intrinsics.width_px + x, 0.5 * intrinsics.height_px - y}});
  }
  return point;
}

}  // namespace

Model ReadBundler(const ImportInput& input, const Context& context) {
  ImportText text(input.path);
  const std::string_view header = text.NextLine();
  if (header != "# Bundle file v0.3") {
    text.ThrowUnexpected("# Bundle file v0.3", header);
  }
  const fs::path list_path =
      input.list_path.empty() ? ListBeside(input.path) : input.list_path;
  const std::vector<std::string> names = ReadNames(list_path);
  const uint64_t num_cameras = text.Count("the number of cameras");
  const uint64_t num_points = text.Count("the number of points");
  if (num_cameras != names.size()) {
    text.Throw("there are " + std::to_string(num_cameras) + " cameras, but '" +
               list_path.string() + "' names " + std::to_string(names.size()) +
               " images; give the list of this file (list_path)");
  }
  ImportedModel model;
  PlaceOfCamera place_of_camera(names.size());
  for (size_t i = 0; i < names.size(); ++i) {
    context.CheckInterrupted();
    std::optional<ImportedImage> image = ReadImage(names[i], input, &text);
    if (!image) continue;
    place_of_camera[i] = model.images.size();
    model.images.push_back(*std::move(image));
  }
  for (uint64_t i = 0; i < num_points; ++i) {
    model.points.push_back(ReadPoint(place_of_camera, model, &text));
  }
  return MakeModel(std::move(model), input.path);
}

}  // namespace mgsfm
