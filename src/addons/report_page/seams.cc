// SPDX-License-Identifier: BSD-3-Clause
#include "report_page/seams.h"

#include <map>
#include <string>

namespace mgsfm {

std::set<std::pair<int, int>> SeamPlaces(const PageModel& model) {
  using Json = nlohmann::ordered_json;
  std::map<std::string, int> frame_of_name;
  for (size_t i = 0; i < model.input.scene.frames.size(); ++i) {
    frame_of_name[model.input.scene.frames[i].name] = static_cast<int>(i);
  }
  std::set<std::pair<int, int>> places;
  for (const Json& seam : GetArray(model.model_report, "seams")) {
    std::map<int, std::pair<int, const char*>> stretches;  // by first frame
    for (const char* side : {"frames_before", "frames_after"}) {
      for (const Json& names : GetArray(seam, side)) {
        const auto range = FrameRange(names, frame_of_name);
        if (range) stretches[range->first] = {range->second, side};
      }
    }
    const std::pair<int, const char*>* last = nullptr;
    for (const auto& [first, stretch] : stretches) {
      if (last && last->second != stretch.second) {
        places.emplace(last->first, first);
      }
      last = &stretch;
    }
  }
  return places;
}

}  // namespace mgsfm
