// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "mgsfm/base/error.h"
#include "support/temp_dir.h"

namespace mgsfm {

// A fuzz target is a function that reads arbitrary bytes as a file of one kind.
// It returns if the reader throws Error, or if the result is finite and reads
// back identically after writing. Anything else ends the process: another
// exception, or FUZZ_CHECK.
//
// libFuzzer runs one target per program (preset `fuzz`, scripts/fuzz.sh). All
// other builds link all targets into one test that replays tests/fuzz/corpus.
struct FuzzTarget {
  std::string name;  // of its folder in the corpus
  void (*run)(const std::string& input);
};

inline std::vector<FuzzTarget>& FuzzTargets() {
  static std::vector<FuzzTarget> targets;
  return targets;
}

#ifdef MGSFM_FUZZER
#define MGSFM_FUZZ_TARGET(name, function)                                   \
  extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) { \
    function(size == 0                                                      \
                 ? ""                                                       \
                 : std::string(reinterpret_cast<const char*>(data), size)); \
    return 0;                                                               \
  }
#else
#define MGSFM_FUZZ_TARGET(name, function)                \
  namespace {                                            \
  const bool is_registered_##name = [] {                 \
    ::mgsfm::FuzzTargets().push_back({#name, function}); \
    return true;                                         \
  }();                                                   \
  }
#endif

#define FUZZ_CHECK(condition)                                           \
  do {                                                                  \
    if (!(condition)) {                                                 \
      std::fprintf(stderr, "%s:%d: violated: %s\n", __FILE__, __LINE__, \
                   #condition);                                         \
      std::abort();                                                     \
    }                                                                   \
  } while (false)

// Returns false if the reader throws Error.
template <class Function>
bool Accepts(const Function& read) {
  try {
    read();
    return true;
  } catch (const Error& error) {
    FUZZ_CHECK(error.what()[0] != '\0');
    return false;
  }
}

// A folder in memory for the files of one target.
inline const std::filesystem::path& FuzzFolder() {
  static const TempDir* const dir = [] {
    if (std::filesystem::is_directory("/dev/shm")) {
      setenv("TMPDIR", "/dev/shm", 1);
    }
    auto* made = new TempDir;
    std::atexit([] { std::filesystem::remove_all(FuzzFolder()); });
    return made;
  }();
  return dir->path();
}

// The input as several files, which lines "%%" separate.
inline std::vector<std::string> SplitFiles(const std::string& input,
                                           size_t num_files) {
  static const std::string kSeparator = "\n%%\n";
  std::vector<std::string> files;
  size_t begin = 0;
  while (files.size() + 1 < num_files) {
    const size_t end = input.find(kSeparator, begin);
    if (end == std::string::npos) break;
    files.push_back(input.substr(begin, end - begin));
    begin = end + kSeparator.size();
  }
  files.push_back(input.substr(begin));
  files.resize(num_files);
  return files;
}

// Takes values from the front of the input; zeros beyond its end.
class ByteSource {
 public:
  explicit ByteSource(const std::string& bytes) : bytes_(bytes) {}

  bool IsEmpty() const { return position_ >= bytes_.size(); }
  template <class T>
  T Take() {
    T value{};
    const std::string bytes = TakeString(sizeof(T));
    std::memcpy(&value, bytes.data(), bytes.size());
    return value;
  }
  std::string TakeString(size_t max_size) {
    const size_t begin = std::min(position_, bytes_.size());
    position_ = begin + std::min(max_size, bytes_.size() - begin);
    return bytes_.substr(begin, position_ - begin);
  }

 private:
  const std::string& bytes_;
  size_t position_ = 0;
};

}  // namespace mgsfm
