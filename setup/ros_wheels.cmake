# Given to CMake as CMAKE_PROJECT_INCLUDE where ROS 2 comes from PyPI; runs after each project() call.

# The wheels' exported targets carry include folders of the machine that built them (/opt/python/...), and CMake refuses
# a target whose include folder does not exist. Once the project has found its packages, drop those entries.
function(drop_foreign_include_folders)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(include_folders ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(include_folders)
      list(FILTER include_folders EXCLUDE REGEX "^/opt/python/")
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${include_folders}")
    endif()
  endforeach()
endfunction()

cmake_language(DEFER CALL drop_foreign_include_folders)

# rclpy uses the C messages; nothing here can use the C++ ones, and they are half of the build. Found before the project
# asks for them, the generators register once: take those for C++ off the list.
if(PROJECT_NAME STREQUAL "feedopt_msgs")
  find_package(ament_cmake REQUIRED)
  find_package(rosidl_default_generators REQUIRED)
  list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "_cpp:")
endif()
