# Install rules: the program, the rooms as `polypod::<room>` targets, the catalogue and the examples.
include(CMakePackageConfigHelpers)
get_property(rooms GLOBAL PROPERTY POLYPOD_ROOMS)
install(TARGETS ${rooms} EXPORT polypodTargets
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR})
if(TARGET polypod)
  install(TARGETS polypod RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endif()
install(DIRECTORY include/polypod DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(DIRECTORY machines DESTINATION ${CMAKE_INSTALL_DATADIR}/polypod)
install(DIRECTORY cells DESTINATION ${CMAKE_INSTALL_DATADIR}/polypod)
install(DIRECTORY examples DESTINATION ${CMAKE_INSTALL_DATADIR}/polypod)
install(EXPORT polypodTargets NAMESPACE polypod:: DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/polypod)
configure_package_config_file(cmake/polypodConfig.cmake.in ${CMAKE_CURRENT_BINARY_DIR}/polypodConfig.cmake
  INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/polypod)
write_basic_package_version_file(${CMAKE_CURRENT_BINARY_DIR}/polypodConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/polypodConfig.cmake ${CMAKE_CURRENT_BINARY_DIR}/polypodConfigVersion.cmake
  DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/polypod)
