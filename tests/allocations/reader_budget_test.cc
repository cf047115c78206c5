// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <filesystem>

#include "allocations/allocations.h"
#include "allocations/sample_files.h"

namespace mgsfm {
namespace {

double BytesIn(const std::filesystem::path& path) {
  if (std::filesystem::is_regular_file(path)) {
    return static_cast<double>(std::filesystem::file_size(path));
  }
  double size = 0.0;
  for (const auto& entry : std::filesystem::directory_iterator(path)) {
    size += static_cast<double>(entry.file_size());
  }
  return size;
}

struct Cost {
  double file_size = 0.0;
  double num_calls = 0.0;
  double num_bytes = 0.0;
};

Cost CostOf(const Reader& reader) {
  reader.read();  // allocates what stays
  StartAllocationCount();
  reader.read();
  const AllocationCounts counts = StopAllocationCount();
  return {BytesIn(reader.path), static_cast<double>(counts.num_calls),
          static_cast<double>(counts.num_bytes)};
}

// Every reader needs time and memory in proportion to its file. Four times the
// file may cost four times as much, and a fifth more for arrays that grow by
// doubling; what is quadratic would cost sixteen times as much.
TEST(ReaderBudget, IsLinearInTheSizeOfTheFile) {
  const SampleFiles small_files(30), large_files(120);
  const std::vector<Reader> small = small_files.Readers();
  const std::vector<Reader> large = large_files.Readers();
  for (size_t i = 0; i < small.size(); ++i) {
    const Cost cost1 = CostOf(small[i]), cost4 = CostOf(large[i]);
    const double growth = std::max(1.0, cost4.file_size / cost1.file_size);
    EXPECT_LE(cost4.num_calls, 1.2 * growth * cost1.num_calls) << small[i].name;
    EXPECT_LE(cost4.num_bytes, 2.0 * growth * cost1.num_bytes) << small[i].name;
  }
}

}  // namespace
}  // namespace mgsfm
