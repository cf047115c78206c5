// SPDX-License-Identifier: BSD-3-Clause
#include "fuzz/fuzz_model.h"

namespace mgsfm {

void FuzzBinaryModel(const std::string& input) {
  FuzzModel(input, ModelFormat::kBinary);
}

}  // namespace mgsfm

MGSFM_FUZZ_TARGET(binary_model, mgsfm::FuzzBinaryModel)
