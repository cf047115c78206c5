# find_package(mgsfm) defines mgsfm::NAME for each module and mgsfm::mgsfm for
# all of them.
include(CMakePackageConfigHelpers)

get_property(modules GLOBAL PROPERTY MGSFM_MODULES)
add_library(mgsfm_all INTERFACE)
add_library(mgsfm::mgsfm ALIAS mgsfm_all)
set_target_properties(mgsfm_all PROPERTIES EXPORT_NAME mgsfm)
target_link_libraries(mgsfm_all INTERFACE ${modules})

set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/mgsfm)
install(TARGETS mgsfm_all ${modules} EXPORT mgsfmTargets
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT dev
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT dev)
install(EXPORT mgsfmTargets NAMESPACE mgsfm:: DESTINATION ${package_dir}
  COMPONENT dev)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/
  DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT dev
  FILES_MATCHING PATTERN "*.h")

set(packages_file ${PROJECT_BINARY_DIR}/mgsfmPackages.cmake)
set(packages_text "set(mgsfm_MODULES ${MGSFM_MODULE_NAMES})\n")
foreach(module IN LISTS MGSFM_MODULE_NAMES)
  get_property(packages GLOBAL PROPERTY MGSFM_PACKAGES_OF_${module})
  string(APPEND packages_text
    "set(mgsfm_PACKAGES_OF_${module} ${packages})\n")
endforeach()
file(WRITE ${packages_file} "${packages_text}")

configure_package_config_file(
  ${PROJECT_SOURCE_DIR}/cmake/mgsfmConfig.cmake.in
  ${PROJECT_BINARY_DIR}/mgsfmConfig.cmake
  INSTALL_DESTINATION ${package_dir})
write_basic_package_version_file(
  ${PROJECT_BINARY_DIR}/mgsfmConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES
  ${PROJECT_SOURCE_DIR}/cmake/MgsfmSystemLibraries.cmake
  ${packages_file}
  ${PROJECT_BINARY_DIR}/mgsfmConfig.cmake
  ${PROJECT_BINARY_DIR}/mgsfmConfigVersion.cmake
  DESTINATION ${package_dir} COMPONENT dev)
