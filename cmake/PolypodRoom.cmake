# polypod_room(<room> SOURCES <file>... [USES <room>...] [PUBLIC <target>...] [PRIVATE <target>...])
# One static library `polypod_<room>` with the alias `polypod::<room>`; USES names rooms, the rest are libraries.
function(polypod_room room)
  cmake_parse_arguments(ARG "" "" "SOURCES;USES;PUBLIC;PRIVATE" ${ARGN})
  set(target polypod_${room})
  add_library(${target} STATIC ${ARG_SOURCES})
  add_library(polypod::${room} ALIAS ${target})
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${room} POSITION_INDEPENDENT_CODE ON)
  target_compile_features(${target} PUBLIC cxx_std_20)
  target_include_directories(${target} PUBLIC
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
  foreach(used IN LISTS ARG_USES)
    target_link_libraries(${target} PUBLIC polypod_${used})
  endforeach()
  target_link_libraries(${target} PUBLIC ${ARG_PUBLIC} PRIVATE ${ARG_PRIVATE})
  polypod_warnings(${target})
  set_property(GLOBAL APPEND PROPERTY POLYPOD_ROOMS ${target})
endfunction()

function(polypod_warnings target)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion
    $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>  # g++ 12 raises these two falsely inside std::string
    $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>
    $<$<BOOL:${POLYPOD_WERROR}>:-Werror>)
endfunction()

# polypod_test(<name> SOURCES <file>... USES <room>... [PRIVATE <target>...]): a GoogleTest program of one room.
function(polypod_test name)
  cmake_parse_arguments(ARG "" "" "SOURCES;USES;PRIVATE" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  foreach(used IN LISTS ARG_USES)
    target_link_libraries(${name} PRIVATE polypod_${used})
  endforeach()
  target_link_libraries(${name} PRIVATE polypod_test_paths GTest::gtest_main GTest::gmock ${ARG_PRIVATE})
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR}/tests)
  polypod_warnings(${name})
  # g++ 12 raises these falsely where a literal and a string are added and the headers are precompiled.
  target_compile_options(${name} PRIVATE "$<$<CXX_COMPILER_ID:GNU>:-Wno-stringop-overflow;-Wno-array-bounds>")
  target_precompile_headers(${name} REUSE_FROM polypod_test_headers)
  include(GoogleTest)
  gtest_discover_tests(${name} DISCOVERY_TIMEOUT 60)
endfunction()
