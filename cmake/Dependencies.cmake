# Everything from Debian 12; ./dev installs it.
find_package(PkgConfig REQUIRED)
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(yaml-cpp REQUIRED)
find_package(OpenCV 4.6 REQUIRED COMPONENTS core imgproc imgcodecs calib3d aruco features2d videoio)
find_package(apriltag 3.3 REQUIRED)
find_package(Ceres 2.1 REQUIRED)
find_package(SQLite3 REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(OpenSSL 3 REQUIRED COMPONENTS Crypto)
find_package(CLI11 REQUIRED)
find_package(Threads REQUIRED)
find_package(urdfdom REQUIRED)
find_package(orocos_kdl REQUIRED)
find_package(fcl 0.7 REQUIRED)
find_package(ompl 1.5 REQUIRED)
pkg_check_modules(cairo REQUIRED IMPORTED_TARGET cairo cairo-pdf)
pkg_check_modules(httplib REQUIRED IMPORTED_TARGET cpp-httplib)
pkg_check_modules(libusb REQUIRED IMPORTED_TARGET libusb-1.0)
pkg_check_modules(libfreenect REQUIRED IMPORTED_TARGET libfreenect)

# OpenNI2 ships a pkg-config file alone, which names the library without its folder.
pkg_check_modules(openni2 REQUIRED IMPORTED_TARGET libopenni2)
add_library(servocal_openni2 INTERFACE)
target_include_directories(servocal_openni2 SYSTEM INTERFACE ${openni2_INCLUDE_DIRS})
target_link_libraries(servocal_openni2 INTERFACE PkgConfig::openni2)
set(SERVOCAL_OPENNI2_LIBRARY ${openni2_LINK_LIBRARIES})
get_filename_component(SERVOCAL_OPENNI2_FOLDER ${SERVOCAL_OPENNI2_LIBRARY} DIRECTORY)

# VISP's package file appends to CMAKE_CXX_FLAGS and carries no include directories in its targets.
set(servocal_saved_flags "${CMAKE_CXX_FLAGS}")
find_package(VISP 3.5 REQUIRED visp_core visp_vs visp_visual_features)
set(CMAKE_CXX_FLAGS "${servocal_saved_flags}")
set(CMAKE_CXX_STANDARD 17)
add_library(servocal_visp INTERFACE)
target_include_directories(servocal_visp SYSTEM INTERFACE ${VISP_INCLUDE_DIRS})
target_link_libraries(servocal_visp INTERFACE visp_core visp_vs visp_visual_features)

# OMPL's package file sets variables only, and lists boost libraries that the planners do not need.
list(GET OMPL_LIBRARIES 0 servocal_ompl_library)
add_library(servocal_ompl INTERFACE)
target_include_directories(servocal_ompl SYSTEM INTERFACE ${OMPL_INCLUDE_DIRS})
target_link_libraries(servocal_ompl INTERFACE ${servocal_ompl_library})

add_library(servocal_kdl INTERFACE)
target_include_directories(servocal_kdl SYSTEM INTERFACE ${orocos_kdl_INCLUDE_DIRS})
target_link_libraries(servocal_kdl INTERFACE ${orocos_kdl_LIBRARIES})

if(BUILD_TESTING)
  find_package(GTest REQUIRED)
  pkg_check_modules(umockdev REQUIRED IMPORTED_TARGET umockdev-1.0)  # a mocked USB
endif()
