// SPDX-License-Identifier: BSD-3-Clause
#include "fuzz/fuzz_model.h"

namespace mgsfm {

void FuzzTextModel(const std::string& input) {
  FuzzModel(input, ModelFormat::kText);
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(text_model, mgsfm::FuzzTextModel)
