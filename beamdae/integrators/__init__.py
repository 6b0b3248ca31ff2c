"""Integrators: frozen settings with `integrate(equations, times) -> Solution`, one file a method.

May import: results, equations, symbolic; SUNDIALS in `ida` alone.
Next: an `Integrator` whose `integrate` hands a `Method`, its step, to `drive`.
"""

from beamdae.integrators.alpha.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.auto import Auto
from beamdae.integrators.ida.ida import Ida
from beamdae.integrators.integrator import Integrator
from beamdae.integrators.radau.radau import Radau

__all__ = ["Auto", "GeneralizedAlpha", "Ida", "Integrator", "Radau"]
