"""Between which natural frequencies a mechanism lies at its start."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.analysis.linear.linearization import Linearization
from beamdae.analysis.modes.symmetric_problem import MasslessError, SymmetricProblem
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations import State
from beamdae.equations.tangents import tangent

Array = np.ndarray


@dataclass(frozen=True)
class Spectrum:
    """Natural frequencies at the start.

    Attributes
    ----------
    lowest, highest
        Of vibrations [Hz], or None where there are none.
    damping_ratio
        Of the fastest.
    loose
        Motions that nothing drives back.
    falling
        The fastest rate at which a motion leaves the start [1/s], or 0.
    massless
        The coordinate that moves without inertia, or "".
    """

    lowest: float | None
    highest: float | None
    damping_ratio: float
    loose: int
    falling: float
    massless: str


def spectrum(e: EquationsOfMotion, time: Array, state: State) -> Spectrum:
    """Natural frequencies about a consistent state, of the motions its joints allow.

    Constraints must not depend on each other.
    """
    own = tangent(e, time, state)
    try:
        squares, shapes = SymmetricProblem(Linearization(e, e, "start", time, state, own)).lowest(
            None
        )
    except MasslessError as problem:
        return Spectrum(None, None, 0.0, 0, 0.0, problem.coordinate)
    rates = np.sqrt(squares[squares > 0.0])
    ratio = 0.0
    if len(rates):
        fastest = shapes[:, -1]
        ratio = float(fastest @ (own.damping @ fastest) / (2.0 * rates[-1]))
    hertz = rates / (2.0 * np.pi)
    return Spectrum(
        float(hertz[0]) if len(rates) else None,
        float(hertz[-1]) if len(rates) else None,
        ratio,
        int(np.sum(squares == 0.0)),
        float(np.sqrt(np.max(-squares, initial=0.0))),
        "",
    )
