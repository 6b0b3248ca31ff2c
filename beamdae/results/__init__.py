"""Results of runs and analyses: solution, section forces, equilibria, files.

May import: equations and the layers below; drawing code only through `deferred`.
To extend: add quantities of a run as methods of `Solution`.

The classes that functions of beamdae return are `bd.results.<name>`, see `catalog`.
"""

from functools import partial

from beamdae.catalog import NAMES, load_name

__all__ = [public.name for public in NAMES.values() if public.package == "results"]
__getattr__ = partial(load_name, "results")


def __dir__() -> list[str]:
    return __all__
