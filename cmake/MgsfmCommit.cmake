# The target mgsfm_commit writes mgsfm_commit.h with the commit of the sources
# before each build, if it changed. As a script, writes that file:
#   cmake -DSOURCE=FOLDER -DOUTPUT=FILE -P MgsfmCommit.cmake
if(NOT CMAKE_SCRIPT_MODE_FILE)
  add_custom_target(mgsfm_commit
    COMMAND ${CMAKE_COMMAND} -DSOURCE=${PROJECT_SOURCE_DIR}
      -DOUTPUT=${PROJECT_BINARY_DIR}/generated/mgsfm_commit.h
      -P ${CMAKE_CURRENT_LIST_FILE}
    BYPRODUCTS ${PROJECT_BINARY_DIR}/generated/mgsfm_commit.h
    COMMENT "")
  return()
endif()

cmake_minimum_required(VERSION 3.22)
set(commit unknown)
if(EXISTS ${SOURCE}/.git)
  execute_process(
    COMMAND git -C ${SOURCE} describe --always --dirty --abbrev=12 --exclude=*
    OUTPUT_VARIABLE described OUTPUT_STRIP_TRAILING_WHITESPACE
    RESULT_VARIABLE result ERROR_QUIET)
  if(result EQUAL 0)
    set(commit ${described})
  endif()
endif()
file(CONFIGURE OUTPUT ${OUTPUT} CONTENT
  "#define MGSFM_COMMIT \"@commit@\"\n" @ONLY)
