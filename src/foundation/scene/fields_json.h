// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

#include "geometry/so3.h"
#include "mgsfm/base/fields.h"
#include "mgsfm/base/options.h"
#include "mgsfm/geometry/camera_models.h"
#include "mgsfm/scene/scene.h"

namespace mgsfm {

// Writes summaries (mgsfm/base/fields.h) as JSON. The scene maps indices to ids
// and names.
class JsonFields {
 public:
  using Json = nlohmann::ordered_json;

  explicit JsonFields(const Scene& scene) : scene_(scene) {}

  template <class T>
  Json ToJson(const T& value) const {
    if constexpr (kHasFields<T>) {
      return ToJson(value.Fields());
    } else if constexpr (std::is_same_v<T, CameraModelId>) {
      return InfoOf(value).name;
    } else if constexpr (std::is_enum_v<T>) {
      return EnumName(value);
    } else {
      return value;
    }
  }
  template <class... T>
  Json ToJson(const NamedFields<T...>& named) const {
    return ToObject(named.fields, std::make_index_sequence<sizeof...(T) / 2>());
  }
  Json ToJson(const InDegrees& angle) const {
    return RadToDeg(angle.angle_rad);
  }
  template <class T>
  Json ToJson(const std::optional<T>& value) const {
    return value ? ToJson(*value) : Json(nullptr);
  }
  template <class T>
  Json ToJson(const std::vector<T>& values) const {
    Json json = Json::array();
    for (const T& value : values) json.push_back(ToJson(value));
    return json;
  }
  // Names and their values as an object.
  template <class T>
  Json ToJson(const std::vector<std::pair<std::string, T>>& values) const {
    Json json = Json::object();
    for (const auto& [name, value] : values) json[name] = ToJson(value);
    return json;
  }
  template <Item kItem, class Idx>
  Json ToJson(const ItemOf<kItem, Idx>& item) const {
    if constexpr (std::is_same_v<Idx, int>) {
      return ToJson(kItem, item.idx);
    } else if constexpr (std::is_same_v<Idx, std::optional<int>>) {
      return item.idx ? ToJson(kItem, *item.idx) : Json(nullptr);
    } else {
      Json json = Json::array();
      for (const int idx : item.idx) json.push_back(ToJson(kItem, idx));
      return json;
    }
  }

 private:
  template <class Tuple, size_t... kIdxs>
  Json ToObject(const Tuple& fields, std::index_sequence<kIdxs...>) const {
    Json json = Json::object();
    ((json[std::get<2 * kIdxs>(fields)] =
          ToJson(std::get<2 * kIdxs + 1>(fields))),
     ...);
    return json;
  }
  Json ToJson(Item item, int idx) const {
    switch (item) {
      case Item::kCameraId:
        return scene_.cameras[idx].id.value();
      case Item::kFrameId:
        return scene_.frames[idx].id.value();
      case Item::kFrameName:
        return scene_.frames[idx].name;
      case Item::kImageName:
        return scene_.images[idx].name;
      case Item::kSensorName:
        break;
    }
    return scene_.sensors[idx].name;
  }

  const Scene& scene_;
};

}  // namespace mgsfm
