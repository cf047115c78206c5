// SPDX-License-Identifier: BSD-3-Clause
// Replaces hdf5_file.cc in builds without HDF5.
#include "io/hloc/hdf5_file.h"
#include "mgsfm/base/error.h"

namespace mgsfm {
namespace {

std::unique_ptr<Hdf5File> OpenFile(const std::string& path) {
  throw Error("this build of mgsfm cannot read '" + path +
              "'; install libhdf5-dev and build it again");
}

}  // namespace

extern "C" const Hdf5Library* MgsfmHdf5Library() {
  static constexpr Hdf5Library kLibrary = {OpenFile};
  return &kLibrary;
}

}  // namespace mgsfm
