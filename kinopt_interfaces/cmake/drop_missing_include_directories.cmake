# Drop include directories that do not exist from all imported targets.
#
# The ROS 2 message packages on PyPI were built on another machine, and the
# CMake targets that they export (std_msgs::std_msgs__rosidl_generator_py and
# its like) still name the Python and NumPy headers of that machine. CMake
# refuses to link against a target with a missing include directory:
#
#   Imported target "..." includes non-existent path "..."
#   in its INTERFACE_INCLUDE_DIRECTORIES.
#
# The right headers are found here anyway, by the Python generator's own
# find_package(Python3). The edit is to the targets in the memory of this CMake
# run; no installed file is touched. Where every directory exists, as on a
# ROS 2 install, nothing changes. Targets with generator expressions there are
# left alone.
#
# Call it after rosidl_generate_interfaces, which finds more message packages on
# its own (service_msgs for every service).
function(drop_missing_include_directories)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(NOT directories OR directories MATCHES "\\$<")
      continue()
    endif()
    set(kept "")
    foreach(directory IN LISTS directories)
      if(EXISTS "${directory}")
        list(APPEND kept "${directory}")
      endif()
    endforeach()
    if(NOT kept STREQUAL directories)
      set_target_properties(${target} PROPERTIES
        INTERFACE_INCLUDE_DIRECTORIES "${kept}")
    endif()
  endforeach()
endfunction()
