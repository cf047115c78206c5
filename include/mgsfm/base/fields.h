// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <tuple>
#include <type_traits>
#include <utility>

namespace mgsfm {

// A summary names its fields once, in the order of the report; the report and
// the Python dicts are generated from it (src/foundation/scene/fields_json.h):
//
//   struct TrackSummary {
//     int num_tracks = 0;
//     double mean_length = 0.0;
//
//     auto Fields() const {
//       return Named("num_tracks", num_tracks, "mean_length", mean_length);
//     }
//   };
//
// A field is a number, a text, an enum with an EnumTable, a nested Named(...),
// a struct with Fields, or an optional or vector of these.
template <class... T>
struct NamedFields {
  std::tuple<T...> fields;  // names and values alternate; refers to members
};
template <class... T>
NamedFields<T...> Named(T&&... fields) {
  return {std::tuple<T...>(std::forward<T>(fields)...)};
}

template <class T, class = void>
inline constexpr bool kHasFields = false;
template <class T>
inline constexpr bool
    kHasFields<T, std::void_t<decltype(std::declval<const T&>().Fields())>> =
        true;

// The kind of item whose id or name the output shows instead of its index. Idx
// is int, or an optional or vector of int.
enum class Item { kCameraId, kFrameId, kFrameName, kImageName, kSensorName };
template <Item kItem, class Idx>
struct ItemOf {
  Idx idx;
};
template <Item kItem, class Idx>
ItemOf<kItem, Idx> As(Idx idx) {
  return {std::move(idx)};
}

// An angle that the output shows in degrees.
struct InDegrees {
  double angle_rad = 0.0;
};

}  // namespace mgsfm
