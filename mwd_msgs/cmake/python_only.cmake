# SPDX-License-Identifier: Apache-2.0
# By default the messages are built for every language, as C++ nodes, rosbag2 and bridges need them. A node in Python needs
# half of that: C and its type supports, of which Fast DDS takes introspection, too. Include this after all find_package,
# before the interfaces.
option(PYTHON_ONLY "Build what rclpy needs, nothing for C++" OFF)
if(PYTHON_ONLY)
  list(FILTER AMENT_EXTENSIONS_rosidl_generate_idl_interfaces EXCLUDE REGEX "_cpp:")
  # Nearly all of the compiler's time goes into headers that these sources share. The sources of generator_c cannot be
  # joined: their static names are the same in each.
  cmake_language(DEFER CALL set_target_properties ${PROJECT_NAME}__rosidl_generator_py
    ${PROJECT_NAME}__rosidl_typesupport_c ${PROJECT_NAME}__rosidl_typesupport_fastrtps_c
    PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 32)
endif()
