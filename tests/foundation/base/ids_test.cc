// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/base/ids.h"

#include <gtest/gtest.h>

#include <sstream>
#include <type_traits>
#include <unordered_set>

namespace mgsfm {
namespace {

static_assert(!std::is_convertible_v<uint32_t, ImageId>);
static_assert(!std::is_convertible_v<ImageId, uint32_t>);
static_assert(!std::is_constructible_v<ImageId, CameraId>);

TEST(Id, ComparesPrintsAndHashesItsValue) {
  EXPECT_EQ(ImageId(3), ImageId(3));
  EXPECT_NE(ImageId(3), ImageId(4));
  EXPECT_LT(ImageId(3), ImageId(4));
  std::ostringstream text;
  text << ImageId(4294967295u);
  EXPECT_EQ(text.str(), "4294967295");
  const std::unordered_set<ImageId> ids = {ImageId(1), ImageId(1), ImageId(2)};
  EXPECT_EQ(ids.size(), 2u);
}

}  // namespace
}  // namespace mgsfm
