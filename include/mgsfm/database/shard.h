// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>

namespace mgsfm {

// A shard is a database with a share of the work of one run, written by its own
// process: the features of some images, or the matches of some pairs. Merged
// shards equal the database of a single process, row by row.

// Share `number` of `count`, 1 <= number <= count.
struct Share {
  int number = 1;
  int count = 1;

  // The items of this share among `size` in a fixed order. Shares are disjoint,
  // contiguous, complete, and differ in size by at most one item.
  size_t Begin(size_t size) const { return Bound(size, number - 1); }
  size_t End(size_t size) const { return Bound(size, number); }
  std::string ToString() const;  // "3/8"

  friend bool operator==(const Share& a, const Share& b) {
    return a.number == b.number && a.count == b.count;
  }

 private:
  size_t Bound(size_t size, int shares) const {
    const auto n = static_cast<size_t>(count), i = static_cast<size_t>(shares);
    return size / n * i + size % n * i / n;
  }
};

// Parses "3/8". Throws Error for anything else.
[[nodiscard]] Share ParseShare(const std::string& text);

enum class ShardKind { kFeatures, kMatches };

// A shard describes itself in the table `mgsfm_shard`, which other programs
// ignore.
struct ShardManifest {
  ShardKind kind = ShardKind::kFeatures;
  Share share;
  // A hash of inputs and options, equal for all shards of one run. The
  // fingerprint of match shards begins with that of the feature database.
  std::string fingerprint;
  bool is_complete = false;
};

}  // namespace mgsfm
