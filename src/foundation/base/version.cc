// SPDX-License-Identifier: BSD-3-Clause
#include "mgsfm/base/version.h"

#include <array>
#include <utility>

#include "base/text_streams.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

using MajorMinorPatch = std::array<int, 3>;

MajorMinorPatch ParseVersion(const std::string& text) {
  MajorMinorPatch version{};
  TextInput stream(text);
  char dots[2] = {};
  stream >> version[0] >> dots[0] >> version[1] >> dots[1] >> version[2];
  if (!stream || !stream.eof() || dots[0] != '.' || dots[1] != '.') {
    throw Error("'" + text + "' is not a version number like " + Version());
  }
  return version;
}

}  // namespace

const char* Version() { return MGSFM_VERSION; }

bool IsNewerVersion(const std::string& version) {
  const MajorMinorPatch other = ParseVersion(version);
  const MajorMinorPatch own = ParseVersion(Version());
  return std::pair(other[0], other[1]) > std::pair(own[0], own[1]);
}

}  // namespace mgsfm
