"""Start of Python processes, in which no file of the working folder replaces a module."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

# Python would put the working folder first on the import path.
SAFE_PATH = "-P"


@contextmanager
def isolated_processes() -> Iterator[None]:
    """Let processes that multiprocessing starts in this block run neither files nor the program.

    They do not import modules from the working folder, and do not run the main program.
    """
    # Browsers lack this package.
    from multiprocessing import util

    flags, main = util._args_from_interpreter_flags, sys.modules["__main__"]  # type: ignore[attr-defined]
    util._args_from_interpreter_flags = lambda: [*flags(), SAFE_PATH]  # type: ignore[attr-defined]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
        util._args_from_interpreter_flags = flags  # type: ignore[attr-defined]
