"""Range of the natural frequencies about a state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from beamdae.analysis.eigenproblems.linearized_equations import LinearizedEquations
from beamdae.analysis.eigenproblems.slow_motions import MasslessError, solve_undamped
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import compute_tangent

Array = np.ndarray


class FrequencyRange(NamedTuple):
    """Range of the undamped natural frequencies about a state.

    Attributes
    ----------
    lowest, highest
        Lowest and highest natural frequency [Hz]; None if nothing vibrates.
    damping_ratio
        Damping ratio of the mode with the highest frequency [-]; 0 if nothing vibrates.
    growth
        Clause on the fastest growth from the start, or "".
    massless
        Name of a coordinate without inertia, because of which nothing else is known; or "".
    """

    lowest: float | None = None
    highest: float | None = None
    damping_ratio: float = 0.0
    growth: str = ""
    massless: str = ""


def compute_frequency_range(e: EquationsOfMotion, time: Array, state: State) -> FrequencyRange:
    """Return the range of undamped natural frequencies about a consistent state.

    Constraints must be independent. First-order states are constant and do not count as free
    motions. The computing time grows with the cube of the number of coordinates.
    """
    tangent = compute_tangent(e, time, state)
    try:
        squares, shapes = solve_undamped(LinearizedEquations(e, tangent), None)
    except MasslessError as error:
        return FrequencyRange(massless=error.coordinate)
    rates, growth = np.sqrt(squares[squares > 0.0]), ""
    if np.any(squares < 0.0):
        rate = np.sqrt(np.max(-squares))
        growth = f"a motion grows from the start at a rate of {rate:.3g} 1/s"
    if not len(rates):
        return FrequencyRange(growth=growth)
    fastest = shapes[:, -1]
    ratio = float(fastest @ (tangent.damping @ fastest) / (2.0 * rates[-1]))
    lowest, highest = (rates[[0, -1]] / (2.0 * np.pi)).tolist()
    return FrequencyRange(lowest, highest, ratio, growth)
