# find_package(mgsfm) defines mgsfm::GROUP for each group of modules, mgsfm::core
# for the mapper and all below it, and mgsfm::mgsfm for everything.
include(CMakePackageConfigHelpers)

get_property(groups GLOBAL PROPERTY MGSFM_GROUPS)
list(TRANSFORM groups PREPEND mgsfm_ OUTPUT_VARIABLE targets)
set(components ${groups})
set(packages_text)
# mgsfm_add_component(NAME groups...): an interface of these.
macro(mgsfm_add_component name)
  add_library(mgsfm_component_${name} INTERFACE)
  add_library(mgsfm::${name} ALIAS mgsfm_component_${name})
  set_target_properties(mgsfm_component_${name} PROPERTIES EXPORT_NAME ${name})
  set(packages)
  foreach(group ${ARGN})
    target_link_libraries(mgsfm_component_${name} INTERFACE mgsfm_${group})
    get_property(inherited GLOBAL PROPERTY MGSFM_PACKAGES_OF_${group})
    list(APPEND packages ${inherited})
  endforeach()
  list(REMOVE_DUPLICATES packages)
  set_property(GLOBAL PROPERTY MGSFM_PACKAGES_OF_${name} ${packages})
  list(APPEND targets mgsfm_component_${name})
  list(APPEND components ${name})
endmacro()
mgsfm_add_component(core mapper)
mgsfm_add_component(mgsfm ${groups})

set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/mgsfm)
install(TARGETS ${targets} EXPORT mgsfmTargets
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT dev
  LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT dev)
install(EXPORT mgsfmTargets NAMESPACE mgsfm:: DESTINATION ${package_dir}
  COMPONENT dev)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/
  DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT dev
  FILES_MATCHING PATTERN "*.h")

set(packages_file ${PROJECT_BINARY_DIR}/mgsfmPackages.cmake)
foreach(component IN LISTS components)
  get_property(packages GLOBAL PROPERTY MGSFM_PACKAGES_OF_${component})
  string(APPEND packages_text
    "set(mgsfm_PACKAGES_OF_${component} ${packages})\n")
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
