# Injected with -DCMAKE_PROJECT_INCLUDE=<this file>.
# The ROS wheels export imported targets whose include directories are those of the image that the wheels were built
# in (/opt/python/cp3XY-cp3XY/include/python3.Y). At the end of the top directory, each of them is replaced by this
# interpreter's own include directory.
if(NOT _ros_wheels_fix_deferred AND CMAKE_SOURCE_DIR STREQUAL CMAKE_CURRENT_SOURCE_DIR)
  set(_ros_wheels_fix_deferred TRUE)
  function(_ros_wheels_fix_targets)
    find_package(Python3 REQUIRED COMPONENTS Interpreter Development NumPy)
    get_property(_targets DIRECTORY PROPERTY IMPORTED_TARGETS)
    foreach(_target IN LISTS _targets)
      get_target_property(_baked ${_target} INTERFACE_INCLUDE_DIRECTORIES)
      if(_baked)
        string(REGEX REPLACE "/opt/python/[^;>]*/numpy/_core/include" "${Python3_NumPy_INCLUDE_DIRS}" _here "${_baked}")
        string(REGEX REPLACE "/opt/python/[^;>/]*/include/python3\\.[0-9]+" "${Python3_INCLUDE_DIRS}" _here "${_here}")
        if(NOT _here STREQUAL _baked)
          set_target_properties(${_target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${_here}")
        endif()
      endif()
    endforeach()
  endfunction()
  cmake_language(DEFER DIRECTORY "${CMAKE_SOURCE_DIR}" CALL _ros_wheels_fix_targets)
endif()
