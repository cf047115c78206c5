# One function per kind of target.

# mgsfm_add_module(NAME SOURCES ... DEPENDS modules... LINK packages...)
# The library mgsfm_NAME (alias mgsfm::NAME) from src/NAME, static unless
# BUILD_SHARED_LIBS is on. It links the modules it may include, and nothing else
# sees its packages' headers.
function(mgsfm_add_module name)
  cmake_parse_arguments(arg "" "" "SOURCES;DEPENDS;LINK" ${ARGN})
  set(target mgsfm_${name})
  add_library(${target} ${arg_SOURCES})
  add_library(mgsfm::${name} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${name}
    UNITY_BUILD ${MGSFM_UNITY_BUILD}
    VERSION ${PROJECT_VERSION}
    SOVERSION ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
  target_include_directories(${target}
    PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>
           $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>
    PRIVATE ${PROJECT_SOURCE_DIR}/src)
  foreach(module IN LISTS arg_DEPENDS)
    target_link_libraries(${target} PUBLIC mgsfm::${module})
  endforeach()
  target_link_libraries(${target} PUBLIC Eigen3::Eigen
    PRIVATE ${arg_LINK} Threads::Threads $<BUILD_INTERFACE:mgsfm_warnings>)
  mgsfm_reuse_precompiled_headers(${target} mgsfm_common_headers)
  set_property(GLOBAL APPEND PROPERTY MGSFM_MODULES ${target})
  # The libraries that a user of this module must find: see MgsfmInstall.cmake.
  set(packages ${arg_LINK})
  foreach(module IN LISTS arg_DEPENDS)
    get_property(inherited GLOBAL PROPERTY MGSFM_PACKAGES_OF_${module})
    list(APPEND packages ${inherited})
  endforeach()
  list(REMOVE_DUPLICATES packages)
  set_property(GLOBAL PROPERTY MGSFM_PACKAGES_OF_${name} ${packages})
endfunction()

# Tests spend their time in the modules, which keep the flags of the build; to
# optimise the tests themselves takes longer than it saves.
add_library(mgsfm_test_flags INTERFACE)
target_compile_options(mgsfm_test_flags INTERFACE
  $<$<CONFIG:Release,RelWithDebInfo>:-O1>)

# mgsfm_add_test(NAME SOURCES ... DEPENDS modules... [LINK packages...]
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
  target_include_directories(${target} PRIVATE
    ${PROJECT_SOURCE_DIR}/src ${PROJECT_SOURCE_DIR}/tests)
  target_compile_definitions(${target} PRIVATE
    MGSFM_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
  foreach(module IN LISTS arg_DEPENDS)
    target_link_libraries(${target} PRIVATE mgsfm::${module})
  endforeach()
  target_link_libraries(${target} PRIVATE ${arg_LINK} GTest::gmock
    GTest::gtest_main mgsfm_test_flags mgsfm_warnings)
  mgsfm_reuse_precompiled_headers(${target} mgsfm_test_headers)
  add_test(NAME ${name} COMMAND ${target})
  set_tests_properties(${name} PROPERTIES TIMEOUT 600)
  if(arg_LABELS)
    set_tests_properties(${name} PROPERTIES LABELS "${arg_LABELS}")
  endif()
endfunction()

# mgsfm_add_benchmark(NAME SOURCES ... DEPENDS modules... [LINK packages...])
# One program mgsfm_NAME. It needs the shared libraries that it uses and no
# others, so that it can be taken to another machine.
function(mgsfm_add_benchmark name)
  cmake_parse_arguments(arg "" "" "SOURCES;DEPENDS;LINK" ${ARGN})
  set(target mgsfm_${name})
  add_executable(${target} ${arg_SOURCES})
  target_include_directories(${target} PRIVATE
    ${PROJECT_SOURCE_DIR}/src ${PROJECT_SOURCE_DIR}/bench)
  foreach(module IN LISTS arg_DEPENDS)
    target_link_libraries(${target} PRIVATE mgsfm::${module})
  endforeach()
  target_link_libraries(${target} PRIVATE ${arg_LINK} mgsfm_warnings)
  target_link_options(${target} PRIVATE LINKER:--as-needed)
  mgsfm_reuse_precompiled_headers(${target} mgsfm_common_headers)
endfunction()
