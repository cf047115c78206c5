// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace mgsfm {

// Larger chunks are damaged: recorders write chunks of 1 to 4 MiB by default,
// and a chunk exceeds its limit by one message at most.
constexpr uint64_t kMaxChunkBytes = uint64_t{1} << 30;

struct DecompressedBytes {
  std::string bytes;
  // Whether the data are intact. Otherwise, the bytes are those before the
  // damage.
  bool is_complete = false;
};

// Throws Error, naming `source`, unless the name is one of ROS 1 bags or MCAP:
// "" or "none", "bz2", "lz4" (frames) or "zstd".
void CheckCompression(std::string_view compression, const std::string& source);

// Decompresses a chunk or message. Data with more than `max_size` bytes are
// damaged. Memory grows with the bytes that are found, not with those that are
// claimed.
DecompressedBytes Decompress(std::string_view compression,
                             std::string_view data, uint64_t max_size);

// Whether bytes begin like a frame of zstd.
bool HasZstdHeader(std::string_view data);

// The checksum CRC-32 of zlib and PNG.
uint32_t Crc32(std::string_view bytes);

}  // namespace mgsfm
