"""Warnings about runs whose energy balance or columns are unreliable."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from beamdae.errors import format_percent
from beamdae.results.energy_balance import EnergyLedger

_MAX_ENERGY_IMBALANCE = 0.02  # relative to the energy exchanged


def balance_warnings(energy_ledger: EnergyLedger) -> Iterator[str]:
    """Yield a warning if the energy of a run is not balanced."""
    ratio = energy_ledger.energy.ratio
    # `not <=` rather than `>`, so that an imbalance of nan is reported.
    if not ratio <= _MAX_ENERGY_IMBALANCE:
        yield (
            f"energy: the energy imbalance is {format_percent(ratio, 3)} of the energy exchanged, "
            "so velocities and forces may be wrong by tens of percent; reduce rtol or the step by "
            "a factor of ten, and check laws for jumps and for loads that become infinite."
        )


def column_warnings(
    observed: Mapping[str, np.ndarray], times: np.ndarray, is_unbounded: np.ndarray
) -> Iterator[str]:
    """Yield one warning per observed column that is not finite.

    Parameters
    ----------
    observed
        The observed columns (k,) by header.
    times
        Times (k,) of the rows [s].
    is_unbounded
        True in rows with unbounded reactions (k,), which have their own warning.
    """
    for name in observed:
        (rows,) = np.nonzero(~(np.isfinite(observed[name]) | is_unbounded))
        if len(rows):
            yield (
                f"{name}: this column is not finite at {len(rows)} of {len(times)} "
                f"times, first at t = {times[rows[0]]:.6g} s; check the observable and "
                "the model for very large or very small values."
            )
