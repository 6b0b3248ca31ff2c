"""Compilation of LLVM IR from any source to objects, and loading of objects."""

import ctypes
import gc

import llvmlite.binding
import pytest

from beamdae import errors
from beamdae.errors import KernelWarning
from beamdae.native import llvm
from beamdae.native.llvm import LoadedObject, MachineCodeError, compile_module, library_address
from beamdae.native.object_code import ObjectSource, load_object

CALLS = """
declare double @imported(double)
define double @twice(double %x) {
  %y = call double @imported(double %x)
  %z = fadd double %y, %y
  ret double %z
}
define double @half(double %x) {
  %y = fmul double %x, 0.5
  ret double %y
}
"""
COPIES = """
declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
define void @copy(ptr %to, ptr %from, i64 %size) {
  call void @llvm.memcpy.p0.p0.i64(ptr %to, ptr %from, i64 %size, i1 false)
  ret void
}
"""


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("BEAMDAE_NATIVE", raising=False)
    monkeypatch.setattr(errors, "_issued_messages", set())
    return tmp_path / "beamdae"


def function_of_number(address):
    return ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(address)


def constant_function(value):
    return f"define double @value(double %x) {{\n  ret double {value:e}\n}}\n"


def test_functions_called_by_the_compiler_are_available():
    code = LoadedObject(compile_module(COPIES, 1), ["copy"])
    copy = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)(
        code.addresses["copy"]
    )
    source, target = (ctypes.create_string_buffer(1000) for _ in range(2))
    source.value = b"x" * 999
    copy(target, source, 1000)
    assert target.value == b"x" * 999


@pytest.mark.slow(reason="a quarter of a second")
def test_objects_with_equal_symbols_have_independent_lifetimes():
    codes = [LoadedObject(compile_module(constant_function(k), 0), ["value"]) for k in range(20)]
    for k in range(0, 20, 2):
        codes[k] = None
    gc.collect()
    for k in range(1, 20, 2):
        assert function_of_number(codes[k].addresses["value"])(0.0) == k


@pytest.mark.parametrize("ir", ["nonsense", "define double @f(double %x) {\n ret float 0.0\n}"])
def test_invalid_ir_is_rejected(ir):
    with pytest.raises(MachineCodeError, match=r"LLVM cannot compile the module \(.+\)"):
        compile_module(ir, 1)


def test_missing_symbols_are_rejected(capfd):
    content = compile_module(CALLS, 1)
    with pytest.raises(MachineCodeError, match=r"LLVM cannot load the machine code \(.*twice"):
        LoadedObject(content, ["twice"])
    with pytest.raises(MachineCodeError, match=r"LLVM cannot load the machine code \(.*nothing"):
        LoadedObject(content, ["nothing"], {"imported": library_address("exp")})
    with pytest.raises(MachineCodeError, match="the C library has no function fourier"):
        library_address("fourier")
    assert capfd.readouterr() == ("", "")


def test_system_that_forbids_executable_memory_is_reported(monkeypatch):
    def forbidden():
        raise OSError(13, "cannot allocate executable memory")

    monkeypatch.setattr(llvmlite.binding, "check_jit_execution", forbidden)
    with pytest.raises(MachineCodeError, match="forbids running code from memory"):
        llvm._engine.__wrapped__()


def test_code_of_any_origin_is_cached(cache, monkeypatch):
    source = ObjectSource("calls", CALLS, ("half", "twice"), {"imported": library_address("exp")})
    first = load_object(source, lambda code: function_of_number(code.addresses["half"])(3.0) == 1.5)
    assert set(first.addresses) == {"half", "twice"}
    assert [file.name.split("-")[0] for file in cache.iterdir()] == ["calls"]
    monkeypatch.setattr(llvm, "compile_module", None)
    again = load_object(source, lambda code: False)
    assert function_of_number(again.addresses["twice"])(0.0) == 2.0


def test_ir_that_cannot_be_compiled_falls_back(cache):
    with pytest.warns(KernelWarning, match="LLVM cannot compile the module"):
        assert load_object(ObjectSource("none", "nonsense", ("f",)), lambda code: True) is None
    assert list(cache.iterdir()) == []
