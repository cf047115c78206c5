// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cstdlib>
#include <iostream>
#include <new>
#include <sstream>

#include "allocations/allocations.h"
#include "allocations/sample_files.h"
#include "mgsfm/pipeline/mapper.h"

namespace mgsfm {
namespace {

// Makes each allocation in turn fail in a call that otherwise succeeds.
// Only std::bad_alloc and Error may leave it, and it must release all memory.
// The environment variable MGSFM_FAULT_STRIDE selects every n-th allocation;
// by default at most `max_runs` of them fail.
void FailAllocations(const std::string& name,
                     const std::function<void()>& function, long max_runs) {
  SCOPED_TRACE(name);
  function();  // makes what lives until the end of the process
  StartAllocationCount();
  function();
  const AllocationCounts clean = StopAllocationCount();
  const char* text = std::getenv("MGSFM_FAULT_STRIDE");
  const long stride = text != nullptr
                          ? std::atol(text)
                          : std::max(1L, clean.num_calls / max_runs);
  long num_failures = 0;
  for (long call = 0; call < clean.num_calls; call += stride, ++num_failures) {
    const long live_before = StopAllocationCount().num_live;
    bool is_thrown = false;
    StartAllocationCount(call);
    try {
      function();
    } catch (const std::bad_alloc&) {
      is_thrown = true;
    } catch (const Error&) {
      is_thrown = true;
    }
    const AllocationCounts counts = StopAllocationCount();
    ASSERT_EQ(counts.num_live, live_before) << "a leak, allocation " << call;
    // A result that lacks a part would be worse than none.
    ASSERT_TRUE(is_thrown || counts.num_calls <= call ||
                counts.num_calls >= clean.num_calls)
        << "allocation " << call << " was ignored";
  }
  std::cout << name << ": " << num_failures << " failures of "
            << clean.num_calls << " allocations" << std::endl;
}

class AllocationTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { files_ = new SampleFiles(40); }
  static void TearDownTestSuite() {
    delete files_;
    files_ = nullptr;
  }
  static SampleFiles* files_;
};
SampleFiles* AllocationTest::files_ = nullptr;

TEST_F(AllocationTest, FailureInReadersIsReported) {
  for (const Reader& reader : files_->Readers()) {
    // The destructor of nlohmann::json allocates, which nothing can catch.
    if (reader.name == "rigs.json") continue;
    FailAllocations(reader.name, reader.read, 60);
  }
}

TEST_F(AllocationTest, FailureInTheMapperIsReported) {
  MapperInput input;
  const Simulation simulation = files_->simulation();
  input.scene = simulation.scene;
  input.view_graph = simulation.view_graph;
  for (const int num_threads : {1, 2}) {
    Context context;
    context.num_threads = num_threads;
    FailAllocations(
        "mapper, " + std::to_string(num_threads) + " threads",
        [&] { (void)RunMapper(input, {}, context); }, 12);
  }
}

}  // namespace
}  // namespace mgsfm
