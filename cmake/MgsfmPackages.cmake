# Debian packages by CPack: mgsfm (the program), libmgsfm-dev (headers and static
# libraries) and python3-mgsfm. scripts/packages.sh builds and tests them.
set(package_of_program mgsfm)
set(package_of_dev libmgsfm-dev)
set(package_of_python python3-mgsfm)
set(components program dev)
if(MGSFM_BUILD_PYTHON)
  list(APPEND components python)
endif()

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME mgsfm)
set(CPACK_PACKAGE_VENDOR "the mgsfm authors")
set(CPACK_PACKAGE_CONTACT "the mgsfm authors <mgsfm@localhost>" CACHE STRING
  "Maintainer of packages: name <address>")
set(CPACK_PACKAGE_DIRECTORY ${PROJECT_BINARY_DIR}/packages)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL ${components})
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME ${package_of_program})
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION science)
set(CPACK_COMPONENT_PROGRAM_DESCRIPTION
"The program estimates the trajectory of a camera rig, the pose of each camera
in the rig, and a sparse point cloud from images. It reads COLMAP databases and
writes COLMAP models.")

set(CPACK_DEBIAN_DEV_PACKAGE_NAME ${package_of_dev})
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_COMPONENT_DEV_DESCRIPTION
"Headers, static libraries and the CMake package mgsfm.")
# What mgsfmConfig.cmake looks for.
string(JOIN ", " CPACK_DEBIAN_DEV_PACKAGE_DEPENDS
  libeigen3-dev libceres-dev libsuitesparse-dev libsqlite3-dev
  nlohmann-json3-dev libopencv-core-dev libopencv-imgcodecs-dev
  libopencv-imgproc-dev libbz2-dev libexiv2-dev libflann-dev liblz4-dev
  libre2-dev libyaml-cpp-dev libzstd-dev)
if(TARGET mgsfm_hdf5)
  string(APPEND CPACK_DEBIAN_DEV_PACKAGE_DEPENDS ", libhdf5-dev")
endif()
if(TARGET mgsfm_av)
  string(APPEND CPACK_DEBIAN_DEV_PACKAGE_DEPENDS
    ", libavformat-dev, libavcodec-dev, libswscale-dev, libavutil-dev")
endif()

set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME ${package_of_python})
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(CPACK_COMPONENT_PYTHON_DESCRIPTION
"The commands of mgsfm as functions, models in memory, and averaging of relative
poses.")
if(MGSFM_BUILD_PYTHON)
  # The module works with one minor version.
  math(EXPR next_minor "${MGSFM_PYTHON_MINOR} + 1")
  string(JOIN ", " CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS
    "python3 (>= 3.${MGSFM_PYTHON_MINOR})" "python3 (<< 3.${next_minor})"
    "python3-numpy")
  set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_EXTRA
    ${PROJECT_SOURCE_DIR}/packaging/debian/postinst
    ${PROJECT_SOURCE_DIR}/packaging/debian/prerm)
endif()

# What Debian's policy asks for and an installation by hand does not need.
set(CPACK_PRE_BUILD_SCRIPTS
  ${PROJECT_SOURCE_DIR}/packaging/debian/documents.cmake)
set(CPACK_MGSFM_SOURCE_DIR ${PROJECT_SOURCE_DIR})
include(CPack)
