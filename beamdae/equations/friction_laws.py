"""Laws of the friction of all parts."""

from __future__ import annotations

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.parts.forces.regularized_friction import RegularizedFriction


def friction_laws(equations: EquationsOfMotion) -> dict[str, RegularizedFriction]:
    """Return the laws of all parts with friction, by name; none for a constrained system."""
    parts = {} if equations.mechanism is None else equations.mechanism.parts
    return {
        name: law
        for name, part in parts.items()
        if (law := getattr(part, "regularized_friction", None)) is not None and law.coefficient
    }
