"""Deferred import of modules of NumPy that SciPy imports, but beamdae does not use."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from types import ModuleType
from typing import Any

# 0.1 s of the 0.28 s of processor time that the imports of SciPy take.
_UNUSED_NUMPY_MODULES = (
    *("numpy.f2py", "numpy.testing"),
    *("numpy.core", "numpy.char", "numpy.ctypeslib"),
)
# Names in further unused modules that NumPy and SciPy access nevertheless, for example in
# `np.unique` and in annotations. Until such a module is loaded, no array is masked, and no object
# is a random generator.
_PLACEHOLDERS: dict[str, dict[str, Any]] = {
    "numpy.ma": dict.fromkeys(("is_masked", "isMaskedArray"), lambda x: False),
    "numpy.random": {name: type(name, (), {}) for name in ("Generator", "RandomState")},
}


def defer_unused_imports() -> None:
    """Replace unused modules of NumPy, unless imported already, by modules that load on access.

    Only commands call this: `sys.modules` belongs to the process, also to a user's script.
    """
    import numpy as np

    for name in (*_UNUSED_NUMPY_MODULES, *_PLACEHOLDERS):
        if name in sys.modules:
            continue
        known = _PLACEHOLDERS.get(name)
        module = _create_lazy_module(name) if known is None else _create_substitute(name, known)
        if module is not None:
            sys.modules[name] = module
            setattr(np, name.rpartition(".")[-1], module)


def _create_lazy_module(name: str) -> ModuleType | None:
    """Return a module that is loaded when an attribute is accessed; None if there is none."""
    spec = importlib.util.find_spec(name)
    if spec is None or spec.loader is None:
        return None
    spec.loader = importlib.util.LazyLoader(spec.loader)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _create_substitute(name: str, placeholders: dict[str, Any]) -> ModuleType:
    """Return a module that is loaded when an attribute other than the placeholders is accessed."""
    substitute: Any = ModuleType(name)
    vars(substitute).update(placeholders)

    def load(attribute: str) -> Any:
        if sys.modules.get(name) is substitute:
            del sys.modules[name]
        module = importlib.import_module(name)
        vars(substitute).update(vars(module))
        return getattr(module, attribute)

    substitute.__getattr__ = load
    return substitute
