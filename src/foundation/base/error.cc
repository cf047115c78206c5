// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/base/error.h"

namespace mgsfm::internal {

void ThrowContractError(const char* file, int line, const char* condition,
                        const std::string& values) {
  std::ostringstream os;
  os << file << ':' << line << ": check failed: " << condition;
  if (!values.empty()) os << " (" << values << ')';
  throw ContractError(os.str());
}

}  // namespace mgsfm::internal
