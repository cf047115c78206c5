// SPDX-License-Identifier: BSD-3-Clause
#include "allocations/sample_files.h"

#include <fstream>

#include "matching/match_list.h"

namespace mgsfm {

void SampleFiles::ReadPairs(const std::string& path) const {
  std::ifstream file(path);
  (void)ReadPairList(file, path, Names());
}

void SampleFiles::ReadMatches(const std::string& path) const {
  std::ifstream file(path);
  (void)ReadMatchList(file, path, Names());
}

}  // namespace mgsfm
