"""Deferred import of modules of NumPy that SciPy imports, but beamdae does not use."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from types import ModuleType
from typing import Any

# 0.1 s of the 0.28 s of processor time that the imports of SciPy take.
_UNUSED_NUMPY_MODULES = (
    *("numpy.f2py", "numpy.testing", "numpy.random"),
    *("numpy.core", "numpy.char", "numpy.ctypeslib"),
)
_MASKED_ARRAYS = "numpy.ma"


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
    if _MASKED_ARRAYS not in sys.modules:
        sys.modules[_MASKED_ARRAYS] = np.ma = _defer_masked_arrays()


def _defer_masked_arrays() -> ModuleType:
    """Return a substitute for `numpy.ma` that NumPy and SciPy can ask whether arrays are masked.

    Functions such as `np.unique` ask. No array is masked until the module itself is loaded, by any
    other access.
    """
    substitute: Any = ModuleType(_MASKED_ARRAYS)
    substitute.is_masked = substitute.isMaskedArray = lambda x: False

    def load(name: str) -> Any:
        if sys.modules.get(_MASKED_ARRAYS) is substitute:
            del sys.modules[_MASKED_ARRAYS]
        module = importlib.import_module(_MASKED_ARRAYS)
        vars(substitute).update(vars(module))
        return getattr(module, name)

    substitute.__getattr__ = load
    return substitute
