# Libraries whose Debian packages bring no CMake configuration. Also read by
# users of an installed mgsfm, as its static libraries must link them.

# mgsfm_find_library(TARGET LIBRARY HEADER SUFFIX)
# TARGET for a library and the folder of its header, maybe below SUFFIX.
function(mgsfm_find_library target library header suffix)
  if(TARGET ${target})
    return()
  endif()
  find_library(MGSFM_${library}_LIBRARY ${library} REQUIRED)
  find_path(MGSFM_${library}_INCLUDE_DIR ${header} PATH_SUFFIXES ${suffix}
    REQUIRED)
  mark_as_advanced(MGSFM_${library}_LIBRARY MGSFM_${library}_INCLUDE_DIR)
  add_library(${target} INTERFACE IMPORTED)
  target_include_directories(${target} SYSTEM INTERFACE
    ${MGSFM_${library}_INCLUDE_DIR})
  target_link_libraries(${target} INTERFACE ${MGSFM_${library}_LIBRARY})
endfunction()

mgsfm_find_library(mgsfm_cholmod cholmod cholmod.h suitesparse)
# CHOLMOD runs on OpenMP, which src/math/sparse_solver.cc holds back.
target_link_libraries(mgsfm_cholmod INTERFACE gomp)
# Debian's Ceres names the libraries of ATLAS beside the system's BLAS; where
# that is a faster one, ATLAS would be taken in its place.
get_target_property(mgsfm_ceres_libraries Ceres::ceres INTERFACE_LINK_LIBRARIES)
list(FILTER mgsfm_ceres_libraries EXCLUDE REGEX "/lib(f77blas|atlas)\\.")
set_target_properties(Ceres::ceres PROPERTIES
  INTERFACE_LINK_LIBRARIES "${mgsfm_ceres_libraries}")
unset(mgsfm_ceres_libraries)
# Under the names that OpenCV's own configuration, in the large package
# libopencv-dev, gives them.
mgsfm_find_library(opencv_core opencv_core opencv2/core.hpp opencv4)
mgsfm_find_library(opencv_imgcodecs opencv_imgcodecs opencv2/imgcodecs.hpp
  opencv4)
mgsfm_find_library(opencv_imgproc opencv_imgproc opencv2/imgproc.hpp opencv4)
mgsfm_find_library(mgsfm_exiv2 exiv2 exiv2/exiv2.hpp "")
# FLANN is used as templates; their serialisation refers to LZ4.
mgsfm_find_library(mgsfm_flann lz4 flann/flann.hpp "")
