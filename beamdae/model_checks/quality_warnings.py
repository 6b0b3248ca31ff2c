"""Warnings about runs whose energy balance, residual or columns are unreliable."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.failure_diagnosis import STARTING_STEPS, list_moving_drivers
from beamdae.errors import format_percent, list_first
from beamdae.results.energy_balance import EnergyLedger

# Imbalances relative to the energy exchanged, in the run or over a few steps. In 257 random drops
# and in runs of 50 mechanisms by `GeneralizedAlpha` (steps of 1 and 3 ms), errors of peak forces,
# velocities and rebound heights were up to three times the imbalance. With contacts and suddenly
# loaded beams (15 runs that warn), errors at single times were 2 to 190 % of half the range of a
# velocity, up to five times that of a force, and 0.4 to 70 % of that of a position.
_MAX_ENERGY_IMBALANCE = 0.02
_MAX_RELIABLE_IMBALANCE = 0.1  # from here on, the whole motion is doubtful
_MAX_RESIDUAL = 0.5  # relative to the largest force
# Fraction of the run during which the residual may be larger. Single steps exceed the limit after a
# sudden load and at singular positions; in published cases such steps take up to 0.008 of the run.
_MAX_TIME_ABOVE_RESIDUAL = 0.05
# Share of the imbalance after the first steps up to which it belongs to these: 4e-3 to 0.17 for
# drivers of leaf springs that start with a velocity (measured).
_MAX_LATER_SHARE = 0.2
_MAX_NAMES = 3
_REST_TOLERANCE = 1e-9  # forces below this multiple of energy / length are rounding noise

_REMEDY = (
    "reduce rtol or the step by a factor of ten, try another integrator, and check "
    "for loads or positions that become infinite"
)


def balance_warnings(equations: EquationsOfMotion, energy_ledger: EnergyLedger) -> Iterator[str]:
    """Yield one warning per failed check of the energy balance and the residual.

    Parameters
    ----------
    equations
        The equations of motion.
    energy_ledger
        Energies, works and residuals of the run.
    """
    energy, force = energy_ledger.energy, energy_ledger.force
    local = energy_ledger.local_energy
    # `not <=` rather than `>`, so that an imbalance of nan is reported.
    is_balanced = energy.ratio <= _MAX_ENERGY_IMBALANCE
    drivers: list[str] = []
    if not is_balanced or local.ratio > _MAX_ENERGY_IMBALANCE:
        drivers = _list_causes_at_start(equations, energy_ledger)
    if drivers:
        ratio = local.ratio if is_balanced else energy.ratio
        yield (
            f"energy: the first steps change the energy by {format_percent(ratio, 3)} of the "
            f"energy exchanged, because {list_first(drivers, _MAX_NAMES)} starts with a velocity; "
            "there, velocities and forces may be wrong by tens of percent, while the energy is "
            "balanced later. Start the law smoothly, as bd.run_up does, or reduce the step."
        )
    elif not is_balanced:
        consequence = "the motion is unreliable"
        if energy.ratio <= _MAX_RELIABLE_IMBALANCE:
            consequence = (
                "velocities and forces may be wrong by tens of percent, and positions by several "
                "percent"
            )
        yield (
            f"energy: the energy imbalance is {format_percent(energy.ratio, 3)} of the energy "
            f"exchanged, so {consequence}; {_REMEDY}."
        )
    elif local.ratio > _MAX_ENERGY_IMBALANCE:
        yield (
            f"energy: around t = {local.time:.4g} s, the energy imbalance changes by "
            f"{format_percent(local.ratio, 3)} of the energy exchanged there, as in an impact of "
            f"few steps, so velocities and forces may be wrong by tens of percent; {_REMEDY}."
        )
    rounding = _REST_TOLERANCE * energy.largest_term / equations.length
    time_above = energy_ledger.time_above(max(_MAX_RESIDUAL * force.scale, rounding))
    if time_above > _MAX_TIME_ABOVE_RESIDUAL:
        yield (
            "forces: the residual of the equations of motion exceeds half the largest force during "
            f"{format_percent(time_above, 3)} of the run, so accelerations, reactions and section "
            f"forces are unreliable; {_REMEDY}."
        )


def _list_causes_at_start(equations: EquationsOfMotion, energy_ledger: EnergyLedger) -> list[str]:
    """Return the names of drivers that start with a velocity if only the first steps are off."""
    later = energy_ledger.imbalance_after(STARTING_STEPS)
    if not later <= _MAX_LATER_SHARE * energy_ledger.energy.ratio:
        return []
    start = np.array([energy_ledger.trajectory.start, 0.0])
    return list_moving_drivers(equations, start, equations.q0)


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
