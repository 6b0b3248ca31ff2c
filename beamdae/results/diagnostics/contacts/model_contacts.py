"""Contacts of a model, and their gaps during a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.surface_gaps import SurfaceGapTerm
from beamdae.results.trajectory import Trajectory

if TYPE_CHECKING:
    from beamdae.parts.forces.contact import Contact


def contacts_of(equations: EquationsOfMotion) -> dict[str, Contact]:
    """Return the contacts of the mechanism by name, without an import if there are none."""
    parts = {} if equations.mechanism is None else equations.mechanism.parts
    if not any(part.gaps for part in parts.values()):
        return {}
    from beamdae.parts.forces.contact import Contact

    return {name: part for name, part in parts.items() if isinstance(part, Contact)}


def gaps_of_run(gap: SurfaceGapTerm, trajectory: Trajectory) -> np.ndarray:
    """Return a gap [m] at the steps of a run at which its part is active, (k,)."""
    intervals = [x for x in trajectory.intervals if gap.part not in x.inactive]
    values = [gap.evaluate(x.t, x.branch, x.state.q) for x in intervals]
    return np.concatenate([np.zeros(0), *values])
