"""Gaps between points and surfaces of penalty forces, evaluated for many states at once."""

from __future__ import annotations

from typing import NamedTuple

from beamdae.equations.assembly.observables import CompiledQuantity, compile_quantities
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.structure import cache_on_owner


class SurfaceGapTerm(NamedTuple):
    """Name of a part, and its compiled gap [m], which is negative inside the surface."""

    part: str
    distance: CompiledQuantity


@cache_on_owner
def compile_surface_gaps(equations: EquationsOfMotion) -> tuple[SurfaceGapTerm, ...]:
    """Return the gaps of all parts, active or not; an empty tuple for a constrained system."""
    mechanism = equations.mechanism
    if mechanism is None:
        return ()
    gaps = [(part.name, gap.quantity) for part in mechanism.parts.values() for gap in part.gaps]
    names, compiled = (name for name, _ in gaps), compile_quantities(mechanism, gaps)
    return tuple(map(SurfaceGapTerm, names, compiled))
