# Passed to CMake as CMAKE_PROJECT_INCLUDE when an interface package is built against the ROS wheels.
#
# The wheels export targets that name Python and NumPy include folders below /opt/python, which existed only on the machine
# that built the wheels; CMake refuses to generate for a target whose include folder is missing. The imported targets appear
# during the project's find_package calls, so they are mended at the end of its configuration. Nothing installed is changed.

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

cmake_language(DEFER CALL drop_missing_includes)
