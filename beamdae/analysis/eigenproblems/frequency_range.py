"""Range of the natural frequencies about a state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.analysis.eigenproblems.linearized_equations import LinearizedEquations
from beamdae.analysis.eigenproblems.slow_motions import MasslessError, solve_undamped_without_states
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import compute_tangent

Array = np.ndarray


@dataclass(frozen=True)
class FrequencyRange:
    """Range of the undamped natural frequencies about a state.

    If a coordinate has no inertia, nothing is computed: the frequencies are None, and the other
    numbers are 0.

    Attributes
    ----------
    lowest, highest
        Lowest and highest natural frequency [Hz]; None if nothing vibrates.
    damping_ratio
        Damping ratio of the mode with the highest frequency [-]; 0 if nothing vibrates.
    loose
        Number of free motions.
    growth_rate
        Largest growth rate of unstable motions [1/s], or 0.
    massless
        Name of a coordinate without inertia; "" if there is none.
    """

    lowest: float | None
    highest: float | None
    damping_ratio: float
    loose: int
    growth_rate: float
    massless: str

    def describe_growth(self) -> str:
        """Return a clause on the fastest growth from the start, or ""."""
        if not self.growth_rate > 0.0:
            return ""
        return f"a motion grows from the start at a rate of {self.growth_rate:.3g} 1/s"


def compute_frequency_range(e: EquationsOfMotion, time: Array, state: State) -> FrequencyRange:
    """Return the range of undamped natural frequencies about a consistent state.

    Constraints must be independent. First-order states are constant and do not count as free
    motions. The computing time grows with the cube of the number of coordinates.
    """
    tangent = compute_tangent(e, time, state)
    try:
        squares, shapes = solve_undamped_without_states(LinearizedEquations(e, tangent), None)
    except MasslessError as error:
        return FrequencyRange(None, None, 0.0, 0, 0.0, error.coordinate)
    rates = np.sqrt(squares[squares > 0.0])
    ratio = 0.0
    if len(rates):
        fastest = shapes[:, -1]
        ratio = float(fastest @ (tangent.damping @ fastest) / (2.0 * rates[-1]))
    hertz = rates / (2.0 * np.pi)
    return FrequencyRange(
        float(hertz[0]) if len(rates) else None,
        float(hertz[-1]) if len(rates) else None,
        ratio,
        int(np.sum(squares == 0.0)),
        float(np.sqrt(np.max(-squares, initial=0.0))),
        "",
    )
