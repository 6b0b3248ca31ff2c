"""Warnings about contacts that bounce because no dissipation is given."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.surface_gaps import SurfaceGapTerm, compile_surface_gaps
from beamdae.errors import name_with_others
from beamdae.model_checks.model_contacts import contacts_of, gaps_of_run
from beamdae.results.trajectory import Trajectory

_MIN_BOUNCES = 10  # a few of them may be impacts of a mechanism that moves on
# Of the deepest penetration: smaller gaps are oscillations about a static penetration that starts
# at the surface.
_MIN_OPENING = 1e-2


def elastic_bounce_warnings(equations: EquationsOfMotion, trajectory: Trajectory) -> Iterator[str]:
    """Yield one warning about contacts without `restitution` that open at least ten times.

    Parameters
    ----------
    equations
        The equations of motion.
    trajectory
        The steps of the run.
    """
    elastic = {name for name, x in contacts_of(equations).items() if x.restitution is None}
    counts = {
        gap.part: _count_openings(gap, trajectory)
        for gap in (compile_surface_gaps(equations) if elastic else ())
        if gap.part in elastic
    }
    names = sorted((x for x in counts if counts[x] >= _MIN_BOUNCES), key=lambda x: -counts[x])
    if not names:
        return
    first, *others = names
    yield (
        f"{name_with_others(first, others)}: the contact opens {counts[first]} times and "
        "dissipates no energy; pass restitution= and impact_speed=, or restitution=1 if elastic "
        "impacts are intended."
    )


def _count_openings(gap: SurfaceGapTerm, trajectory: Trajectory) -> int:
    """Return how often the gap opens after a penetration."""
    gaps = gaps_of_run(gap, trajectory)
    least = _MIN_OPENING * -float(np.min(gaps, initial=0.0))
    sides = np.sign(gaps[np.abs(gaps) > least])
    return int(np.count_nonzero((sides[:-1] < 0.0) & (sides[1:] > 0.0)))
