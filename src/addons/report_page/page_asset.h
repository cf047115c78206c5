// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string_view>

namespace mgsfm {

// The page without content, which web/build.mjs makes from web/src. It has the
// marks <!--title-->, <!--summary-->, <!--details-->, and in elements of their
// own /*header*/ and /*arrays*/.
std::string_view PageAsset();

}  // namespace mgsfm
