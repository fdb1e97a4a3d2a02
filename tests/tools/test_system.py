"""What the system lacks is found, and the advice names what to install."""

import shutil

import pytest

from tools import system

LDD = """\
\tlinux-vdso.so.1 (0x00007f0c2ea2d000)
\tlibXi.so.6 => not found
\tlibm.so.6 => /lib/x86_64-linux-gnu/libm.so.6 (0x00007f0c09320000)
\tlibtbb.so.12 => /with space/bpy/lib/libtbb.so.12 (0x00007f0c09320000)
\tlibodd.so.1 => not found
\tlibXi.so.6 => not found
\t/lib64/ld-linux-x86-64.so.2 (0x00007f0c2ea2f000)
"""


def test_missing_libraries_are_read_from_ldd():
    assert system.missing_libraries(LDD) == ["libXi.so.6", "libodd.so.1"]
    assert system.missing_libraries("\tstatically linked\n") == []


def test_advice_is_one_command():
    faults = [system.library_fault(name) for name in system.missing_libraries(LDD)]
    faults.append(system.Fault("a C++20 compiler", ("g++",)))
    advice = system.advice(faults).splitlines()
    assert "  the shared library libXi.so.6" in advice
    assert "  the shared library libodd.so.1" in advice
    assert advice[-1] == "  sudo apt-get install g++ libxi6"


def test_advice_without_packages_has_no_command():
    assert "apt-get" not in system.advice([system.library_fault("libodd.so.1")])


def test_this_system_is_complete():
    assert system.faults() == []


def test_missing_library_is_a_fault(monkeypatch):
    monkeypatch.setitem(system.LIBRARY_PACKAGES, "libnacre-absent.so.9", "libnacre-absent9")
    assert system.packages(system.faults()) == ["libnacre-absent9"]


def test_missing_compiler_is_a_fault(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CXX", raising=False)
    assert system.compiler() is None
    assert "g++" in system.packages(system.faults())


@pytest.mark.skipif(not shutil.which("g++"), reason="the compiler here has another name")
def test_compiler_variable_comes_first(monkeypatch):
    monkeypatch.setenv("CXX", "g++ -Wall")
    assert system.compiler() == "g++ -Wall"
    monkeypatch.setenv("CXX", "no-such-compiler")
    assert system.compiler() in {"c++", "g++"}


def test_missing_opengl_driver_is_a_fault(monkeypatch):
    monkeypatch.setattr(system, "_OPENGL_PROBE", "raise SystemExit(1)")
    assert system.packages(system.faults()) == ["libegl1", "libgl1", "libgl1-mesa-dri"]
