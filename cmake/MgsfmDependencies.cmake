# All packages are those of Debian 12 or Ubuntu 22.04; nothing is downloaded. mgsfmConfig.cmake.in must
# find what the modules link, too.
find_package(Threads REQUIRED)
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
# The BLAS that the system has chosen, where Ceres would look for ATLAS.
if(NOT DEFINED BLA_VENDOR)
  set(BLA_VENDOR Generic)
endif()
find_package(Ceres 2.0 REQUIRED)
find_package(SQLite3 REQUIRED)
find_package(nlohmann_json 3.10 REQUIRED)
include(MgsfmSystemLibraries)
mgsfm_find_system_libraries(mgsfm_bz2 mgsfm_cholmod Ceres::ceres opencv_core
  opencv_imgcodecs opencv_imgproc mgsfm_exiv2 mgsfm_flann mgsfm_lz4 mgsfm_re2
  mgsfm_yaml mgsfm_zstd)
mgsfm_find_optional_hdf5()
mgsfm_find_optional_av()
# Only the program uses it, for --live_port.
find_library(MGSFM_microhttpd_LIBRARY microhttpd)
find_path(MGSFM_microhttpd_INCLUDE_DIR microhttpd.h)
mark_as_advanced(MGSFM_microhttpd_LIBRARY MGSFM_microhttpd_INCLUDE_DIR)
if(MGSFM_microhttpd_LIBRARY AND MGSFM_microhttpd_INCLUDE_DIR)
  add_library(mgsfm_microhttpd INTERFACE IMPORTED)
  target_include_directories(mgsfm_microhttpd SYSTEM INTERFACE
    ${MGSFM_microhttpd_INCLUDE_DIR})
  target_link_libraries(mgsfm_microhttpd INTERFACE
    ${MGSFM_microhttpd_LIBRARY})
else()
  message(STATUS "no libmicrohttpd (libmicrohttpd-dev): --live_port is an error")
endif()

if(MGSFM_BUILD_TESTS)
  find_package(GTest 1.11 REQUIRED)
  enable_testing()
endif()
if(MGSFM_BUILD_BENCHMARKS)
  find_package(benchmark 1.6 REQUIRED)
endif()
