// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/decompression.h"

#include <bzlib.h>
#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <memory>
#include <new>

#include "base/text.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

enum class StreamState { kMore, kEnd, kBroken };

// What one call of a codec did.
struct StreamStep {
  StreamState state = StreamState::kMore;
  size_t num_consumed = 0;
  size_t num_produced = 0;
};

// Calls step(input, output, room) until the end of the stream.
template <class Step>
DecompressedBytes RunCodec(std::string_view data, uint64_t max_size,
                           const Step& step) {
  // It doubles while the output does not fit; the result does not depend on it.
  constexpr size_t kFirstRoom = size_t{1} << 16;
  DecompressedBytes result;
  size_t size = 0;
  StreamStep done;
  while (done.state == StreamState::kMore) {
    if (size == result.bytes.size()) {
      // One more byte than permitted shows that there are too many.
      result.bytes.resize(std::min<uint64_t>(
          max_size + 1, std::max(kFirstRoom, 2 * result.bytes.size())));
    }
    done = step(data, &result.bytes[size], result.bytes.size() - size);
    size += done.num_produced;
    data.remove_prefix(done.num_consumed);
    const bool is_stuck = done.num_consumed == 0 && done.num_produced == 0;
    if (size > max_size || (is_stuck && done.state == StreamState::kMore)) {
      done.state = StreamState::kBroken;
    }
  }
  result.bytes.resize(std::min<uint64_t>(size, max_size));
  result.is_complete = done.state == StreamState::kEnd;
  return result;
}

DecompressedBytes DecompressBz2(std::string_view data, uint64_t max_size) {
  bz_stream stream = {};
  if (BZ2_bzDecompressInit(&stream, 0, 0) != BZ_OK) throw std::bad_alloc();
  const std::unique_ptr<bz_stream, int (*)(bz_stream*)> owner(
      &stream, BZ2_bzDecompressEnd);
  return RunCodec(data, max_size,
                  [&](std::string_view input, char* output, size_t room) {
                    stream.next_in = const_cast<char*>(input.data());
                    stream.avail_in = static_cast<unsigned>(input.size());
                    stream.next_out = output;
                    stream.avail_out = static_cast<unsigned>(room);
                    const int code = BZ2_bzDecompress(&stream);
                    if (code == BZ_MEM_ERROR) throw std::bad_alloc();
                    return StreamStep{code == BZ_STREAM_END ? StreamState::kEnd
                                      : code == BZ_OK       ? StreamState::kMore
                                                      : StreamState::kBroken,
                                      input.size() - stream.avail_in,
                                      room - stream.avail_out};
                  });
}

DecompressedBytes DecompressLz4(std::string_view data, uint64_t max_size) {
  LZ4F_dctx* context = nullptr;
  if (LZ4F_isError(LZ4F_createDecompressionContext(&context, LZ4F_VERSION)) !=
      0) {
    throw std::bad_alloc();
  }
  const std::unique_ptr<LZ4F_dctx, LZ4F_errorCode_t (*)(LZ4F_dctx*)> owner(
      context, LZ4F_freeDecompressionContext);
  return RunCodec(
      data, max_size, [&](std::string_view input, char* output, size_t room) {
        size_t consumed = input.size(), produced = room;
        const size_t hint = LZ4F_decompress(context, output, &produced,
                                            input.data(), &consumed, nullptr);
        if (LZ4F_isError(hint) != 0) {
          return StreamStep{StreamState::kBroken, 0, 0};
        }
        return StreamStep{hint == 0 ? StreamState::kEnd : StreamState::kMore,
                          consumed, produced};
      });
}

DecompressedBytes DecompressZstd(std::string_view data, uint64_t max_size) {
  const std::unique_ptr<ZSTD_DStream, size_t (*)(ZSTD_DStream*)> stream(
      ZSTD_createDStream(), ZSTD_freeDStream);
  if (!stream) throw std::bad_alloc();
  return RunCodec(
      data, max_size, [&](std::string_view input, char* output, size_t room) {
        ZSTD_inBuffer from = {input.data(), input.size(), 0};
        ZSTD_outBuffer to = {output, room, 0};
        const size_t hint = ZSTD_decompressStream(stream.get(), &to, &from);
        const bool is_end = hint == 0 && from.pos == input.size();
        return StreamStep{ZSTD_isError(hint) != 0 ? StreamState::kBroken
                          : is_end                ? StreamState::kEnd
                                                  : StreamState::kMore,
                          from.pos, to.pos};
      });
}

}  // namespace

void CheckCompression(std::string_view compression, const std::string& source) {
  for (const char* known : {"", "none", "bz2", "lz4", "zstd"}) {
    if (compression == known) return;
  }
  throw Error(source + " has the compression '" + Printable(compression) +
              "'; convert it to one with none, bz2, lz4 or zstd");
}

DecompressedBytes Decompress(std::string_view compression,
                             std::string_view data, uint64_t max_size) {
  max_size = std::min(max_size, kMaxChunkBytes);
  if (compression.empty() || compression == "none") {
    return {std::string(data.substr(0, max_size)), data.size() <= max_size};
  }
  // Codecs count input in 32 bits.
  if (data.size() > kMaxChunkBytes) return {};
  if (compression == "bz2") return DecompressBz2(data, max_size);
  if (compression == "lz4") return DecompressLz4(data, max_size);
  MGSFM_CHECK(compression == "zstd");
  return DecompressZstd(data, max_size);
}

bool HasZstdHeader(std::string_view data) {
  return data.substr(0, 4) == "\x28\xb5\x2f\xfd";
}

uint32_t Crc32(std::string_view bytes) {
  static const std::array<uint32_t, 256> kTable = [] {
    std::array<uint32_t, 256> table{};
    for (uint32_t i = 0; i < table.size(); ++i) {
      uint32_t value = i;
      for (int bit = 0; bit < 8; ++bit) {
        value = (value >> 1) ^ ((value & 1) != 0 ? 0xedb88320u : 0u);
      }
      table[i] = value;
    }
    return table;
  }();
  uint32_t crc = 0xffffffffu;
  for (const char c : bytes) {
    crc = (crc >> 8) ^ kTable[(crc ^ static_cast<unsigned char>(c)) & 0xff];
  }
  return ~crc;
}

}  // namespace mgsfm
