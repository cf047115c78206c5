# Headers of Eigen, GoogleTest and the standard library that most files include
# take longer to read than the files themselves; they are compiled once for all
# targets. The preset tidy reads each file as it is written, so that a missing
# include is still found.

# mgsfm_add_precompiled_headers(TARGET LINK packages... HEADERS ...)
function(mgsfm_add_precompiled_headers target)
  cmake_parse_arguments(arg "" "" "LINK;HEADERS" ${ARGN})
  set(source ${PROJECT_BINARY_DIR}/${target}.cc)
  file(CONFIGURE OUTPUT ${source} CONTENT "")
  add_library(${target} OBJECT ${source})
  target_link_libraries(${target} PRIVATE ${arg_LINK} mgsfm_warnings)
  target_precompile_headers(${target} PRIVATE ${arg_HEADERS})
  mgsfm_allow_caching(${target})
endfunction()

# Makes TARGET begin each of its files with the headers of FROM, whose flags
# must be the same.
function(mgsfm_reuse_precompiled_headers target from)
  if(MGSFM_PRECOMPILED_HEADERS)
    target_precompile_headers(${target} REUSE_FROM ${from})
    mgsfm_allow_caching(${target})
  endif()
endfunction()

# What ccache's manual asks for.
function(mgsfm_allow_caching target)
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    target_compile_options(${target} PRIVATE -fpch-preprocess)
  endif()
endfunction()

if(MGSFM_PRECOMPILED_HEADERS)
  set(common_headers <Eigen/Dense> <algorithm> <array> <cmath> <cstdint>
    <filesystem> <fstream> <functional> <limits> <map> <memory> <numeric>
    <optional> <set> <sstream> <string> <utility> <vector>)
  mgsfm_add_precompiled_headers(mgsfm_common_headers
    LINK Eigen3::Eigen HEADERS ${common_headers})
  if(MGSFM_BUILD_TESTS)
    mgsfm_add_precompiled_headers(mgsfm_test_headers
      LINK Eigen3::Eigen GTest::gmock GTest::gtest mgsfm_test_flags
      HEADERS ${common_headers} <gmock/gmock.h> <gtest/gtest.h>)
  endif()
endif()
