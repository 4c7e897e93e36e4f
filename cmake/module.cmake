# Flags of our own code. No -ffast-math (misses are +inf) and no FP contraction (equal results on every machine).
add_library(handhold_flags INTERFACE)
target_compile_options(handhold_flags INTERFACE -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion
                                                -Werror -ffp-contract=off)
# gcc 12 sees overlapping and endless copies in std::string's operator+ (its bug 105651); the sanitizers look for real ones.
target_compile_options(handhold_flags INTERFACE
                       "$<$<CXX_COMPILER_ID:GNU>:-Wno-restrict;-Wno-stringop-overflow;-Wno-stringop-overread;-Wno-array-bounds>")
# Presets with CMAKE_UNITY_BUILD compile so many files at once: a whole build takes two thirds of the time, as most of a file's
# is templates of json and Eigen that its neighbours need as well. gcc then takes their anonymous namespaces for a header's.
set(CMAKE_UNITY_BUILD_BATCH_SIZE 5)
if(CMAKE_UNITY_BUILD)
  target_compile_options(handhold_flags INTERFACE $<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>)
endif()
target_compile_features(handhold_flags INTERFACE cxx_std_20)
target_include_directories(handhold_flags INTERFACE $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/src>)

# Programs and tests: they parse, print and call the modules, and a quarter of their compilation is optimisation that saves
# nothing when they run.
add_library(handhold_shell_flags INTERFACE)
target_compile_options(handhold_shell_flags INTERFACE $<$<CONFIG:Release>:-O1>)

# Headers that nearly every file reads, compiled once; CMAKE_DISABLE_PRECOMPILE_HEADERS (preset clang) shows what a file forgot to
# include.
set(common_headers <algorithm> <array> <cmath> <filesystem> <functional> <map> <memory> <optional> <string> <vector>
                   <Eigen/Geometry> <fmt/format.h>)
add_library(handhold_headers OBJECT ${CMAKE_CURRENT_LIST_DIR}/precompiled.cpp)
target_link_libraries(handhold_headers PRIVATE handhold_flags Eigen3::Eigen fmt::fmt Threads::Threads)
target_precompile_headers(handhold_headers PRIVATE ${common_headers})

# handhold_module(NAME SOURCES a.cpp ... [PUBLIC targets] [PRIVATE targets]): one folder of src/, one static library.
function(handhold_module name)
  cmake_parse_arguments(MODULE "" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  list(TRANSFORM MODULE_SOURCES PREPEND ${CMAKE_CURRENT_SOURCE_DIR}/${name}/)
  add_library(handhold_${name} STATIC ${MODULE_SOURCES})
  add_library(handhold::${name} ALIAS handhold_${name})
  # Warnings are ours: who uses an installed library gets its headers and the language alone.
  target_link_libraries(handhold_${name} PUBLIC $<BUILD_INTERFACE:handhold_flags> Eigen3::Eigen ${MODULE_PUBLIC}
                                         PRIVATE fmt::fmt ${MODULE_PRIVATE})
  target_compile_features(handhold_${name} PUBLIC cxx_std_20)
  target_precompile_headers(handhold_${name} REUSE_FROM handhold_headers)
  target_include_directories(handhold_${name} INTERFACE $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/handhold>)
  set_target_properties(handhold_${name} PROPERTIES EXPORT_NAME ${name})
  install(TARGETS handhold_${name} EXPORT handhold ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development)
  install(DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR}/${name} DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/handhold
          COMPONENT development FILES_MATCHING PATTERN "*.h")
endfunction()

# handhold_test(NAME SOURCES a.cpp ... LIBRARIES targets): one GoogleTest program, labelled fast.
function(handhold_test name)
  cmake_parse_arguments(TEST "" "TIMEOUT" "SOURCES;LIBRARIES" ${ARGN})
  list(TRANSFORM TEST_SOURCES PREPEND ${CMAKE_CURRENT_SOURCE_DIR}/${name}/)
  add_executable(test_${name} ${TEST_SOURCES})
  target_link_libraries(test_${name} PRIVATE handhold_flags handhold_shell_flags GTest::gmock GTest::gtest_main fmt::fmt ${TEST_LIBRARIES})
  target_include_directories(test_${name} PRIVATE ${CMAKE_SOURCE_DIR}/tests)
  target_precompile_headers(test_${name} REUSE_FROM handhold_test_headers)
  target_compile_definitions(test_${name} PRIVATE HANDHOLD_SOURCE_DIR="${CMAKE_SOURCE_DIR}")
  if(NOT TEST_TIMEOUT)
    set(TEST_TIMEOUT 900)
  endif()
  add_test(NAME ${name} COMMAND test_${name})
  set_tests_properties(${name} PROPERTIES LABELS fast TIMEOUT ${TEST_TIMEOUT})
endfunction()
