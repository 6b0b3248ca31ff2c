"""Integrators with `integrate(equations, times) -> Solution`: `alpha`, `ida`, `radau`.

May import: results and everything below; only `ida` imports sundials.
To extend: subclass `Integrator`; its `method_on` returns the `Method` that takes the steps.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from beamdae.integrators.alpha.generalized_alpha import GeneralizedAlpha
    from beamdae.integrators.auto import Auto
    from beamdae.integrators.ida.ida import Ida
    from beamdae.integrators.integrator import Integrator
    from beamdae.integrators.radau.radau import Radau

__all__ = ["Auto", "GeneralizedAlpha", "Ida", "Integrator", "Radau"]

# Imported when first used, because a run needs only one method.
_MODULES = {
    "Auto": "auto",
    "GeneralizedAlpha": "alpha.generalized_alpha",
    "Ida": "ida.ida",
    "Integrator": "integrator",
    "Radau": "radau.radau",
}


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
