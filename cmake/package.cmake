# Packages for machines that do not build (scripts/package): `cpack -G DEB`, whose libraries apt installs, and `cpack -G TGZ`,
# which brings its libraries and may be unpacked anywhere. Both have the programs; what find_package(handhold) needs stays
# with `cmake --install`.

# Everything that the programs load but glibc, which has to be the machine's own.
install(RUNTIME_DEPENDENCY_SET handhold_libraries PRE_EXCLUDE_REGEXES "^ld-linux" "^lib(c|m|dl|rt|pthread)[.]so"
        LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/handhold COMPONENT libraries EXCLUDE_FROM_ALL)

# The terms under which they are passed on.
set(copyrights [[
  file(GLOB libraries RELATIVE "${CMAKE_INSTALL_PREFIX}/LIBDIR/handhold" "${CMAKE_INSTALL_PREFIX}/LIBDIR/handhold/*")
  list(TRANSFORM libraries PREPEND "*/")
  execute_process(COMMAND dpkg-query --search ${libraries} OUTPUT_VARIABLE owners ERROR_QUIET)
  string(REGEX MATCHALL "[^\n]+" owners "${owners}")
  list(TRANSFORM owners REPLACE ":.*" "")
  list(REMOVE_DUPLICATES owners)
  foreach(owner IN LISTS owners)
    file(INSTALL "/usr/share/doc/${owner}/copyright" DESTINATION "${CMAKE_INSTALL_PREFIX}/DOCDIR/libraries" RENAME "${owner}")
  endforeach()
]])
string(REPLACE LIBDIR ${CMAKE_INSTALL_LIBDIR} copyrights "${copyrights}")
string(REPLACE DOCDIR ${CMAKE_INSTALL_DOCDIR} copyrights "${copyrights}")
install(CODE "${copyrights}" COMPONENT libraries EXCLUDE_FROM_ALL)

set(CPACK_MACHINE ${CMAKE_SYSTEM_PROCESSOR})
set(CPACK_PACKAGE_CONTACT "Handhold maintainers <handhold@localhost>")
set(CPACK_PACKAGE_VENDOR "Handhold")
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_GROUPING ALL_COMPONENTS_IN_ONE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_ARCHIVE_COMPONENT_INSTALL ON)
set(CPACK_RESOURCE_FILE_LICENSE ${PROJECT_SOURCE_DIR}/LICENSE)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS python3-h5py)  # handhold.py
set(CPACK_PROJECT_CONFIG_FILE ${PROJECT_SOURCE_DIR}/cmake/package_kind.cmake)
include(CPack)
