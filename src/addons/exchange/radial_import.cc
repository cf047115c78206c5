// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/format.h"
#include "base/text.h"
#include "base/text_lines.h"
#include "exchange/formats.h"
#include "exchange/import_formats.h"
#include "exchange/imported_model.h"
#include "geometry/rigid_matrix.h"
#include "mgsfm/base/error.h"
#include "scene/value_check.h"

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

// A point, whose observations have the place that place_of(index) tells from
// the index of their image in the file.
template <class PlaceOf>
ImportedPoint ReadPoint(const char* index_name, const PlaceOf& place_of,
                        ImportText* text) {
  ImportedPoint point;
  for (double& x : point.point_in_world) {
    x = text->Number("a coordinate of a point");
  }
  for (uint8_t& c : point.color) c = text->Color("a color from 0 to 255");
  const uint64_t num_observations = text->Count("a number of observations");
  for (uint64_t i = 0; i < num_observations; ++i) {
    ImportedObservation observation;
    observation.image_place = place_of(text->Count(index_name));
    text->Count("the index of a feature");
    for (double& x : observation.pixel) x = text->Number("a pixel coordinate");
    point.track.push_back(observation);
  }
  return point;
}

// Pixels count from the center of the image, with y up.
ImportedPoint ReadBundlerPoint(const PlaceOfCamera& place_of_camera,
                               const ImportedModel& model, ImportText* text) {
  const auto place_of = [&](uint64_t camera) {
    if (camera >= place_of_camera.size() || !place_of_camera[camera]) {
      text->Throw("a point refers to camera " + std::to_string(camera) +
                  ", which has no pose; export the file again");
    }
    return *place_of_camera[camera];
  };
  ImportedPoint point = ReadPoint("the index of a camera", place_of, text);
  for (auto& [place, pixel] : point.track) {
    const Camera& camera = model.images[place].camera;
    pixel = {0.5 * camera.width_px + pixel.x(),
             0.5 * camera.height_px - pixel.y()};
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
    model.points.push_back(ReadBundlerPoint(place_of_camera, model, &text));
  }
  return MakeModel(std::move(model), input.path);
}

namespace {

constexpr char kImageLine[] =
    "an image: name, focal length, qw qx qy qz, center, distortion, 0";

// "FixedK fx cx fy cy" after the name of the format.
struct FixedCalibration {
  double fx = 0.0, cx = 0.0, fy = 0.0, cy = 0.0;
};

// The last numbers of a line, and the text before them, which may have blanks.
using NamedNumbers = std::pair<std::string, std::vector<double>>;

std::optional<NamedNumbers> SplitNamedNumbers(std::string_view line,
                                              size_t num_numbers) {
  const auto split = SplitNamedWords(line, num_numbers);
  if (!split) return std::nullopt;
  NamedNumbers named{split->name, {}};
  for (const std::string_view word : split->words) {
    const std::optional<double> number = ParseDouble(word);
    if (!number) return std::nullopt;
    named.second.push_back(*number);
  }
  return named;
}

std::optional<FixedCalibration> ReadHeader(ImportText* text) {
  const std::string_view header = text->NextLine();
  const std::vector<std::string_view> words = SplitWords(header);
  // NVM_V3_R9T has other columns.
  if (words.empty() || words[0] != "NVM_V3") {
    text->ThrowUnexpected("NVM_V3", header);
  }
  if (words.size() == 1) return std::nullopt;
  if (words[1] != "FixedK") text->ThrowUnexpected("NVM_V3 FixedK", header);
  const auto split = SplitNamedNumbers(header, 4);
  if (!split) text->ThrowUnexpected("FixedK fx cx fy cy", header);
  const std::vector<double>& k = split->second;
  return FixedCalibration{k[0], k[1], k[2], k[3]};
}

Camera MakeCamera(const std::optional<FixedCalibration>& fixed,
                  double focal_length_px, double radial,
                  const Eigen::Vector2i& size_px) {
  // The inverse of a distortion, to first order; 0 without one.
  const double k1 = radial == 0.0 ? 0.0 : -radial;
  if (!fixed) {
    return MakeRadialCamera(focal_length_px, 0.5 * size_px.cast<double>(), k1,
                            0.0, size_px);
  }
  Camera camera{kUnnumbered,
                CameraModelId::kPinhole,
                size_px.x(),
                size_px.y(),
                {fixed->fx, fixed->fy, fixed->cx, fixed->cy}};
  if (k1 != 0.0) {
    camera.model = CameraModelId::kOpenCV;
    camera.params.insert(camera.params.end(), {k1, 0.0, 0.0, 0.0});
  }
  return camera;
}

ImportedImage ReadImage(const std::optional<FixedCalibration>& fixed,
                        const ImportInput& input, ImportText* text) {
  const std::string_view line = text->NextLine();
  const auto split = SplitNamedNumbers(line, 10);
  if (!split) text->ThrowUnexpected(kImageLine, line);
  const auto& [name, n] = *split;
  const Eigen::Vector3d center(n[5], n[6], n[7]);
  const Rigid3 read = PoseOfFile({n[1], n[2], n[3], n[4]}, center);
  if (const auto problem = WhyImplausible(read)) {
    text->Throw("the pose of image '" + Printable(name) + "' " + *problem +
                "; remove the image, or export the file again");
  }
  return {name, Rigid3::FromRotationAndCenter(read.rotation, center),
          MakeCamera(fixed, n[0], n[8],
                     ReadSizeOfImage(input.image_path, name, input.path))};
}

// Half of the pixels are negative if they count from principal points.
bool CountFromPrincipalPoints(const std::vector<ImportedPoint>& points) {
  for (const ImportedPoint& point : points) {
    for (const ImportedObservation& o : point.track) {
      if (o.pixel.minCoeff() < 0.0) return true;
    }
  }
  return false;
}

}  // namespace

Model ReadNvm(const ImportInput& input, const Context& context) {
  ImportText text(input.path);
  const std::optional<FixedCalibration> fixed = ReadHeader(&text);
  ImportedModel model;
  const uint64_t num_images = text.Count("the number of images");
  for (uint64_t i = 0; i < num_images; ++i) {
    context.CheckInterrupted();
    model.images.push_back(ReadImage(fixed, input, &text));
  }
  const uint64_t num_points = text.Count("the number of points");
  const auto place_of = [&](uint64_t place) {
    if (place < num_images) return place;
    text.Throw(
        Formatted("a point refers to image %llu, but there are %zu; "
                  "export the file again",
                  static_cast<unsigned long long>(place), model.images.size()));
  };
  for (uint64_t i = 0; i < num_points; ++i) {
    model.points.push_back(ReadPoint("the index of an image", place_of, &text));
  }
  const std::string_view next = text.NextLine();
  if (!next.empty() && next != "0" && next.front() != '#') {
    context.Warning("'" + input.path.string() +
                    "' has several models; only the first is read");
  }
  if (CountFromPrincipalPoints(model.points)) {
    for (ImportedPoint& point : model.points) {
      for (ImportedObservation& o : point.track) {
        o.pixel += PrincipalPoint(model.images[o.image_place].camera);
      }
    }
  }
  return MakeModel(std::move(model), input.path);
}

}  // namespace mgsfm
