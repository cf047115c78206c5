// SPDX-License-Identifier: BSD-3-Clause
// Replaces hdf5_file.cc in builds without HDF5.
#include "io/hloc/hdf5_file.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

class Hdf5File::Impl {};

Hdf5File::Hdf5File(const std::string& path) {
  throw Error("this build of mgsfm cannot read '" + path +
              "'; install libhdf5-dev and build it again");
}
Hdf5File::~Hdf5File() = default;

const std::string& Hdf5File::path() const {
  throw ContractError("no file is open");
}
std::vector<std::string> Hdf5File::GroupsWith(const std::string&) const {
  return {};
}
bool Hdf5File::Has(const std::string&) const { return false; }
Hdf5Matrix<float> Hdf5File::ReadFloats(const std::string&) const { return {}; }
Hdf5Matrix<int32_t> Hdf5File::ReadInts(const std::string&) const { return {}; }

}  // namespace mgsfm
