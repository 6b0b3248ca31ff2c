"""Quantities that `optimize` minimizes and limits and `gradient` differentiates.

May import: nothing; the names are imported when they are first used, see `catalog`.
To extend: add an entry with the package "quantities" to `catalog`.
"""

from functools import partial

from beamdae.catalog import NAMES, load_name

__all__ = [public.name for public in NAMES.values() if public.package == "quantities"]
__getattr__ = partial(load_name, "quantities")


def __dir__() -> list[str]:
    return __all__
