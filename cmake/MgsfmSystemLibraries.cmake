# Libraries whose Debian packages contain no CMake configuration. Users of an
# installed mgsfm include this file, too, because static libraries link them.

# mgsfm_find_library(TARGET LIBRARY HEADER SUFFIX [NAMES...])
# Defines TARGET for a library whose HEADER may be in the subfolder SUFFIX, and
# which is called LIBRARY or one of NAMES.
function(mgsfm_find_library target library header suffix)
  if(TARGET ${target})
    return()
  endif()
  find_library(MGSFM_${library}_LIBRARY NAMES ${library} ${ARGN} REQUIRED)
  # By target: mgsfm_flann and mgsfm_lz4 link one library, with other headers.
  find_path(${target}_INCLUDE_DIR ${header} PATH_SUFFIXES ${suffix} REQUIRED)
  mark_as_advanced(MGSFM_${library}_LIBRARY ${target}_INCLUDE_DIR)
  add_library(${target} INTERFACE IMPORTED)
  target_include_directories(${target} SYSTEM INTERFACE
    ${${target}_INCLUDE_DIR})
  target_link_libraries(${target} INTERFACE ${MGSFM_${library}_LIBRARY})
endfunction()

# Defines mgsfm_hdf5, the serial library, if it is installed. Files that use it
# include MGSFM_hdf5_INCLUDE_DIR.
function(mgsfm_find_optional_hdf5)
  if(TARGET mgsfm_hdf5)
    return()
  endif()
  # The second name is that outside Debian.
  find_library(MGSFM_hdf5_LIBRARY NAMES hdf5_serial hdf5)
  find_path(MGSFM_hdf5_INCLUDE_DIR hdf5.h PATH_SUFFIXES hdf5/serial)
  mark_as_advanced(MGSFM_hdf5_LIBRARY MGSFM_hdf5_INCLUDE_DIR)
  if(MGSFM_hdf5_LIBRARY AND MGSFM_hdf5_INCLUDE_DIR)
    add_library(mgsfm_hdf5 INTERFACE IMPORTED)
    target_link_libraries(mgsfm_hdf5 INTERFACE ${MGSFM_hdf5_LIBRARY})
  else()
    message(STATUS "no HDF5 (libhdf5-dev): feature_importer is an error")
  endif()
endfunction()

# Defines mgsfm_av, the libraries of FFmpeg that decode videos, if they are
# installed.
function(mgsfm_find_optional_av)
  if(TARGET mgsfm_av)
    return()
  endif()
  set(libraries)
  foreach(part avformat avcodec swscale avutil)
    find_library(MGSFM_${part}_LIBRARY ${part})
    find_path(MGSFM_${part}_INCLUDE_DIR lib${part}/version.h)
    mark_as_advanced(MGSFM_${part}_LIBRARY MGSFM_${part}_INCLUDE_DIR)
    if(NOT MGSFM_${part}_LIBRARY OR NOT MGSFM_${part}_INCLUDE_DIR)
      message(STATUS "no FFmpeg (lib${part}-dev): videos cannot be read")
      return()
    endif()
    list(APPEND libraries ${MGSFM_${part}_LIBRARY})
  endforeach()
  add_library(mgsfm_av INTERFACE IMPORTED)
  target_include_directories(mgsfm_av SYSTEM INTERFACE
    ${MGSFM_avformat_INCLUDE_DIR})
  target_link_libraries(mgsfm_av INTERFACE ${libraries})
endfunction()

# mgsfm_find_system_libraries(TARGETS...)
# Defines those of TARGETS that are named below.
function(mgsfm_find_system_libraries)
  if("mgsfm_cholmod" IN_LIST ARGN)
    mgsfm_find_library(mgsfm_cholmod cholmod cholmod.h suitesparse)
    # CHOLMOD is parallelised with OpenMP; src/foundation/math/sparse_solver.cc limits it
    # to one thread.
    if(CMAKE_SYSTEM_NAME STREQUAL "Linux")
      target_link_libraries(mgsfm_cholmod INTERFACE gomp)
    endif()
  endif()
  if("Ceres::ceres" IN_LIST ARGN)
    # Debian's Ceres names the libraries of ATLAS next to the system's BLAS;
    # linking them would replace a faster BLAS.
    get_target_property(libraries Ceres::ceres INTERFACE_LINK_LIBRARIES)
    list(FILTER libraries EXCLUDE REGEX "/lib(f77blas|atlas)\\.")
    set_target_properties(Ceres::ceres PROPERTIES
      INTERFACE_LINK_LIBRARIES "${libraries}")
  endif()
  # The names that OpenCV's own configuration, which only the large package
  # libopencv-dev contains, gives to these libraries. Files of vcpkg end with 4.
  foreach(part core imgcodecs imgproc)
    if("opencv_${part}" IN_LIST ARGN)
      mgsfm_find_library(opencv_${part} opencv_${part} opencv2/${part}.hpp
        opencv4 opencv_${part}4)
    endif()
  endforeach()
  if("mgsfm_exiv2" IN_LIST ARGN)
    mgsfm_find_library(mgsfm_exiv2 exiv2 exiv2/exiv2.hpp "")
  endif()
  if("mgsfm_re2" IN_LIST ARGN)
    mgsfm_find_library(mgsfm_re2 re2 re2/re2.h "")
  endif()
  if("mgsfm_yaml" IN_LIST ARGN)
    mgsfm_find_library(mgsfm_yaml yaml-cpp yaml-cpp/yaml.h "")
  endif()
  if("mgsfm_hdf5" IN_LIST ARGN)
    mgsfm_find_optional_hdf5()
  endif()
  if("mgsfm_av" IN_LIST ARGN)
    mgsfm_find_optional_av()
  endif()
  if("mgsfm_bz2" IN_LIST ARGN)
    mgsfm_find_library(mgsfm_bz2 bz2 bzlib.h "")
  endif()
  if("mgsfm_zstd" IN_LIST ARGN)
    mgsfm_find_library(mgsfm_zstd zstd zstd.h "")
  endif()
  if("mgsfm_lz4" IN_LIST ARGN)
    mgsfm_find_library(mgsfm_lz4 lz4 lz4frame.h "")
  endif()
  if("mgsfm_flann" IN_LIST ARGN)
    # FLANN consists of templates, whose serialization refers to LZ4.
    mgsfm_find_library(mgsfm_flann lz4 flann/flann.hpp "")
  endif()
endfunction()
