// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace mgsfm {

// Treatment of lines about images that a scene does not have. A finished model
// may lack images of its database.
enum class OtherImages { kReject, kIgnore };

}  // namespace mgsfm
