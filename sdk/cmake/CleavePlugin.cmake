# cleave_add_plugin(NAME SOURCES file... [LIBRARIES target...] [OUTPUT_DIRECTORY dir] [ISA_VARIANTS level...|none] [NO_INSTALL])
#
# Builds the plugin library NAME.so, and with it
#   x86-64-v3/NAME.so, x86-64-v4/NAME.so   the same sources for newer processors; the host picks the best one that runs
#   NAME.cleave.toml                       the manifest: what the plugin says of itself, readable without running it
#
# Everything goes to OUTPUT_DIRECTORY; else to CLEAVE_PLUGIN_OUTPUT_DIRECTORY; else to ./plugins in the build tree. Point
# CLEAVE_PLUGIN_PATH at it, or install: the plugin then lands in lib/cleave/plugins of the prefix.
#
# The sources are compiled several times into separate libraries instead of once with run-time branches: an inline function
# that one translation unit compiles for AVX-512 could otherwise be the copy the linker keeps for all.

set(CLEAVE_ISA_VARIANTS "x86-64-v3;x86-64-v4" CACHE STRING "Further builds of every plugin for newer x86 processors")

function(_cleave_plugin_library target isa directory)
  cmake_parse_arguments(arg "" "NAME" "SOURCES;LIBRARIES" ${ARGN})
  add_library(${target} MODULE ${arg_SOURCES})
  target_link_libraries(${target} PRIVATE Cleave::sdk ${arg_LIBRARIES})
  if(TARGET cleave_warnings)
    target_link_libraries(${target} PRIVATE cleave_warnings)
  endif()
  set(optimization -O3)
  if(CLEAVE_SANITIZE)
    set(optimization -O1)
  endif()
  # Formulas neither read errno nor floating-point exceptions; without these flags branches cannot become selects.
  # Unoptimised lanes are a hundred times slower, so debug and sanitizer builds optimise a little.
  target_compile_options(${target} PRIVATE
    $<IF:$<CONFIG:Debug>,-O1,${optimization}> -fno-math-errno -fno-trapping-math
    $<$<BOOL:${isa}>:-march=${isa}> $<$<STREQUAL:${isa},x86-64-v4>:-mprefer-vector-width=512>)
  # The map keeps instantiations of the standard library local as well: nothing is shared between plugins, and no unique
  # symbol pins the library in memory after it was closed.
  target_link_options(${target} PRIVATE -Wl,--version-script=${CMAKE_CURRENT_FUNCTION_LIST_DIR}/plugin.map)
  set_target_properties(${target} PROPERTIES
    PREFIX "" SUFFIX ".so" OUTPUT_NAME ${arg_NAME} LIBRARY_OUTPUT_DIRECTORY ${directory}
    LINK_DEPENDS ${CMAKE_CURRENT_FUNCTION_LIST_DIR}/plugin.map
    CXX_VISIBILITY_PRESET hidden C_VISIBILITY_PRESET hidden VISIBILITY_INLINES_HIDDEN ON)
endfunction()

function(cleave_add_plugin name)
  cmake_parse_arguments(arg "NO_INSTALL" "OUTPUT_DIRECTORY" "SOURCES;LIBRARIES;ISA_VARIANTS" ${ARGN})
  if(arg_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR "cleave_add_plugin(${name}): unknown argument ${arg_UNPARSED_ARGUMENTS}")
  endif()
  if(NOT arg_SOURCES)
    message(FATAL_ERROR "cleave_add_plugin(${name}): SOURCES is missing")
  endif()
  if(NOT arg_OUTPUT_DIRECTORY)
    set(arg_OUTPUT_DIRECTORY ${CMAKE_CURRENT_BINARY_DIR}/plugins)
    if(CLEAVE_PLUGIN_OUTPUT_DIRECTORY)
      set(arg_OUTPUT_DIRECTORY ${CLEAVE_PLUGIN_OUTPUT_DIRECTORY})
    endif()
  endif()

  set(baseline "")
  set(variants "")
  if(CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64|amd64)$")
    set(baseline x86-64-v2)
    if(NOT CLEAVE_SANITIZE)
      set(variants ${CLEAVE_ISA_VARIANTS})
      if(arg_ISA_VARIANTS)
        set(variants ${arg_ISA_VARIANTS})
      endif()
    endif()
  endif()
  list(REMOVE_ITEM variants none)

  _cleave_plugin_library(${name} "${baseline}" ${arg_OUTPUT_DIRECTORY}
    NAME ${name} SOURCES ${arg_SOURCES} LIBRARIES ${arg_LIBRARIES})
  add_custom_command(TARGET ${name} POST_BUILD
    COMMAND $<TARGET_FILE:Cleave::cleave-manifest> $<TARGET_FILE:${name}>
    BYPRODUCTS ${arg_OUTPUT_DIRECTORY}/${name}.cleave.toml
    COMMENT "Writing the manifest of ${name}" VERBATIM)
  add_dependencies(${name} Cleave::cleave-manifest)
  # Another version of the tool may write another manifest.
  set_property(TARGET ${name} APPEND PROPERTY LINK_DEPENDS $<TARGET_FILE:Cleave::cleave-manifest>)
  foreach(isa IN LISTS variants)
    _cleave_plugin_library(${name}-${isa} ${isa} ${arg_OUTPUT_DIRECTORY}/${isa}
      NAME ${name} SOURCES ${arg_SOURCES} LIBRARIES ${arg_LIBRARIES})
    add_dependencies(${name} ${name}-${isa})
  endforeach()

  if(NOT arg_NO_INSTALL)
    install(TARGETS ${name} LIBRARY DESTINATION lib/cleave/plugins COMPONENT plugins)
    install(FILES ${arg_OUTPUT_DIRECTORY}/${name}.cleave.toml DESTINATION lib/cleave/plugins COMPONENT plugins)
    # A manifest holds the size of its library, which is another once symbols are stripped.
    install(CODE "if(CMAKE_INSTALL_DO_STRIP)
  execute_process(COMMAND_ERROR_IS_FATAL ANY COMMAND \"$<TARGET_FILE:Cleave::cleave-manifest>\"
    \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/lib/cleave/plugins/$<TARGET_FILE_NAME:${name}>\")
endif()" COMPONENT plugins)
    foreach(isa IN LISTS variants)
      install(TARGETS ${name}-${isa} LIBRARY DESTINATION lib/cleave/plugins/${isa} COMPONENT plugins)
    endforeach()
  endif()
endfunction()
