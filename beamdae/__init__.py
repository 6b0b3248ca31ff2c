"""beamdae: flexible multibody systems with curved beams; IDA, Radau and generalized-alpha.

The public names are listed in `catalog`; each is imported when it is first used. Classes that
functions return are in `results`, and quantities that `optimize` and `gradient` evaluate in
`quantities`.
"""

import os
import sys
from typing import Any

# `python -m beamdae` puts the working folder first; a file there called inspect.py would run.
if (
    sys.argv[:1] == ["-m"]
    and not sys.flags.safe_path
    and sys.path[0] != os.path.dirname(os.path.dirname(__file__))
):
    del sys.path[0]

import lazy_loader

from beamdae.catalog import NAMES, PACKAGES, attributes_by_module
from beamdae.errors import explain_arguments, suggest
from beamdae.interrupts import interruptible

_load, __dir__, __all__ = lazy_loader.attach(
    __name__, submodules=set(PACKAGES), submod_attrs=attributes_by_module()
)
__version__ = "0.1.0"
# Interrupts are raised after the import.
_import = interruptible(_load)


def __getattr__(name: str) -> Any:
    if name in __all__:
        value = explain_arguments(_import(name))
        # Later accesses do not call this function.
        globals()[name] = value
        return value
    public = NAMES.get(name)
    hint = f" (it is {public.path})" if public else suggest(name, __all__)
    # With `name`, Python would add the same suggestion to the traceback.
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}{hint}", name=None)
