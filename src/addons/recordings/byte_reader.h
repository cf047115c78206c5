// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>

namespace mgsfm {

// Bytes that are not what their format says. The message continues the name of
// what is read: "ends within a value". Who knows this name catches it.
class BytesError : public std::runtime_error {
 public:
  explicit BytesError(const std::string& message)
      : std::runtime_error(message) {}
};

// Takes little-endian values from the front of bytes. Throws BytesError beyond
// their end.
class ByteReader {
 public:
  explicit ByteReader(std::string_view bytes) : bytes_(bytes) {}

  bool IsEmpty() const { return position_ == bytes_.size(); }
  size_t position() const { return position_; }
  size_t NumLeft() const { return bytes_.size() - position_; }

  template <class T>
  T Take() {
    static_assert(std::is_arithmetic_v<T>);
    T value;
    std::memcpy(&value, TakeBytes(sizeof(T)).data(), sizeof(T));
    return value;
  }
  std::string_view TakeBytes(uint64_t size);
  // Bytes after their number.
  template <class Size = uint32_t>
  std::string_view TakeSized() {
    return TakeBytes(Take<Size>());
  }
  // The same as text.
  std::string TakeText() { return std::string(TakeSized()); }

 private:
  std::string_view bytes_;
  size_t position_ = 0;
};

// A file that is read at any place. Its size is that at the beginning.
class RandomAccessFile {
 public:
  // Throws Error, naming the file and the reason, if it cannot be opened.
  explicit RandomAccessFile(const std::filesystem::path& path);
  ~RandomAccessFile();
  RandomAccessFile(const RandomAccessFile&) = delete;
  RandomAccessFile& operator=(const RandomAccessFile&) = delete;

  // Throws Error, naming the file, if it cannot be read, and BytesError if it
  // has fewer bytes.
  std::string Read(uint64_t offset, uint64_t size) const;
  uint64_t size() const { return size_; }
  const std::filesystem::path& path() const { return path_; }

 private:
  const std::filesystem::path path_;
  int descriptor_ = -1;
  uint64_t size_ = 0;
};

}  // namespace mgsfm
