// SPDX-License-Identifier: BSD-3-Clause
#include "files/output_file.h"

#include <cerrno>
#include <fstream>
#include <system_error>

#include "mgsfm/base/error.h"

namespace mgsfm {

void ThrowWriteError(const std::filesystem::path& path) {
  const int reason = errno;
  std::string message = "cannot write '" + path.string() + "'";
  if (reason != 0) message += ": " + std::generic_category().message(reason);
  const bool is_full = reason == ENOSPC || reason == EDQUOT || reason == EFBIG;
  throw Error(message + (is_full ? "; free some space or choose another path"
                                 : "; choose another path"));
}

void WriteFile(const std::filesystem::path& path, const std::string& content) {
  errno = 0;
  std::ofstream file(path, std::ios::binary | std::ios::trunc);
  file << content;
  file.close();
  if (!file) ThrowWriteError(path);
}

}  // namespace mgsfm
