"""Quantities that `optimize` minimizes and limits and `gradient` differentiates.

May import: nothing; the names are imported when they are first used, see `catalog`.
To extend: add an entry with the package "quantities" to `catalog`.
"""

import lazy_loader

from beamdae.catalog import attributes_by_module

__getattr__, __dir__, __all__ = lazy_loader.attach(
    "beamdae", submod_attrs=attributes_by_module("quantities")
)
