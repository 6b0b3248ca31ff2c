"""Integrators: frozen settings with `integrate(equations, times) -> Solution`; a folder a method.

May import: results, equations, linear, symbolic, native; SUNDIALS in `ida` alone.
Next: an `Integrator` whose `integrate` passes its method, which takes the steps, to `drive`.
"""

from beamdae.integrators.alpha.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.auto import Auto
from beamdae.integrators.ida.ida import Ida
from beamdae.integrators.integrator import Integrator
from beamdae.integrators.radau.radau import Radau

__all__ = ["Auto", "GeneralizedAlpha", "Ida", "Integrator", "Radau"]
