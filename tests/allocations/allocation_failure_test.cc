// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <map>
#include <new>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "allocations/allocations.h"
#include "allocations/mapper_runs.h"
#include "allocations/sample_files.h"
#include "base/file_reading.h"
#include "features/image_file.h"
#include "files/exif_gps_time.h"

namespace mgsfm {
namespace {

using Function = std::function<std::string()>;

// The n of the environment variable MGSFM_FAULT_STRIDE. By default, there is
// only a sample of failures.
std::optional<long> Stride() {
  const char* text = std::getenv("MGSFM_FAULT_STRIDE");
  if (text == nullptr) return std::nullopt;
  return std::max(1L, std::atol(text));
}

// About so many of the items, in equal steps.
template <class T>
std::vector<T> Sample(const std::vector<T>& items, size_t num_samples) {
  std::vector<T> sample;
  const size_t step = std::max<size_t>(1, items.size() / num_samples);
  for (size_t i = 0; i < items.size(); i += step) sample.push_back(items[i]);
  return sample;
}

// Exit codes of children, which no other exit has.
enum Outcome { kThrown = 50, kHarmless, kLeak, kWrong, kCrash };

// The outcome of a call of a function while an allocation fails. Only
// std::bad_alloc and Error may leave it, and it must release all memory. A
// result that lacks a part would be worse than none.
template <class StartFailure>
Outcome CallWithFailure(const Function& function, const std::string& expected,
                        const StartFailure& start) {
  const long live_before = StopAllocationCount().num_live;
  bool is_thrown = false, is_expected = false;
  start();
  try {
    is_expected = function() == expected;
  } catch (const std::bad_alloc&) {
    is_thrown = true;
  } catch (const Error&) {
    is_thrown = true;
  }
  const bool is_leak = StopAllocationCount().num_live != live_before;
  if (!is_thrown && !is_expected) return kWrong;
  if (is_leak) return kLeak;
  return is_thrown ? kThrown : kHarmless;
}

const char* NameOf(Outcome outcome) {
  return outcome == kLeak    ? "a leak"
         : outcome == kWrong ? "a result that lacks a part"
                             : "a crash";
}

bool IsSound(Outcome outcome) {
  return outcome == kThrown || outcome == kHarmless;
}

std::vector<CallStack> StacksOf(const Function& function) {
  StartStackRecording();
  function();
  return StopStackRecording();
}

// Numbers of calls mean the same in each call of the function.
void CheckOrder(const Function& function, long num_calls) {
  AllocationCounts counts[2];
  for (AllocationCounts& of_call : counts) {
    StartAllocationCount();
    function();
    of_call = StopAllocationCount();
  }
  EXPECT_EQ(counts[0].num_calls, num_calls);
  EXPECT_EQ(counts[1].num_calls, num_calls);
  EXPECT_EQ(counts[0].order_hash, counts[1].order_hash);
}

long CountCalls(const std::vector<CallStack>& stacks) {
  long num_calls = 0;
  for (const CallStack& stack : stacks) num_calls += stack.num_calls;
  return num_calls;
}

// Every n-th allocation.
std::vector<long> AllCalls(const std::vector<CallStack>& stacks) {
  std::vector<long> calls;
  for (long i = 0; i < CountCalls(stacks); i += *Stride()) calls.push_back(i);
  return calls;
}

// The first and the last allocation of every n-th stack. Most others repeat
// these.
std::vector<long> CallsOfStacks(const std::vector<CallStack>& stacks) {
  std::set<long> calls;
  for (size_t i = 0; i < stacks.size(); i += *Stride()) {
    calls.insert({stacks[i].first_call, stacks[i].last_call});
  }
  return {calls.begin(), calls.end()};
}

// A few of the first allocations of the stacks.
std::vector<long> SampleOfCalls(const std::vector<CallStack>& stacks) {
  std::vector<long> calls;
  for (const CallStack& stack : Sample(stacks, 60)) {
    calls.push_back(stack.first_call);
  }
  return calls;
}

std::string DescribeCall(const Function& function, long call) {
  StartStackRecording(call);
  function();
  return Describe(StopStackRecording().at(0));
}

// Calls that fail, and what comes of each.
using Outcomes = std::vector<std::pair<long, Outcome>>;

// Each failure in a call of its own.
Outcomes FailInCalls(const Function& function, const std::string& expected,
                     const std::vector<long>& calls) {
  Outcomes outcomes;
  for (const long call : calls) {
    outcomes.emplace_back(call, CallWithFailure(function, expected, [&] {
                            StartAllocationCount(call);
                          }));
  }
  return outcomes;
}

// Each failure in a process of its own, which is forked from a single call of
// the function at the allocation that fails. SQLite does not work in these.
Outcomes FailInForks(const Function& function, const std::string& expected,
                     const std::vector<long>& calls) {
  PrepareForking(calls);
  const Outcome outcome =
      CallWithFailure(function, expected, [] { StartForking(); });
  if (IsForkedChild()) _exit(outcome);
  Outcomes outcomes;
  for (const ForkedChild& child : StopForking()) {
    outcomes.emplace_back(child.failing_call,
                          WIFEXITED(child.status)
                              ? static_cast<Outcome>(WEXITSTATUS(child.status))
                              : kCrash);
  }
  EXPECT_EQ(outcome, kHarmless) << "without failures";
  EXPECT_EQ(outcomes.size(), calls.size());
  return outcomes;
}

// Makes allocations of a function with one thread fail: those that `select`
// chooses, or a sample.
template <class Select, class Fail>
void FailAllocations(const std::string& name, const Function& function,
                     const Select& select, const Fail& fail,
                     std::optional<Outcome> allowed = std::nullopt) {
  const std::string expected = function();
  const std::vector<CallStack> stacks = StacksOf(function);
  CheckOrder(function, CountCalls(stacks));
  const std::vector<long> calls =
      Stride() ? select(stacks) : SampleOfCalls(stacks);
  long num_harmless = 0;
  std::map<Outcome, std::vector<long>> bad;
  for (const auto& [call, outcome] : fail(function, expected, calls)) {
    if (outcome == kHarmless) ++num_harmless;
    if (!IsSound(outcome) && outcome != allowed) bad[outcome].push_back(call);
  }
  std::cout << name << ": " << calls.size() << " failures of "
            << CountCalls(stacks) << " allocations from " << stacks.size()
            << " call stacks; " << num_harmless << " without effect"
            << std::endl;
  for (const auto& [outcome, failing] : bad) {
    ADD_FAILURE() << name << ": " << failing.size() << " times "
                  << NameOf(outcome) << ", first after allocation "
                  << failing.front() << " at "
                  << DescribeCall(function, failing.front());
  }
}

Function MapWith(const MapperRun& run, int num_threads) {
  return [&run, num_threads] { return ResultOf(run, num_threads); };
}

// Makes the first allocations of call stacks fail that are not yet known.
void FailStacksOfThreads(const MapperRun& run, const std::string& expected,
                         std::set<uint64_t>* known) {
  const Function map = MapWith(run, 2);
  StartStackRecording();
  EXPECT_EQ(map(), expected) << "the number of threads matters";
  std::vector<CallStack> stacks;
  for (const CallStack& stack : StopStackRecording()) {
    if (known->insert(stack.hash).second) stacks.push_back(stack);
  }
  const size_t num_stacks = stacks.size();
  if (!Stride()) stacks = Sample(stacks, 20);
  size_t num_harmless = 0, num_missed = 0;
  for (const CallStack& stack : stacks) {
    bool is_reached = false;  // not with all orders of the threads
    for (int attempt = 0; attempt < 5 && !is_reached; ++attempt) {
      const Outcome outcome =
          CallWithFailure(map, expected, [&] { StartAllocationCount(stack); });
      ASSERT_TRUE(IsSound(outcome))
          << NameOf(outcome) << " at " << Describe(stack);
      is_reached = StopAllocationCount().num_failed > 0;
      num_harmless += is_reached && outcome == kHarmless;
    }
    num_missed += !is_reached;
  }
  std::cout << run.name << ", 2 threads: " << stacks.size() - num_missed
            << " failures of " << num_stacks << " further call stacks; "
            << num_harmless << " without effect, " << num_missed
            << " not reached" << std::endl;
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
    reader.read();  // makes what lives until the end of the process
    StartAllocationCount();
    reader.read();
    const long num_calls = StopAllocationCount().num_calls;
    // A reader that lacks a part of the result allocates less.
    const auto read = [&] {
      reader.read();
      return StopAllocationCount().num_calls < num_calls ? std::string("less")
                                                         : std::string();
    };
    FailAllocations(reader.name, read, AllCalls,
                    reader.name == "a.db" ? FailInCalls : FailInForks);
  }
}

// A tag that is lost changes the model. Exiv2 itself loses memory.
TEST_F(AllocationTest, FailureInTagsIsReported) {
  const std::string file =
      ReadFile(MGSFM_SOURCE_DIR "/tests/fuzz/corpus/exif/jpeg");
  const Function read = [&] {
    const ImageTags tags = ReadTags(file, 640, 480);
    const Eigen::Vector3d position = tags.position_wgs84.value();
    return std::to_string(tags.focal_length_px.value()) +
           std::to_string(position.sum());
  };
  FailAllocations("EXIF", read, AllCalls, FailInForks, kLeak);
  const Function copy = [&] { return ExifGpsTime(file).AddTo(file); };
  FailAllocations("copy of EXIF", copy, AllCalls, FailInForks, kLeak);
}

TEST_F(AllocationTest, FailureInWritersIsReported) {
  for (const ModelFormat format : {ModelFormat::kBinary, ModelFormat::kText}) {
    const TempDir dir;
    const Simulation& simulation = files_->simulation();
    const Function write = [&] {
      WriteModel(dir.path(), simulation.scene, simulation.ground_truth, format);
      std::string contents;
      for (const std::string stem :
           {"cameras", "images", "points3D", "rigs", "frames"}) {
        contents +=
            ReadFile(dir.path() / (stem + "." + std::string(EnumName(format))));
      }
      return contents;
    };
    FailAllocations(std::string(EnumName(format)), write, AllCalls,
                    FailInCalls);
  }
}

TEST_F(AllocationTest, FailureInTheMapperIsReported) {
  for (const MapperRun& run : MapperRuns()) {
    FailAllocations(run.name, MapWith(run, 1), CallsOfStacks, FailInForks);
  }
}

// With several threads, stacks are the same but not the order of allocations.
// The stacks that one thread has as well were the subject of the last test.
TEST_F(AllocationTest, FailureInThreadsIsReported) {
  std::set<uint64_t> known;
  for (const MapperRun& run : MapperRuns()) {
    const Function map = MapWith(run, 1);
    StartStackRecording();
    const std::string expected = map();
    for (const CallStack& stack : StopStackRecording()) {
      known.insert(stack.hash);
    }
    FailStacksOfThreads(run, expected, &known);
    if (!Stride()) break;  // a sample
  }
}

}  // namespace
}  // namespace mgsfm
