// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mgsfm/base/options.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

enum class ViewProjection { kAuto, kPinhole, kCube };

template <>
struct EnumTable<ViewProjection> {
  static constexpr std::pair<std::string_view, ViewProjection> kNames[] = {
      {"auto", ViewProjection::kAuto},
      {"pinhole", ViewProjection::kPinhole},
      {"cube", ViewProjection::kCube}};
};

// Names and defaults are COLMAP's where it has the option.
struct ViewOptions {
  Option<ViewProjection> projection{
      "projection", ViewProjection::kAuto,
      "Choose the views. pinhole: one per image. cube: one per visible face of "
      "a cube, with fixed poses in the rig. auto: cube for fisheyes and "
      "panoramas too wide for a pinhole image."};
  Option<double> field_of_view_deg{
      "field_of_view", 0.0, Between(0.0, 160.0), "deg",
      "Set the horizontal field of view of each undistorted image. 0: 90 for "
      "the faces of a cube; for a pinhole image, the field of view of the "
      "original, at most 120."};
  Option<double> max_view_angle_deg{
      "max_view_angle", 0.0, Between(0.0, 180.0), "deg",
      "Use pixels up to this angle to the optical axis; masks show the others. "
      "0: the angle at the nearest image border, at least 90."};
  Option<double> blank_pixels{
      "blank_pixels", 0.0, Between(0.0, 1.0),
      "Keep this amount of blank pixels in a pinhole image of the original "
      "field of view: 0 crops to pixels that the original has, 1 keeps all of "
      "them."};
  Option<double> min_scale{
      "min_scale", 0.2, Range{0.0, 10.0, true, false},
      "Limit the factor by which cropping may shrink a view."};
  Option<double> max_scale{
      "max_scale", 2.0, Range{0.0, 10.0, true, false},
      "Limit the factor by which blank pixels may enlarge a view."};
  Option<int> max_image_size{
      "max_image_size", -1, AtLeast(-1), "px",
      "Limit the width and height of undistorted images. -1: no limit."};
  Option<bool> center_principal_point{
      "center_principal_point", false,
      "Crop images so that the principal point is their center, as some "
      "programs assume."};

  template <class Visitor>
  void Describe(Visitor& visit) {
    visit(projection, field_of_view_deg, max_view_angle_deg, blank_pixels,
          min_scale, max_scale, max_image_size, center_principal_point);
  }
};

// A pinhole image of part of the field of view of a camera, with the same
// center.
struct View {
  std::string name;  // "front", "left", ...; "" for a pinhole image
  Eigen::Quaterniond view_from_cam = Eigen::Quaterniond::Identity();
  Camera camera;  // PINHOLE
  // Rays of the original camera at larger angles to its axis are not used.
  double max_view_angle_rad = 0.0;
};

// The views of a camera; the first one has the orientation of the camera. Views
// have the resolution of the original at its center, so a view loses no detail
// unless max_image_size requires it. Faces of a cube overlap if they are wider
// than 90 degrees; faces that see nothing are omitted.
//
// A camera is too wide for a pinhole image if that would enlarge pixels at the
// border more than four times, which is the magnification of an equidistant
// fisheye 60 degrees off its axis.
//
// Throws Error if the camera model does not project its own axis, or if images
// have more than 32766 pixels along one side.
std::vector<View> PlanViews(const Camera& camera, const ViewOptions& options);

// The pixel of the original camera that a pixel of the view shows; nullopt if
// the camera does not see it.
std::optional<Eigen::Vector2d> OriginalPixel(const Camera& camera,
                                             const View& view,
                                             const Eigen::Vector2d& pixel);

// The view that shows a pixel of the original camera, the one with the nearest
// optical axis if several do, and the pixel in it.
struct ViewPixel {
  int view_idx;
  Eigen::Vector2d pixel;
};
std::optional<ViewPixel> FindInViews(const Camera& camera,
                                     const std::vector<View>& views,
                                     const Eigen::Vector2d& pixel);

// Whether the view has pixels that the camera does not see.
bool HasBlankPixels(const Camera& camera, const View& view);

// Whether the only view is the image itself.
bool IsUnchanged(const Camera& camera, const std::vector<View>& views);

}  // namespace mgsfm
