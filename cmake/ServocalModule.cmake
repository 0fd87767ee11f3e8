# House macros: one way to declare a module, an app and a test.
include(GNUInstallDirs)

# servocal_add_module(NAME [TARGET name] PUBLIC_HEADERS ... SOURCES ... PUBLIC_DEPS ... PRIVATE_DEPS ...)
# Makes servocal_<name> (alias servocal::<name>) from explicit sources. Headers live in
# include/servocal/<name>/; PUBLIC_DEPS are what they include.
function(servocal_add_module name)
  cmake_parse_arguments(ARG "" "" "PUBLIC_HEADERS;SOURCES;PUBLIC_DEPS;PRIVATE_DEPS" ${ARGN})
  set(target servocal_${name})
  if(ARG_SOURCES)
    add_library(${target} STATIC ${ARG_SOURCES})
    set(scope PUBLIC)
    target_link_libraries(${target} PRIVATE servocal_warnings ${ARG_PRIVATE_DEPS})
  else()
    add_library(${target} INTERFACE)
    set(scope INTERFACE)
  endif()
  add_library(servocal::${name} ALIAS ${target})
  target_include_directories(${target} ${scope} $<BUILD_INTERFACE:${CMAKE_CURRENT_SOURCE_DIR}/include>)
  target_link_libraries(${target} ${scope} ${ARG_PUBLIC_DEPS})
  foreach(header IN LISTS ARG_PUBLIC_HEADERS)
    set_property(GLOBAL APPEND PROPERTY SERVOCAL_HEADERS "servocal/${name}/${header}")
    set_property(GLOBAL APPEND PROPERTY SERVOCAL_HEADER_TARGETS ${target})
  endforeach()
endfunction()

# servocal_add_app(servocal-verb DEPS ...): apps/servocal-verb.cpp
function(servocal_add_app name)
  cmake_parse_arguments(ARG "" "" "DEPS" ${ARGN})
  add_executable(${name} ${name}.cpp)
  target_link_libraries(${name} PRIVATE servocal_warnings servocal::app ${ARG_DEPS})
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)
endfunction()

# servocal_add_test(name SOURCES ... DEPS ... [SERIAL] [LABELS ...] [TIMEOUT s]): one GoogleTest program, one ctest
# entry per case.
function(servocal_add_test name)
  cmake_parse_arguments(ARG "SERIAL" "TIMEOUT" "SOURCES;DEPS;LABELS" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 120)
  endif()
  if(CMAKE_CXX_FLAGS MATCHES "-fsanitize")
    math(EXPR ARG_TIMEOUT "10 * ${ARG_TIMEOUT}")  # Instrumented, everything takes longer.
  endif()
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE servocal_warnings servocal_test_support ${ARG_DEPS}
                                        GTest::gtest_main)
  set(properties TIMEOUT ${ARG_TIMEOUT})
  if(ARG_LABELS)
    list(APPEND properties LABELS "${ARG_LABELS}")
  endif()
  if("system" IN_LIST ARG_LABELS)
    list(APPEND properties COST 10)  # Long ones first, so that no processor idles at the end.
  endif()
  if(ARG_SERIAL)
    list(APPEND properties RUN_SERIAL TRUE)
  endif()
  gtest_discover_tests(${name} DISCOVERY_TIMEOUT 60 PROPERTIES ${properties})
endfunction()

# servocal_add_counted_test(name DEFINITION few many SOURCES ...): the same program twice, <name>_<few> with DEFINITION=few
# under the given labels, and <name>_<many> for the nightly run.
function(servocal_add_counted_test name definition few many)
  cmake_parse_arguments(ARG "" "LABELS;TIMEOUT" "" ${ARGN})
  foreach(count IN ITEMS ${few} ${many})
    set(labels ${ARG_LABELS})
    if(count EQUAL many)
      set(labels nightly)
    endif()
    servocal_add_test(${name}_${count} ${ARG_UNPARSED_ARGUMENTS} LABELS ${labels} TIMEOUT ${ARG_TIMEOUT})
    target_compile_definitions(${name}_${count} PRIVATE ${definition}=${count})
  endforeach()
endfunction()
