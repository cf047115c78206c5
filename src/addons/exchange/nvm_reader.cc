// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <vector>

#include "base/text.h"
#include "base/text_lines.h"
#include "exchange/import_formats.h"
#include "exchange/import_text.h"
#include "exchange/imported_model.h"
#include "mgsfm/base/error.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

constexpr char kImageLine[] =
    "an image: name, focal length, qw qx qy qz, center, distortion, 0";

// "FixedK fx cx fy cy" after the name of the format.
struct FixedCalibration {
  double fx = 0.0, cx = 0.0, fy = 0.0, cy = 0.0;
};

// The last numbers of a line, and the text before them, which may have blanks.
struct NamedNumbers {
  std::string name;
  std::vector<double> numbers;
};

std::optional<NamedNumbers> SplitNamedNumbers(std::string_view line,
                                              size_t num_numbers) {
  const auto split = SplitNamedWords(line, num_numbers);
  if (!split) return std::nullopt;
  NamedNumbers named{split->name, {}};
  for (const std::string_view word : split->words) {
    const std::optional<double> number = ParseDouble(word);
    if (!number) return std::nullopt;
    named.numbers.push_back(*number);
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
  const std::vector<double>& k = split->numbers;
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

Eigen::Vector2d PrincipalPoint(const Camera& camera) {
  const CameraModelInfo& info =
      *FindCameraModel(static_cast<int32_t>(camera.model));
  return {camera.params[info.principal_point_idxs[0]],
          camera.params[info.principal_point_idxs[1]]};
}

ImportedImage ReadImage(const std::optional<FixedCalibration>& fixed,
                        const ImportInput& input, ImportText* text) {
  const std::string_view line = text->NextLine();
  const auto split = SplitNamedNumbers(line, 10);
  if (!split) text->ThrowUnexpected(kImageLine, line);
  const std::vector<double>& n = split->numbers;
  const Eigen::Quaterniond rotation(n[1], n[2], n[3], n[4]);
  const Eigen::Vector3d center(n[5], n[6], n[7]);
  const Rigid3 read = PoseOfFile(rotation, center);
  if (const auto problem = WhyImplausible(read)) {
    text->Throw("the pose of image '" + Printable(split->name) + "' " +
                *problem + "; remove the image, or export the file again");
  }
  const Eigen::Quaterniond unit = read.rotation;
  return {
      split->name,
      {unit, -(unit * center)},
      MakeCamera(fixed, n[0], n[8],
                 ReadSizeOfImage(input.image_path, split->name, input.path))};
}

ImportedPoint ReadPoint(size_t num_images, ImportText* text) {
  ImportedPoint point = ReadPositionAndColor(text);
  const uint64_t num_observations = text->Count("a number of observations");
  for (uint64_t i = 0; i < num_observations; ++i) {
    ImportedObservation observation;
    const uint64_t place = text->Count("the index of an image");
    if (place >= num_images) {
      text->Throw("a point refers to image " + std::to_string(place) +
                  ", but there are " + std::to_string(num_images) +
                  "; export the file again");
    }
    observation.image_place = place;
    text->Count("the index of a feature");
    for (double& x : observation.pixel) x = text->Number("a pixel coordinate");
    point.track.push_back(observation);
  }
  return point;
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
  for (uint64_t i = 0; i < num_points; ++i) {
    model.points.push_back(ReadPoint(model.images.size(), &text));
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
