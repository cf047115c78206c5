# One function per kind of target.

# mgsfm_add_group(GROUP [DEPENDS groups...] MODULES modules...)
# The library mgsfm_GROUP (alias mgsfm::GROUP) of the modules in src/GROUP,
# static unless BUILD_SHARED_LIBS is on. It sees the private headers of itself and
# of the groups below it, and of no other; who uses an installed library sees
# public headers only.
function(mgsfm_add_group group)
  cmake_parse_arguments(arg "" "" "DEPENDS;MODULES" ${ARGN})
  set(target mgsfm_${group})
  add_library(${target})
  add_library(mgsfm::${group} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${group}
    UNITY_BUILD ${MGSFM_UNITY_BUILD} UNITY_BUILD_MODE GROUP
    VERSION ${PROJECT_VERSION}
    SOVERSION ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
  target_include_directories(${target}
    PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>
           $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/src/${group}>
           $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  mgsfm_reuse_precompiled_headers(${target} mgsfm_common_headers)
  foreach(module IN LISTS arg_MODULES)
    add_subdirectory(src/${group}/${module})
    set_property(GLOBAL APPEND PROPERTY MGSFM_TEST_FOLDERS ${group}/${module})
  endforeach()
  set_property(GLOBAL APPEND PROPERTY MGSFM_TEST_FOLDERS ${group})
  get_property(link GLOBAL PROPERTY MGSFM_PACKAGES_OF_${group})
  list(REMOVE_DUPLICATES link)
  set(packages ${link})
  foreach(other IN LISTS arg_DEPENDS)
    target_link_libraries(${target} PUBLIC mgsfm::${other})
    get_property(inherited GLOBAL PROPERTY MGSFM_PACKAGES_OF_${other})
    list(APPEND packages ${inherited})
  endforeach()
  target_link_libraries(${target} PUBLIC Eigen3::Eigen
    PRIVATE ${link} Threads::Threads $<BUILD_INTERFACE:mgsfm_warnings>)
  # The libraries that a user of this group must find: see MgsfmInstall.cmake.
  list(REMOVE_DUPLICATES packages)
  set_property(GLOBAL PROPERTY MGSFM_PACKAGES_OF_${group} ${packages})
  set_property(GLOBAL APPEND PROPERTY MGSFM_GROUPS ${group})
endfunction()

# mgsfm_add_module(NAME SOURCES ... [API headers...] [LINK packages...]
#                  [ALONE sources...])
# Adds src/GROUP/NAME to its group. Of its private headers, other modules include
# those named API only (scripts/check_layers.sh). A unity build compiles eight
# files as one, but for those ALONE, whose local names clash with those of others.
function(mgsfm_add_module name)
  cmake_parse_arguments(arg "" "" "SOURCES;API;LINK;ALONE" ${ARGN})
  target_sources(mgsfm_${group} PRIVATE ${arg_SOURCES})
  set(index 0)
  foreach(source IN LISTS arg_SOURCES)
    if(NOT source IN_LIST arg_ALONE)
      math(EXPR batch "${index} / 8")
      math(EXPR index "${index} + 1")
      set_source_files_properties(${source} TARGET_DIRECTORY mgsfm_${group}
        PROPERTIES UNITY_GROUP ${name}_${batch})
    endif()
  endforeach()
  set_property(GLOBAL APPEND PROPERTY MGSFM_PACKAGES_OF_${group} ${arg_LINK})
endfunction()

# Tests spend their time in the modules, which keep the flags of the build; to
# optimize the tests themselves takes longer than it saves.
add_library(mgsfm_test_flags INTERFACE)
target_compile_options(mgsfm_test_flags INTERFACE
  $<$<CONFIG:Release,RelWithDebInfo>:-O1>)

# mgsfm_add_test(NAME SOURCES ... DEPENDS groups... [LINK packages...]
#                [LABELS ...] [ALONE sources...])
# One GoogleTest program mgsfm_NAME_test, run by CTest as one test. Names in the
# files ALONE clash with those of the others: MGSFM_UNITY_TESTS leaves them out.
function(mgsfm_add_test name)
  cmake_parse_arguments(arg "" "" "SOURCES;DEPENDS;LINK;LABELS;ALONE" ${ARGN})
  set(target mgsfm_${name}_test)
  add_executable(${target} ${arg_SOURCES})
  set_target_properties(${target} PROPERTIES UNITY_BUILD ${MGSFM_UNITY_TESTS})
  if(arg_ALONE)
    set_source_files_properties(${arg_ALONE} PROPERTIES
      SKIP_UNITY_BUILD_INCLUSION ON)
  endif()
  target_include_directories(${target} PRIVATE ${PROJECT_SOURCE_DIR}/tests)
  target_compile_definitions(${target} PRIVATE
    MGSFM_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
  list(TRANSFORM arg_DEPENDS PREPEND mgsfm::)
  target_link_libraries(${target} PRIVATE ${arg_DEPENDS} ${arg_LINK} GTest::gmock
    GTest::gtest_main mgsfm_test_flags mgsfm_warnings)
  mgsfm_reuse_precompiled_headers(${target} mgsfm_test_headers)
  add_test(NAME ${name} COMMAND ${target})
  # Three times what the longest takes on a machine with a load of ten.
  set_tests_properties(${name} PROPERTIES TIMEOUT 1200)
  if(arg_LABELS)
    set_tests_properties(${name} PROPERTIES LABELS "${arg_LABELS}")
  endif()
endfunction()

# mgsfm_add_benchmark(NAME SOURCES ... DEPENDS groups... [LINK packages...])
# One program mgsfm_NAME. It needs the shared libraries that it uses and no
# others, so that it can be taken to another machine.
function(mgsfm_add_benchmark name)
  cmake_parse_arguments(arg "" "" "SOURCES;DEPENDS;LINK" ${ARGN})
  set(target mgsfm_${name})
  add_executable(${target} ${arg_SOURCES})
  target_include_directories(${target} PRIVATE ${PROJECT_SOURCE_DIR}/bench)
  list(TRANSFORM arg_DEPENDS PREPEND mgsfm::)
  target_link_libraries(${target} PRIVATE ${arg_DEPENDS} ${arg_LINK} mgsfm_warnings)
  target_link_options(${target} PRIVATE LINKER:--as-needed)
  mgsfm_reuse_precompiled_headers(${target} mgsfm_common_headers)
endfunction()
