add_library(mgsfm_warnings INTERFACE)
target_compile_options(mgsfm_warnings INTERFACE -Wall -Wextra)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
  # GCC 12 warns of every std::optional member that it moves at -O3, and not
  # on every machine (GCC bug 80635); clang-tidy looks for the real ones.
  target_compile_options(mgsfm_warnings INTERFACE -Wno-maybe-uninitialized)
endif()
if(MGSFM_WARNINGS_AS_ERRORS)
  target_compile_options(mgsfm_warnings INTERFACE -Werror)
endif()
