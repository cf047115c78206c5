# mgsfm_codecs.so: the parts of modules that need OpenCV's image codecs, FFmpeg
# and HDF5. The program loads it when it needs it (codec_loading.cc); without the
# libraries that it does not need at once, it starts in a fifth of the time.
if(BUILD_SHARED_LIBS)
  return()  # the modules are shared libraries, and link theirs
endif()
set(src ${PROJECT_SOURCE_DIR}/src)
set(codec_sources ${src}/io/files/image_codecs.cc
  # For messages of errors.
  ${src}/base/error.cc ${src}/base/text.cc)
set(codec_libraries opencv_core opencv_imgcodecs)
if(TARGET mgsfm_av)
  list(APPEND codec_sources ${src}/video/video_decoder.cc)
  list(APPEND codec_libraries mgsfm_av)
else()
  list(APPEND codec_sources ${src}/video/video_decoder_missing.cc)
endif()
if(TARGET mgsfm_hdf5)
  list(APPEND codec_sources ${src}/io/hloc/hdf5_file.cc)
  list(APPEND codec_libraries mgsfm_hdf5)
else()
  list(APPEND codec_sources ${src}/io/hloc/hdf5_missing.cc)
endif()

add_library(mgsfm_codecs MODULE ${codec_sources})
set_target_properties(mgsfm_codecs PROPERTIES PREFIX "" SUFFIX .so
  POSITION_INDEPENDENT_CODE ON
  LIBRARY_OUTPUT_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR})
target_include_directories(mgsfm_codecs PRIVATE ${src}
  ${PROJECT_SOURCE_DIR}/include ${MGSFM_hdf5_INCLUDE_DIR})
target_link_libraries(mgsfm_codecs PRIVATE ${codec_libraries} Eigen3::Eigen
  mgsfm_warnings)
install(TARGETS mgsfm_codecs
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/mgsfm)

target_sources(mgsfm_app PRIVATE codec_loading.cc)
target_include_directories(mgsfm_app PRIVATE ${src})
target_link_libraries(mgsfm_app PRIVATE opencv_core Eigen3::Eigen
  ${CMAKE_DL_LIBS})
# Libraries of replaced functions are not needed.
target_link_options(mgsfm_app PRIVATE LINKER:--as-needed)
set_target_properties(mgsfm_app PROPERTIES BUILD_WITH_INSTALL_RPATH ON
  INSTALL_RPATH "$ORIGIN;$ORIGIN/../${CMAKE_INSTALL_LIBDIR}/mgsfm")
add_dependencies(mgsfm_app mgsfm_codecs)
