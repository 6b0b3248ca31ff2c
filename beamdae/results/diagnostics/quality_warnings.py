"""What of a run is not to be trusted by its own books: energies, forces, columns."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.results.diagnostics.energy_balance import EnergyLedger

# From this share of the energy turned over on a run is doubtful, and where it leaves the other one
# of the largest force for more than this share of the time: single steps do so, those after a load
# that is there at once and those through a singular position, up to 0.8 % of published cases.
_IMBALANCE, _RESIDUAL, _TIME = 0.1, 0.5, 0.05
# What moves by less than this share of its size is at rest.
_AT_REST = 1e-9

_REMEDY = (
    "take a tenth of rtol or a smaller step, or another integrator, and look for loads and "
    "positions near which something becomes infinite"
)


def quality_warnings(
    equations: EquationsOfMotion,
    books: EnergyLedger,
    observed: Mapping[str, np.ndarray],
    times: np.ndarray,
) -> Iterator[str]:
    """A sentence on each of the energy balance, the equations of motion and the columns.

    Energies and forces that a mechanism at rest is full of by rounding alone are none.
    """
    energy, force = books.energy, books.force
    if not energy.share <= _IMBALANCE:
        yield (
            f"energy: its balance is off by {_percent(energy.share)} of the energy turned over, "
            f"so the motion is not to be trusted; {_REMEDY}."
        )
    at_rest = _AT_REST * energy.largest / equations.length
    time_off = books.time_off(max(_RESIDUAL * force.scale, at_rest))
    if time_off > _TIME:
        yield (
            f"forces: the equations of motion are off by more than half the largest force for "
            f"{_percent(time_off)} of the time, so accelerations, reactions and section forces are "
            f"not to be trusted; {_REMEDY}."
        )
    for name in observed:
        (bad,) = np.nonzero(~np.isfinite(observed[name]))
        if len(bad):
            yield (
                f"{name}: it is not finite at {len(bad)} of {len(times)} times, from "
                f"t = {times[bad[0]]:.6g} s; check what is observed, and numbers of the model that "
                "are very large or very small."
            )


def _percent(share: float) -> str:
    return f"{100.0 * share:.3g} %"
