# All packages are Debian 12's; nothing is fetched.
find_package(Threads REQUIRED)
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(Ceres 2.1 REQUIRED)
find_package(SQLite3 REQUIRED)
find_package(OpenCV 4.6 REQUIRED COMPONENTS core imgcodecs)
find_package(CLI11 2.1 REQUIRED)
find_package(nlohmann_json 3.11 REQUIRED)

find_library(CHOLMOD_LIBRARY cholmod REQUIRED)
find_path(CHOLMOD_INCLUDE_DIR cholmod.h PATH_SUFFIXES suitesparse REQUIRED)
add_library(mgsfm_cholmod INTERFACE)
target_include_directories(mgsfm_cholmod SYSTEM INTERFACE
  ${CHOLMOD_INCLUDE_DIR})
target_link_libraries(mgsfm_cholmod INTERFACE ${CHOLMOD_LIBRARY})

if(MGSFM_BUILD_TESTS)
  find_package(GTest 1.12 REQUIRED)
  enable_testing()
endif()
