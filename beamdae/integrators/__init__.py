"""."""

from beamdae.integrators.generalized_alpha import GeneralizedAlpha
from beamdae.integrators.ida import Ida
from beamdae.integrators.integrator import Integrator
from beamdae.integrators.radau import Radau

__all__ = ["GeneralizedAlpha", "Ida", "Integrator", "Radau"]
