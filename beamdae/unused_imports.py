"""Deferred import of modules of NumPy that SciPy imports, but beamdae does not use."""

from __future__ import annotations

import importlib.util
import sys

# 0.1 s of the 0.28 s of processor time that the imports of SciPy take.
_UNUSED_NUMPY_MODULES = (
    *("numpy.f2py", "numpy.testing", "numpy.core", "numpy.char", "numpy.ctypeslib"),
)


def defer_unused_imports() -> None:
    """Replace unused modules of NumPy, unless imported already, by modules that load on access.

    Only commands call this: `sys.modules` belongs to the process, also to a user's script.
    """
    import numpy as np

    for name in _UNUSED_NUMPY_MODULES:
        spec = None if name in sys.modules else importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            spec.loader = importlib.util.LazyLoader(spec.loader)
            module = importlib.util.module_from_spec(spec)
            sys.modules[name] = module
            spec.loader.exec_module(module)
            setattr(np, name.rpartition(".")[-1], module)
