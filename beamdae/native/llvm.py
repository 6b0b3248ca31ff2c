"""LLVM: IR to objects, objects to addresses.

Where IR comes from does not matter: kernels of `lanes`, or what another compiler printed.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Container, Iterable, Mapping
from functools import cache
from itertools import count
from types import MappingProxyType
from typing import Any

from beamdae.errors import format_exception

_library_numbers = count()


class MachineCodeError(Exception):
    """Machine code that cannot be had; the message names what fails and says why."""


@cache
def describe_target() -> tuple[str, ...]:
    """What an object depends on besides IR and level: system, processor and compiler.

    Raises
    ------
    MachineError
        If there is no compiler.
    """
    llvmlite = _llvmlite()
    llvm = llvmlite.binding
    cpu, features = _host()
    version = ".".join(map(str, llvm.llvm_version_info))
    return (llvm.get_process_triple(), cpu, features, f"llvmlite {llvmlite.__version__}", version)


def compile_module(ir: str, level: int) -> bytes:
    """The object of a module of LLVM IR, for this machine.

    Parameters
    ----------
    level
        Of optimization, as in O1: 0 for IR that needs none.

    Raises
    ------
    MachineError
        If LLVM cannot compile it.
    """
    llvm = _llvmlite().binding
    try:
        target = _target()
        # Of its own context, which goes with it: the global one keeps every constant.
        module = llvm.parse_assembly(ir, llvm.create_context())
        module.data_layout = str(target.target_data)
        module.verify()
        options = llvm.create_pipeline_tuning_options(level)
        passes = llvm.create_pass_builder(target, options)
        passes.getModulePassManager().run(module, passes)
        return bytes(target.emit_object(module))
    except RuntimeError as problem:
        raise MachineCodeError(f"LLVM cannot compile kernels ({_first_line(problem)})") from problem


def link_modules(texts: Iterable[str], wanted: Container[str]) -> str:
    """One module of LLVM IR of several; of their functions only those wanted have to stay.

    Raises
    ------
    MachineError
        If two of them have something of one name, or what is no IR.
    """
    llvm = _llvmlite().binding
    try:
        context = llvm.create_context()
        whole, *others = (llvm.parse_assembly(text, context) for text in texts)
        for other in others:
            whole.link_in(other)
    except RuntimeError as problem:
        raise MachineCodeError(f"LLVM cannot link loops ({_first_line(problem)})") from problem
    for function in whole.functions:
        is_open = not function.is_declaration and function.linkage == llvm.Linkage.external
        if is_open and function.name not in wanted:
            function.linkage = "linkonce_odr"
    return str(whole)


class LoadedObject:
    """An object in memory; its code stays there as long as this does.

    Attributes
    ----------
    addresses
        By name, of the symbols that were asked for.
    """

    def __init__(
        self,
        content: bytes,
        names: Iterable[str],
        imports: Mapping[str, int] = MappingProxyType({}),
    ) -> None:
        """Load what `compile_module` made, in this or an earlier process, and nothing else.

        LLVM ends the process over bytes that are no object.

        Parameters
        ----------
        names
            Symbols of it whose addresses are wanted.
        imports
            Addresses of symbols it takes from outside, besides those of the process itself.

        Raises
        ------
        MachineError
            If a symbol is missing, or nothing may be executed from memory.
        """
        llvm, engine = _llvmlite().binding, _engine()
        builder = llvm.JITLibraryBuilder().add_object_img(content).add_current_process()
        for name, address in imports.items():
            builder.import_symbol(name, address)
        for name in names:
            builder.export_symbol(name)
        try:
            # A library of its own each: objects may have symbols of the same name.
            library = builder.link(engine, f"{next(_library_numbers)}")
        except RuntimeError as problem:
            raise MachineCodeError(
                f"LLVM cannot load kernels ({_first_line(problem)})"
            ) from problem
        self.addresses = {name: int(library[name]) for name in names}
        # The library is released before the engine it is part of.
        self._library, self._engine = library, engine


@cache
def library_address(name: str) -> int:
    """Where the process has a function of its mathematical C library, the one CasADi calls.

    Raises
    ------
    MachineError
        If it has none.
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
            pass  # Not of GNU: then it is part of the C library, which every process has.
    return ctypes.CDLL(None)


def _llvmlite() -> Any:
    try:
        import llvmlite.binding
    # The latter of a library of it that is not there.
    except (ImportError, OSError) as problem:
        raise MachineCodeError(
            f"llvmlite cannot be imported ({format_exception(problem)})"
        ) from problem
    return llvmlite


@cache
def _host() -> tuple[str, str]:
    llvm = _llvmlite().binding
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


@cache
def _target() -> Any:
    llvm = _llvmlite().binding
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    cpu, features = _host()
    target = llvm.Target.from_triple(llvm.get_process_triple())
    return target.create_target_machine(
        cpu=cpu, features=features, opt=1, codemodel="jitdefault", jit=True
    )


@cache
def _engine() -> Any:
    llvm = _llvmlite().binding
    try:
        llvm.check_jit_execution()
        return llvm.create_lljit_compiler(_target(), suppress_errors=True)
    except OSError as problem:
        raise MachineCodeError("this system executes nothing that was not installed") from problem
    except RuntimeError as problem:
        raise MachineCodeError(f"LLVM cannot load kernels ({_first_line(problem)})") from problem


def _first_line(problem: BaseException) -> str:
    return str(problem).strip().split("\n", 1)[0]
