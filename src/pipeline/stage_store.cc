// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/pipeline/stage_store.h"

#include <algorithm>
#include <cstring>

#include "mgsfm/pipeline/mapper.h"
#include "pipeline/stage_archive.h"

namespace mgsfm {
namespace {

// The finaliser of splitmix64 for every eight bytes.
class HashSink {
 public:
  void Write(const void* data, size_t size) {
    const char* bytes = static_cast<const char*>(data);
    for (; size > 0;) {
      uint64_t word = 0;
      const size_t length = std::min(size, sizeof(word));
      std::memcpy(&word, bytes, length);
      Add(word);
      bytes += length;
      size -= length;
    }
  }
  uint64_t hash() const { return hash_; }

 private:
  void Add(uint64_t word) {
    uint64_t z = (hash_ ^ word) + 0x9E3779B97F4A7C15ull;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
    hash_ = z ^ (z >> 31);
  }

  uint64_t hash_ = 0;
};

}  // namespace

uint64_t HashInput(const MapperInput& input) {
  HashSink sink;
  WriteTo(&sink, input.scene);
  WriteTo(&sink, input.view_graph);
  WriteTo(&sink, input.position_priors);
  WriteTo(&sink, input.gravity_priors);
  WriteTo(&sink, input.existing_model);
  WriteTo(&sink, input.expects_rigs);
  return sink.hash();
}

uint64_t HashText(const std::string& text) {
  HashSink sink;
  WriteTo(&sink, text);
  return sink.hash();
}

}  // namespace mgsfm
