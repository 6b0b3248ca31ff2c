"""Faster first import of SciPy."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

# Half of the processor time that the imports of SciPy take.
_UNUSED_MODULES = ("char", "core", "ctypeslib", "f2py", "ma", "rec", "testing")
# By default, new threads of OpenBLAS wait for work without sleeping for 2^26 cycles, 30 ms of each
# core. Products of matrices in sequence take the same time with 2^20 cycles.
_THREAD_TIMEOUT = ("OPENBLAS_THREAD_TIMEOUT", "20")

_is_timeout_set = False  # in the environment, by this module


def shorten_thread_timeout() -> None:
    """Let idle threads of BLAS libraries sleep sooner, until the next `fast_scipy_import` ends.

    This includes the threads of NumPy, if a script imports beamdae before NumPy.
    """
    if "numpy" not in sys.modules:
        _set_thread_timeout()


@contextmanager
def fast_scipy_import() -> Iterator[None]:
    """Shorten the first import of SciPy, in a `with` block, to half of the processor time.

    Idle threads of the BLAS libraries that are loaded in the block sleep sooner. The import of
    unused modules of NumPy is deferred. After the block, NumPy, `sys.modules` and the environment
    contain nothing else than without it.
    """
    with _short_thread_timeout(), _deferred_modules():
        yield


@contextmanager
def _short_thread_timeout() -> Iterator[None]:
    """Set the timeout of threads of the BLAS libraries that are loaded in a `with` block."""
    # scipy.linalg loads the library; scipy.sparse does not.
    if "scipy.linalg" not in sys.modules:
        _set_thread_timeout()
    try:
        yield
    finally:
        _restore_thread_timeout()


def _set_thread_timeout() -> None:
    global _is_timeout_set
    name, cycles = _THREAD_TIMEOUT
    if name not in os.environ:
        os.environ[name] = cycles
        _is_timeout_set = True


def _restore_thread_timeout() -> None:
    global _is_timeout_set
    if _is_timeout_set:
        os.environ.pop(_THREAD_TIMEOUT[0], None)
        _is_timeout_set = False


@contextmanager
def _deferred_modules() -> Iterator[None]:
    """Use stand-ins of unused modules among the attributes of NumPy in a `with` block.

    SciPy copies all attributes of NumPy, and NumPy imports a module when its attribute is read.
    SciPy therefore receives modules that import the actual ones when they are used.
    """
    if "scipy" in sys.modules:
        yield
        return
    import numpy as np

    attributes: dict[str, Any] = vars(np)
    stand_ins = {x: _create_stand_in(f"numpy.{x}") for x in _UNUSED_MODULES if x not in attributes}
    attributes.update(stand_ins)
    try:
        yield
    finally:
        for name, module in stand_ins.items():
            # The import of the actual module has replaced the attribute.
            if attributes.get(name) is module:
                del attributes[name]


def _create_stand_in(name: str) -> ModuleType:
    """Return a module that reads its attributes from the module `name`, imported on first use."""
    module: Any = ModuleType(name)
    module.__getattr__ = lambda attribute: getattr(import_module(name), attribute)
    return module
