"""Results of runs and analyses: solution, section forces, equilibria, files.

May import: equations and the layers below; drawing code only through `deferred`.
To extend: add quantities of a run as methods of `Solution`.

The classes that functions of beamdae return are `bd.results.<name>`, see `catalog`.
"""

import lazy_loader

from beamdae.catalog import attributes_by_module

__getattr__, __dir__, __all__ = lazy_loader.attach(
    "beamdae", submod_attrs=attributes_by_module("results")
)
