# Eigen's headers: those of the cmeel-eigen package of this Python, else an installed Eigen 3.4.
# Sets NACRE_EIGEN_INCLUDE.
execute_process(
  COMMAND ${Python_EXECUTABLE} -c [[
import pathlib, sys
for path in sys.path:
    folder = pathlib.Path(path) / "cmeel.prefix" / "include" / "eigen3"
    if (folder / "Eigen" / "Core").is_file():
        print(folder.as_posix())
        break
]]
  OUTPUT_VARIABLE NACRE_EIGEN_INCLUDE OUTPUT_STRIP_TRAILING_WHITESPACE)
if(NOT NACRE_EIGEN_INCLUDE)
  find_package(Eigen3 3.4 CONFIG QUIET)
  if(NOT TARGET Eigen3::Eigen)
    message(FATAL_ERROR "Eigen not found: pip install cmeel-eigen, or apt install libeigen3-dev")
  endif()
  get_target_property(NACRE_EIGEN_INCLUDE Eigen3::Eigen INTERFACE_INCLUDE_DIRECTORIES)
endif()
message(STATUS "Eigen: ${NACRE_EIGEN_INCLUDE}")
