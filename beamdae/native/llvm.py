"""LLVM: compilation of IR to objects, and loading of objects into memory."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from itertools import count
from types import MappingProxyType
from typing import Any, NamedTuple

from beamdae.errors import format_exception

_library_numbers = count()

# Levels of x86-64 processors in ascending order, with the features (names of LLVM) that each adds
# to the one before. System V Application Binary Interface, AMD64 supplement, section 3.1.1.
_X86_LEVELS = {
    "x86-64-v2": {"cx16", "popcnt", "sahf", "sse3", "sse4.1", "sse4.2", "ssse3"},
    "x86-64-v3": {"avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe"},
    "x86-64-v4": {"avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl"},
}
X86_LEVELS = tuple(_X86_LEVELS)


class MachineCodeError(Exception):
    """Raised if machine code is unavailable; the message gives the reason."""


class Target(NamedTuple):
    """System and processor for which LLVM compiles, in the terms of LLVM."""

    triple: str
    cpu: str
    features: str = ""


@cache
def host_target() -> Target:
    """Return the target of this machine.

    All x86-64 processors of a level share one target, so that objects can be compiled on another
    machine. Elsewhere, the target is the processor of this machine.

    Raises
    ------
    MachineCodeError
        If llvmlite is missing.
    """
    llvm = _llvmlite().binding
    triple, features = llvm.get_process_triple(), llvm.get_host_cpu_features()
    available = {name for name, is_available in features.items() if is_available}
    target = Target(triple, llvm.get_host_cpu_name(), features.flatten())
    if triple.startswith("x86_64"):
        for cpu, added_features in _X86_LEVELS.items():
            if not added_features <= available:
                break
            target = Target(triple, cpu)
    return target


@cache
def describe_target() -> tuple[str, ...]:
    """Return the system, processor and compiler on which compiled objects depend.

    Raises
    ------
    MachineCodeError
        If llvmlite is missing.
    """
    llvmlite = _llvmlite()
    version = ".".join(map(str, llvmlite.binding.llvm_version_info))
    return (*host_target(), f"llvmlite {llvmlite.__version__}", version)


def compile_module(ir: str, level: int, target: Target | None = None) -> bytes:
    """Compile a module of LLVM IR to an object.

    Parameters
    ----------
    ir
        Text of the module.
    level
        Optimization level, as in O1; 0 for IR that needs no passes.
    target
        Machine that runs the object. Defaults to this machine.

    Raises
    ------
    MachineCodeError
        If llvmlite is missing or LLVM cannot compile the module.
    """
    llvm = _llvmlite().binding
    try:
        machine = _target_machine(target or host_target())
        # The context is released with the module; the global context would keep every constant.
        module = llvm.parse_assembly(ir, llvm.create_context())
        module.data_layout = str(machine.target_data)
        module.verify()
        options = llvm.create_pipeline_tuning_options(level)
        passes = llvm.create_pass_builder(machine, options)
        passes.getModulePassManager().run(module, passes)
        return bytes(machine.emit_object(module))
    except RuntimeError as problem:
        raise MachineCodeError(
            f"LLVM cannot compile the module ({_first_line(problem)})"
        ) from problem


class LoadedObject:
    """Object code in memory; it stays loaded as long as this instance exists.

    Parameters
    ----------
    content
        Object that `compile_module` returned in this or an earlier process. LLVM aborts the process
        if the bytes are not a valid object.
    names
        Exported symbols.
    imports
        Addresses of symbols that the object imports, besides symbols of the process.

    Attributes
    ----------
    addresses
        Addresses of the exported symbols by name.

    Raises
    ------
    MachineCodeError
        If llvmlite or a symbol is missing, or the system forbids executing code from memory.
    """

    def __init__(
        self,
        content: bytes,
        names: Iterable[str],
        imports: Mapping[str, int] = MappingProxyType({}),
    ) -> None:
        llvm, engine = _llvmlite().binding, _engine()
        builder = llvm.JITLibraryBuilder().add_object_img(content).add_current_process()
        for name, address in imports.items():
            builder.import_symbol(name, address)
        for name in names:
            builder.export_symbol(name)
        try:
            # One library per object, as objects may have symbols of the same name.
            library = builder.link(engine, f"{next(_library_numbers)}")
        except RuntimeError as problem:
            raise MachineCodeError(
                f"LLVM cannot load the machine code ({_first_line(problem)})"
            ) from problem
        self.addresses = {name: int(library[name]) for name in names}
        # In this order the library is released before its engine.
        self._library, self._engine = library, engine

    def __deepcopy__(self, memo: Any) -> LoadedObject:
        """Return this object: copies of models share machine code, which cannot be copied."""
        return self


@cache
def library_address(name: str) -> int:
    """Return the address of a function of the C math library that CasADi calls.

    Raises
    ------
    MachineCodeError
        If the library cannot be loaded or has no such function.
    """
    try:
        return int(ctypes.cast(getattr(_math_library(), name), ctypes.c_void_p).value or 0)
    except (AttributeError, OSError) as problem:
        raise MachineCodeError(f"the C library has no function {name}") from problem


@cache
def _math_library() -> ctypes.CDLL:
    if sys.platform == "win32":
        return ctypes.CDLL("ucrtbase")
    if sys.platform.startswith("linux"):
        try:
            return ctypes.CDLL("libm.so.6")
        except OSError:
            pass  # Without glibc, the functions are part of the C library of the process.
    return ctypes.CDLL(None)


def _llvmlite() -> Any:
    try:
        import llvmlite.binding
    # OSError: its shared library is missing.
    except (ImportError, OSError) as problem:
        raise MachineCodeError(
            f"llvmlite cannot be imported ({format_exception(problem)})"
        ) from problem
    return llvmlite


@cache
def _target_machine(target: Target) -> Any:
    llvm = _llvmlite().binding
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_triple(target.triple).create_target_machine(
        cpu=target.cpu, features=target.features, opt=1, codemodel="jitdefault", jit=True
    )


@cache
def _engine() -> Any:
    llvm = _llvmlite().binding
    try:
        llvm.check_jit_execution()
        return llvm.create_lljit_compiler(_target_machine(host_target()), suppress_errors=True)
    except OSError as problem:
        raise MachineCodeError("this system forbids running code from memory") from problem
    except RuntimeError as problem:
        raise MachineCodeError(
            f"LLVM cannot load the machine code ({_first_line(problem)})"
        ) from problem


def _first_line(problem: BaseException) -> str:
    return str(problem).strip().split("\n", 1)[0]
