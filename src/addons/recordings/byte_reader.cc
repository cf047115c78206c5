// SPDX-License-Identifier: BSD-3-Clause
#include "recordings/byte_reader.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

#include "mgsfm/base/error.h"

namespace mgsfm {

std::string_view ByteReader::TakeBytes(uint64_t size) {
  if (size > NumLeft()) throw BytesError("ends within a value");
  const std::string_view taken = bytes_.substr(position_, size);
  position_ += size;
  return taken;
}

namespace {

[[noreturn]] void ThrowReadError(const std::filesystem::path& path) {
  throw Error("recording '" + path.string() +
              "' cannot be read: " + std::strerror(errno));
}

}  // namespace

RandomAccessFile::RandomAccessFile(const std::filesystem::path& path)
    : path_(path), descriptor_(open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
  if (descriptor_ < 0) ThrowReadError(path_);
  struct stat status = {};
  if (fstat(descriptor_, &status) != 0) {
    close(descriptor_);
    ThrowReadError(path_);
  }
  size_ = static_cast<uint64_t>(status.st_size);
}

RandomAccessFile::~RandomAccessFile() { close(descriptor_); }

std::string RandomAccessFile::Read(uint64_t offset, uint64_t size) const {
  if (offset > size_ || size > size_ - offset) throw BytesError("is cut short");
  std::string bytes(size, '\0');
  size_t num_read = 0;
  while (num_read < size) {
    const ssize_t count =
        pread(descriptor_, bytes.data() + num_read, size - num_read,
              static_cast<off_t>(offset + num_read));
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) ThrowReadError(path_);
    if (count == 0) throw BytesError("is cut short");
    num_read += static_cast<size_t>(count);
  }
  return bytes;
}

}  // namespace mgsfm
