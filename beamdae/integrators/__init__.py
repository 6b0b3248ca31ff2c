"""Integrators: small frozen settings with `integrate(equations, times) -> Solution`."""

from beamdae.integrators.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.ida import Ida

__all__ = ["GeneralizedAlpha", "Ida"]
