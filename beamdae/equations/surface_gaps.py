"""Gaps between points and surfaces of penalty forces, evaluated for many states at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.assembly.observables import CompiledQuantity, compile_quantities
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.structure import cache_on_owner

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class SurfaceGapTerm:
    """Gap of one part, negative inside the surface.

    Attributes
    ----------
    part
        Name of the part.
    distance
        The compiled gap [m].
    lengths
        Upper bound on the displacement [m] of the point per unit of each coordinate, (n,); 0 for
        coordinates on which the gap does not depend.
    length
        Characteristic length of the mechanism [m].
    """

    part: str
    distance: CompiledQuantity
    lengths: Array
    length: float

    def evaluate(self, t: Array, branch: float, q: Array) -> Array:
        """Return the gap [m], (rows,), at times `t` (rows,) on one branch and `q` (rows, n)."""
        # Gaps depend on positions only.
        return self.distance.rows(np.column_stack([t, np.full(len(t), branch)]), q, q)[:, 0]

    def bound_rates(self, v: Array, a: Array) -> tuple[Array, Array]:
        """Return upper bounds on relative speeds [m/s] and accelerations [m/s^2] at the gap.

        The arguments are velocities and accelerations of the coordinates, (rows, n); the results
        have the shape (rows,).
        """
        speeds, accelerations = (np.abs(x) @ self.lengths for x in (v, a))
        return speeds, accelerations + speeds**2 / self.length


@cache_on_owner
def compile_surface_gaps(equations: EquationsOfMotion) -> tuple[SurfaceGapTerm, ...]:
    """Return the gaps of all parts, active or not; an empty tuple for a constrained system."""
    mechanism = equations.mechanism
    if mechanism is None:
        return ()
    gaps = [(part.name, gap.quantity) for part in mechanism.parts.values() for gap in part.gaps]
    lengths = equations.length / equations.position_scales
    return tuple(
        SurfaceGapTerm(
            part,
            gap,
            np.asarray(abs(gap.observable.operator).sum(axis=0)).ravel() * lengths,
            equations.length,
        )
        for (part, _), gap in zip(gaps, compile_quantities(mechanism, gaps), strict=True)
    )
