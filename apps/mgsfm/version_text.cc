// SPDX-License-Identifier: BSD-3-Clause
#include "version_text.h"

#include <ceres/version.h>
#include <cholmod.h>
#include <flann/config.h>
#include <sqlite3.h>

#include <Eigen/Core>
#include <exiv2/version.hpp>
#include <nlohmann/json.hpp>
#include <opencv2/core/version.hpp>

#include "mgsfm/base/version.h"

namespace mgsfm {
namespace {

#ifdef __clang__
constexpr char kCompiler[] = __VERSION__;
#else
constexpr char kCompiler[] = "GCC " __VERSION__;
#endif

std::string Join(int major, int minor, int patch) {
  return std::to_string(major) + "." + std::to_string(minor) + "." +
         std::to_string(patch);
}

}  // namespace

std::string VersionText(const std::string& commit) {
  return std::string("mgsfm ") + Version() + ", commit " + commit +
         "\ncompiler:  " + kCompiler + "\nEigen:     " +
         Join(EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION) +
         "\nCeres:     " CERES_VERSION_STRING + "\nCHOLMOD:   " +
         Join(CHOLMOD_MAIN_VERSION, CHOLMOD_SUB_VERSION,
              CHOLMOD_SUBSUB_VERSION) +
         "\nOpenCV:    " CV_VERSION "\nExiv2:     " + Exiv2::versionString() +
         "\nFLANN:     " FLANN_VERSION_ "\nSQLite:    " + sqlite3_libversion() +
         "\nJSON:      " +
         Join(NLOHMANN_JSON_VERSION_MAJOR, NLOHMANN_JSON_VERSION_MINOR,
              NLOHMANN_JSON_VERSION_PATCH) +
         "\n";
}

}  // namespace mgsfm
