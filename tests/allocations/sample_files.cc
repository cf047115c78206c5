// SPDX-License-Identifier: BSD-3-Clause
#include "allocations/sample_files.h"

#include "matching/match_list.h"

namespace mgsfm {

void SampleFiles::ReadPairs(const std::string& path) const {
  (void)ReadPairList(TextLines(path), Names());
}

void SampleFiles::ReadMatches(const std::string& path) const {
  (void)ReadMatchList(TextLines(path), Names());
}

}  // namespace mgsfm
