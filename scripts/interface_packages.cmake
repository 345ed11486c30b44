# Passed to CMake as CMAKE_PROJECT_INCLUDE when an interface package is built against the ROS wheels. Nothing installed is
# changed; what is said here happens at the end of the project's configuration, when all its targets are known.

# The wheels export targets that name Python and NumPy include folders below /opt/python, which existed only on the machine
# that built the wheels; CMake refuses to generate for a target whose include folder is missing.
function(drop_missing_includes)
  get_directory_property(targets IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(folders "${target}" INTERFACE_INCLUDE_DIRECTORIES)
    if(folders MATCHES "/opt/python/")
      set(kept)
      foreach(folder IN LISTS folders)
        if(EXISTS "${folder}" OR NOT folder MATCHES "^/opt/python/")
          list(APPEND kept "${folder}")
        endif()
      endforeach()
      set_property(TARGET "${target}" PROPERTY INTERFACE_INCLUDE_DIRECTORIES "${kept}")
    endif()
  endforeach()
endfunction()

# The generated C++ sources are small, but each includes large headers: compiling all of a library's together takes half
# the time. The C sources cannot be compiled together: they define static variables of the same names.
function(compile_cpp_sources_together)
  foreach(kind c cpp fastrtps_c fastrtps_cpp introspection_cpp)
    if(TARGET "${PROJECT_NAME}__rosidl_typesupport_${kind}")
      set_target_properties("${PROJECT_NAME}__rosidl_typesupport_${kind}" PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 0)
    endif()
  endforeach()
endfunction()

cmake_language(DEFER CALL drop_missing_includes)
cmake_language(DEFER CALL compile_cpp_sources_together)
