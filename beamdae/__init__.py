"""beamdae: curved beams in flexible multibody systems, on SUNDIALS IDA and generalized-alpha.

`__init__.pyi` lists the public names; each is imported when it is first used.
"""

import sys
from typing import Any

import lazy_loader

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    if name in __all__:
        return _load(name)
    # With these Python hints at the nearest name there is.
    where = sys.modules[__name__]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name, obj=where)
