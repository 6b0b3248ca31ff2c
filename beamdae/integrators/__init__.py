"""Integrators with `integrate(equations, times) -> Solution`; methods in `alpha`, `ida`, `radau`.

May import: results and everything below; only `ida` imports sundials.
To extend: subclass `Integrator`; its `integrate` passes `drive` a function that makes a `Method`.
"""

from beamdae.integrators.alpha.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.auto import Auto
from beamdae.integrators.ida.ida import Ida
from beamdae.integrators.integrator import Integrator
from beamdae.integrators.radau.radau import Radau

__all__ = ["Auto", "GeneralizedAlpha", "Ida", "Integrator", "Radau"]
