// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/LU>
#include <algorithm>
#include <optional>

#include "base/natural_order.h"
#include "base/ranges.h"
#include "calibration/calibration.h"
#include "calibration/lens_models.h"
#include "geometry/rigid_matrix.h"
#include "scene/value_check.h"

namespace mgsfm {
namespace {

std::vector<double> Values(const YamlValue& map,
                           const std::vector<std::string>& keys) {
  std::vector<double> values;
  for (const std::string& key : keys) values.push_back(map[key].Number());
  return values;
}

// The names of a camera, which the file may contain.
std::vector<std::string> NamesOf(const YamlValue& file,
                                 const std::filesystem::path& path) {
  std::vector<std::string> names;
  if (const auto name = file.Find("camera_name")) names.push_back(name->Text());
  const std::string stem = path.stem().string();
  names.push_back(stem);
  // RTAB-Map names the files of a stereo pair NAME_left.yaml, NAME_right.yaml.
  const size_t underscore = stem.rfind('_');
  if (underscore != std::string::npos) {
    const std::string side = stem.substr(underscore + 1);
    if (side == "left" || side == "right") names.push_back(side);
  }
  return names;
}

}  // namespace

FoundCameras ReadCamodocal(const YamlValue& file,
                           const std::filesystem::path& path) {
  if (!file.Has("model_type")) return std::nullopt;
  CalibratedCamera camera;
  camera.names = NamesOf(file, path);
  camera.place = file["model_type"].Place();
  camera.size_px.emplace(file["image_width"].Size(),
                         file["image_height"].Size());
  const std::string model = file["model_type"].Text();
  if (model == "PINHOLE") {
    const auto n =
        Values(file["projection_parameters"], {"fx", "fy", "cx", "cy"});
    SetLens({n[0], n[1], n[2], n[3], "radtan",
             Values(file["distortion_parameters"], {"k1", "k2", "p1", "p2"})},
            &camera);
  } else if (model == "KANNALA_BRANDT") {
    const YamlValue projection = file["projection_parameters"];
    const auto n = Values(projection, {"mu", "mv", "u0", "v0"});
    SetLens({n[0], n[1], n[2], n[3], "equidistant",
             Values(projection, {"k2", "k3", "k4", "k5"})},
            &camera);
  } else if (model == "MEI") {
    const auto n =
        Values(file["projection_parameters"], {"gamma1", "gamma2", "u0", "v0"});
    SetUnifiedLens(
        {n[0], n[1], n[2], n[3], file["mirror_parameters"]["xi"].Number(), 0.0,
         Values(file["distortion_parameters"], {"k1", "k2", "p1", "p2"})},
        &camera);
  } else {
    SetUnknownLens(model, &camera);
  }
  camera.cam_from_base = CamFromVehicleOfKitti360(path, camera.names.front());
  return std::vector{camera};
}

namespace {

// The part of "/sensors/cam0/image_raw" that names the camera.
std::optional<std::string> CameraOfTopic(std::string topic) {
  const std::vector<std::string> generic = {"camera", "compressed", "rgb"};
  while (!topic.empty()) {
    const size_t slash = topic.rfind('/');
    const std::string part = topic.substr(slash + 1);
    topic.erase(slash == std::string::npos ? 0 : slash);
    const bool is_generic = part.empty() || part.compare(0, 5, "image") == 0 ||
                            Contains(generic, part);
    if (!is_generic) return part;
  }
  return std::nullopt;
}

void ReadLens(const YamlValue& value, CalibratedCamera* camera) {
  const std::string projection = value["camera_model"].Text();
  const YamlValue intrinsics = value["intrinsics"];
  const auto model = value.Find("distortion_model");
  const std::string distortion = model ? model->Text() : "none";
  if (projection == "eucm") {
    const std::vector<double> n = intrinsics.Numbers(6);
    camera->model = CameraModelId::kEucm;
    camera->params = {n[2], n[3], n[4] + 0.5, n[5] + 0.5, n[0], n[1]};
    return;
  }
  if (projection == "ds") {
    const std::vector<double> n = intrinsics.Numbers(6);
    SetUnifiedLens({n[2], n[3], n[4], n[5], n[0], n[1], {}}, camera);
    return;
  }
  if (projection == "omni") {
    const std::vector<double> n = intrinsics.Numbers(5);
    if (distortion == "radtan" || distortion == "none") {
      SetUnifiedLens(
          {n[1], n[2], n[3], n[4], n[0], 0.0,
           distortion == "none" ? std::vector<double>()
                                : value["distortion_coeffs"].Numbers()},
          camera);
    } else {
      SetUnknownLens("omni with " + distortion, camera);
    }
    return;
  }
  if (projection != "pinhole") {
    SetUnknownLens(projection, camera);
    return;
  }
  const std::vector<double> n = intrinsics.Numbers(4);
  PinholeLens lens{n[0], n[1], n[2], n[3], distortion, {}};
  if (distortion != "none") {
    lens.distortion = value["distortion_coeffs"].Numbers();
  }
  SetLens(lens, camera);
}

bool IsKalibr(const YamlValue& file) {
  if (!file.IsMap()) return false;
  const auto items = file.Items();
  return AnyOf(items, [](const auto& item) {
    return item.second.Has("camera_model") && item.second.Has("intrinsics");
  });
}

// Checks that the poses from T_cam_imu and T_cn_cnm1 agree. Kalibr writes both
// from one estimate.
void CheckPosesAgree(const YamlValue& value, const Rigid3& by_imu,
                     const Rigid3& by_chain) {
  const std::optional<std::string> difference = WhyDifferent(by_imu, by_chain);
  if (!difference) return;
  value.Throw(
      "has a pose by T_cam_imu that differs from the one by T_cn_cnm1 " +
      *difference + "; remove the wrong one");
}

using Poses = std::vector<std::optional<Rigid3>>;

// The poses that T_cn_cnm1 and T_cam_imu connect. The base is the first camera
// that has one of them.
class KalibrPoses {
 public:
  explicit KalibrPoses(const std::vector<YamlValue>& values)
      : cam_from_base_(values.size()) {
    for (const YamlValue& value : values) {
      const auto from_imu = value.Find("T_cam_imu");
      const auto from_before = value.Find("T_cn_cnm1");
      cam_from_imu_.push_back(from_imu ? std::make_optional(from_imu->Pose())
                                       : std::nullopt);
      cam_from_before_.push_back(from_before && !cam_from_before_.empty()
                                     ? std::make_optional(from_before->Pose())
                                     : std::nullopt);
      const size_t i = cam_from_imu_.size() - 1;
      if (cam_from_before_[i] && cam_from_imu_[i] && cam_from_imu_[i - 1]) {
        CheckPosesAgree(value,
                        *cam_from_imu_[i] * cam_from_imu_[i - 1]->Inverse(),
                        *cam_from_before_[i]);
      }
    }
  }

