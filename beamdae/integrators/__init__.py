"""Integrators with `integrate(equations, times) -> Solution`; one folder per method.

May import: results, equations, linear, symbolic, native; SUNDIALS in `ida` alone.
To extend: subclass `Integrator`; its `integrate` passes a `Method`, which takes steps, to `drive`.
"""

from beamdae.integrators.alpha.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.auto import Auto
from beamdae.integrators.ida.ida import Ida
from beamdae.integrators.integrator import Integrator
from beamdae.integrators.radau.radau import Radau

__all__ = ["Auto", "GeneralizedAlpha", "Ida", "Integrator", "Radau"]
