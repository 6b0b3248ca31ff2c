"""How far one solution is from another: the error measure of studies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from beamdae.errors import BeamdaeError, nearest
from beamdae.solution import Solution

# Columns that move less than this share of the largest motion in their unit are held by a joint.
_AT_REST = 1e-6


def compared_columns(reference: Solution, columns: Sequence[str] = ()) -> list[str]:
    """The observed columns errors are taken over.

    `columns` if given; otherwise all in m and rad, or all there are if none has such a unit, that
    move by more than 1e-6 of the largest motion in the same unit.
    """
    observed = reference.observed
    present = [str(name) for name in observed]
    for name in columns:
        if name not in present:
            raise BeamdaeError(
                f"compare: no observed column {name!r}{nearest(name, present)}, "
                f"the columns are {', '.join(present) or 'none'}."
            )
    candidates = list(columns) or [c for c in present if c.endswith(("[m]", "[rad]"))]
    candidates = candidates or present
    if not candidates:
        raise BeamdaeError("compare: the model must observe something, see Mechanism.observe.")
    amplitude = pd.Series(np.ptp(observed[candidates].to_numpy(), axis=0), candidates)
    largest = amplitude.groupby(lambda name: name.rsplit("[", 1)[-1]).transform("max")
    moving = amplitude > (0.0 if columns else _AT_REST) * largest
    if not moving.any() or (columns and not moving.all()):
        still = ", ".join(amplitude.index[~moving])
        raise BeamdaeError(f"compare: {still} must move in the reference to measure errors by.")
    return list(amplitude.index[moving])


def deviation(solution: Solution, reference: Solution, columns: Sequence[str] = ()) -> pd.DataFrame:
    """|x - x_ref| over half the range of x_ref, of the compared columns, by time.

    At the output times of `solution` that both have reached; the amplitude is that of the whole
    reference.
    """
    names = compared_columns(reference, columns)
    amplitude = 0.5 * np.ptp(reference.observed[names].to_numpy(), axis=0)
    t = solution.t[solution.t <= reference.trajectory.end * (1.0 + 1e-12)]
    known = reference if np.array_equal(t, reference.t) else replace(reference, t=t)
    missing = [name for name in names if name not in solution.observed]
    if missing:
        raise BeamdaeError(f"compare: {missing[0]} of the reference is not observed in a case.")
    found = solution.observed[names].to_numpy()[: len(t)]
    error = np.abs(found - known.observed[names].to_numpy()) / amplitude
    return pd.DataFrame(error, columns=names, index=pd.Index(t, name="t [s]"))
