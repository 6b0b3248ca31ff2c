"""Integrators with `integrate(equations, times) -> Solution`; one folder per method.

May import: results, equations, parts, linear, symbolic, native; only `ida` imports SUNDIALS.
To extend: subclass `Integrator`; its `integrate` passes `drive` a function that makes a `Method`.
"""

from beamdae.integrators.alpha.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.auto import Auto
from beamdae.integrators.ida.ida import Ida
from beamdae.integrators.integrator import Integrator
from beamdae.integrators.radau.radau import Radau

__all__ = ["Auto", "GeneralizedAlpha", "Ida", "Integrator", "Radau"]
