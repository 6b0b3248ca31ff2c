"""Integrators: small frozen settings with `integrate(equations, times) -> Solution`."""

from beamdae.integrators.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.ida import Ida
from beamdae.integrators.radau import Radau

__all__ = ["GeneralizedAlpha", "Ida", "Radau"]
