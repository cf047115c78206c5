// SPDX-License-Identifier: BSD-3-Clause
// Replaces hdf5_file.cc in builds without HDF5.
#include "hloc/hdf5_file.h"
#include "mgsfm/base/error.h"

namespace mgsfm {

std::unique_ptr<Hdf5File> OpenHdf5(const std::string& path) {
  throw Error("this build of mgsfm cannot read '" + path +
              "'; install libhdf5-dev and build it again");
}

}  // namespace mgsfm
