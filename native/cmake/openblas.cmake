# OpenBLAS with run-time dispatch, from the scipy-openblas32 package of this Python. The package has
# a shared library only, so a copy of it goes into the wheel, beside the module.
#
# The copy gets a SONAME of its own, of the same length. The dynamic loader takes libraries of equal
# SONAME for one, and ours is set to one thread: no other package's OpenBLAS may be mistaken for it.
#
# Defines the target nacre_openblas and sets NACRE_OPENBLAS_FILE and NACRE_OPENBLAS_LICENSE.
set(NACRE_OPENBLAS_FILE ${CMAKE_CURRENT_BINARY_DIR}/libnacre_openblas.so)
execute_process(
  COMMAND ${Python_EXECUTABLE} -c [[
import importlib.metadata, pathlib, sys
import scipy_openblas32
library = pathlib.Path(scipy_openblas32.get_lib_dir()) / "libscipy_openblas.so"
data = library.read_bytes()
old, new = b"\0libscipy_openblas.so\0", b"\0libnacre_openblas.so\0"
if data.count(old) != 1:
    sys.exit("the SONAME of " + str(library) + " is not where it is expected")
target = pathlib.Path(sys.argv[1])
data = data.replace(old, new)
if not target.exists() or target.read_bytes() != data:
    target.write_bytes(data)
files = importlib.metadata.files("scipy-openblas32")
print(next(f.locate() for f in files if f.name.startswith("LICENSE")).as_posix())
]] ${NACRE_OPENBLAS_FILE}
  OUTPUT_VARIABLE NACRE_OPENBLAS_LICENSE OUTPUT_STRIP_TRAILING_WHITESPACE
  RESULT_VARIABLE status)
if(NOT status EQUAL 0)
  message(FATAL_ERROR "OpenBLAS not found: pip install scipy-openblas32")
endif()
add_library(nacre_openblas SHARED IMPORTED)
set_target_properties(nacre_openblas PROPERTIES
  IMPORTED_LOCATION ${NACRE_OPENBLAS_FILE}
  IMPORTED_SONAME libnacre_openblas.so)
