# Read by cpack for each kind of package: a Debian package lies in /usr and leaves libraries to apt.
if(CPACK_GENERATOR STREQUAL "DEB")
  set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
  set(CPACK_COMPONENTS_ALL programs)
else()
  set(CPACK_COMPONENTS_ALL programs libraries)
  set(CPACK_COMPONENT_INCLUDE_TOPLEVEL_DIRECTORY ON)
  string(TOLOWER "handhold-${CPACK_PACKAGE_VERSION}-${CPACK_SYSTEM_NAME}-${CPACK_MACHINE}" CPACK_PACKAGE_FILE_NAME)
endif()
