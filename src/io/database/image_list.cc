// SPDX-License-Identifier: BSD-3-Clause
#include "database/image_list.h"

#include <algorithm>

#include "base/text.h"
#include "base/text_lines.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

template <class T, class Predicate>
void EraseUnless(const Predicate& is_kept, std::vector<T>* items) {
  items->erase(std::remove_if(items->begin(), items->end(),
                              [&](const T& item) { return !is_kept(item); }),
               items->end());
}

}  // namespace

std::vector<std::string> ReadImageList(const std::string& path) {
  TextLines lines(path, "'" + path + "' (image_list_path)");
  std::vector<std::string> names;
  while (lines.NextContent()) {
    names.emplace_back(lines.line());
    if (const auto problem = WhyUnusable(names.back())) {
      lines.Throw("the name " + *problem);
    }
  }
  return names;
}

void KeepListedImages(const std::set<std::string>& names,
                      const std::string& list_path,
                      DatabaseContents* contents) {
  const std::string list = "'" + list_path + "' (image_list_path)";
  if (names.empty()) throw Error(list + " lists no image");
  EraseUnless(
      [&](const ImageRow& image) { return names.count(image.name) > 0; },
      &contents->images);
  std::set<std::string> missing = names;
  std::set<ImageId> ids;
  for (const ImageRow& image : contents->images) {
    missing.erase(image.name);
    ids.insert(image.id);
  }
  if (!missing.empty()) {
    throw Error(list + " names '" + *missing.begin() +
                "', which the database '" + contents->path +
                "' does not have; correct the list, or extract and match the "
                "features of the image");
  }
  const auto has = [&](ImageId id) { return ids.count(id) > 0; };
  const auto has_pair = [&](const auto& pair) {
    return has(pair.image_id1) && has(pair.image_id2);
  };
  EraseUnless(has_pair, &contents->pairs);
  EraseUnless(has_pair, &contents->matches);
  for (FrameRow& frame : contents->frames) {
    EraseUnless([&](const FrameDataRow& data) { return has(data.image_id); },
                &frame.data);
  }
  EraseUnless([](const FrameRow& frame) { return !frame.data.empty(); },
              &contents->frames);
  contents->is_selection = true;
}

}  // namespace mgsfm