  // Throws Error for a pose that nothing connects to the base.
  Poses Connect(const std::vector<YamlValue>& values) {
    size_t base = 0;
    while (base < values.size() && !HasPose(base)) ++base;
    if (base == values.size()) return cam_from_base_;
    cam_from_base_[base] = Rigid3();
    while (Advance()) {
    }
    for (size_t i = 0; i < values.size(); ++i) {
      if (cam_from_base_[i] || !HasPose(i)) continue;
      values[i].Throw(
          "has a pose that neither T_cn_cnm1 nor T_cam_imu connects to the "
          "first camera; add the missing one to the cameras before it, or "
          "remove it");
    }
    return cam_from_base_;
  }
  // The pose for the cameras that are connected; nullopt without T_cam_imu.
  const std::optional<Rigid3>& ImuFromBase() const { return imu_from_base_; }

 private:
  bool HasPose(size_t i) const {
    return cam_from_imu_[i] || cam_from_before_[i] ||
           (i + 1 < cam_from_before_.size() && cam_from_before_[i + 1]);
  }
  // Connects cameras to the connected ones; returns whether there are any.
  bool Advance() {
    bool has_advanced = false;
    const auto set = [&](const Rigid3& value, std::optional<Rigid3>* pose) {
      *pose = value;
      has_advanced = true;
    };
    for (size_t i = 0; i < cam_from_base_.size(); ++i) {
      auto& pose = cam_from_base_[i];
      if (cam_from_before_[i] && cam_from_base_[i - 1] && !pose) {
        set(*cam_from_before_[i] * *cam_from_base_[i - 1], &pose);
      } else if (cam_from_before_[i] && pose && !cam_from_base_[i - 1]) {
        set(cam_from_before_[i]->Inverse() * *pose, &cam_from_base_[i - 1]);
      }
      if (cam_from_imu_[i] && imu_from_base_ && !pose) {
        set(*cam_from_imu_[i] * *imu_from_base_, &pose);
      } else if (cam_from_imu_[i] && pose && !imu_from_base_) {
        set(cam_from_imu_[i]->Inverse() * *pose, &imu_from_base_);
      }
    }
    return has_advanced;
  }

  Poses cam_from_imu_, cam_from_before_, cam_from_base_;
  std::optional<Rigid3> imu_from_base_;
};

// The cameras, in the order of their numbers.
std::vector<std::pair<std::string, YamlValue>> KalibrItems(
    const YamlValue& file) {
  auto items = file.Items();
  EraseIf(&items, [](const auto& item) { return !item.second.IsMap(); });
  std::stable_sort(items.begin(), items.end(),
                   [](const auto& a, const auto& b) {
                     return IsNaturallyBefore(a.first, b.first);
                   });
  return items;
}

}  // namespace

std::vector<CalibratedCamera> ReadKalibrPoses(const YamlValue& file) {
  std::vector<CalibratedCamera> cameras;
  std::vector<YamlValue> values;
  for (const auto& [name, value] : KalibrItems(file)) {
    CalibratedCamera camera;
    if (const auto topic = value.Find("rostopic")) {
      if (const auto part = CameraOfTopic(topic->Text())) {
        camera.names.push_back(*part);
      }
    }
    camera.names.push_back(name);
    camera.place = value.Place();
    values.push_back(value);
    cameras.push_back(std::move(camera));
  }
  KalibrPoses connected(values);
  const Poses poses = connected.Connect(values);
  for (size_t i = 0; i < cameras.size(); ++i) {
    cameras[i].cam_from_base = poses[i];
    if (poses[i] && connected.ImuFromBase()) {
      cameras[i].cam_from_imu = *poses[i] * connected.ImuFromBase()->Inverse();
    }
  }
  return cameras;
}

FoundCameras ReadKalibr(const YamlValue& file,
                        const std::filesystem::path& /*path*/) {
  if (!IsKalibr(file)) return std::nullopt;
  std::vector<CalibratedCamera> cameras = ReadKalibrPoses(file);
  size_t i = 0;
  for (const auto& [name, value] : KalibrItems(file)) {
    CalibratedCamera& camera = cameras[i++];
    if (const auto size = value.Find("resolution")) {
      camera.size_px = size->ImageSize();
    }
    ReadLens(value, &camera);
    if (const auto shift = value.Find("timeshift_cam_imu")) {
      camera.time_shift_s = shift->Number();
    }
  }
  return cameras;
}

namespace {

// The names in files of ROS, of OpenCV's samples, and in messages of ROS.
const std::vector<std::string> kMatrix = {"camera_matrix", "Camera_Matrix",
                                          "cameraMatrix", "K", "k"};
const std::vector<std::string> kDistortion = {"distortion_coefficients",
                                              "Distortion_Coefficients",
                                              "distCoeffs", "D", "d"};
const std::vector<std::string> kWidth = {"image_width", "image_Width", "width"};
const std::vector<std::string> kHeight = {"image_height", "image_Height",
                                          "height"};
const std::vector<std::string> kRectification = {"rectification_matrix", "R",
                                                 "r"};
const std::vector<std::string> kProjection = {"projection_matrix", "P", "p"};

std::string DistortionModel(const YamlValue& file) {
  if (const auto model = file.Find("distortion_model")) return model->Text();
  const auto is_fisheye = file.Find("fisheye_model");
  return is_fisheye && is_fisheye->Number() != 0.0 ? "fisheye" : "plumb_bob";
}

// The rectified camera is rotated by R, and its projection matrix K [I | t] is
// relative to the rectified left camera.
std::optional<Rigid3> CamFromLeft(const YamlValue& file) {
  const auto rectification = file.FindAny(kRectification);
  const auto projection = file.FindAny(kProjection);
  if (!rectification || !projection) return std::nullopt;
  const std::vector<double> r = rectification->Numbers(9);
  const std::vector<double> p = projection->Numbers(12);
  const Eigen::Map<const RigidMatrix> P(p.data());
  const Eigen::Matrix3d K = P.leftCols<3>();
  if (K.isZero(0.0)) return std::nullopt;  // not rectified
  const auto rectified_from_cam = RigidFromRotation(r.data());
  if (!rectified_from_cam) {
    rectification->Throw("is not a rotation; correct it");
  }
  const Eigen::Vector3d t = K.fullPivLu().solve(P.col(3));
  if (!K.fullPivLu().isInvertible()) {
    projection->Throw("is not K [I | t]; correct it");
  }
  return rectified_from_cam->Inverse() *
         Rigid3{Eigen::Quaterniond::Identity(), t};
}

}  // namespace

FoundCameras ReadOpenCv(const YamlValue& file,
                        const std::filesystem::path& path) {
  const auto matrix = file.FindAny(kMatrix);
  if (!matrix) return std::nullopt;
  const auto distortion = file.FindAny(kDistortion);
  if (!distortion) return std::nullopt;
  CalibratedCamera camera;
  camera.names = NamesOf(file, path);
  camera.place = matrix->Place();
  PinholeLens lens;
  lens.distortion_model = DistortionModel(file);
  lens.distortion = distortion->Numbers();
  SetMatrixAndLens(matrix->Numbers(9), 3, lens, &camera);
  const auto width = file.FindAny(kWidth);
  const auto height = file.FindAny(kHeight);
  if (width && height) camera.size_px.emplace(width->Size(), height->Size());
  camera.cam_from_base = CamFromLeft(file);
  return std::vector{camera};
}

}  // namespace mgsfm
