"""Whether the beams of a run stayed where their strains hold."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, log

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.results.trajectory import Trajectory

# From this error of its deformation on a beam is warned of.
LEAST_ERROR = 0.01
# What is left of the error of a beam that is cut in half (validation/reach/run.py): 0.05 to 0.3.
_LEFT_BY_HALVING = 0.2
# Predictions say little beyond this.
_MOST_ERROR = 0.5
_ROWS = 400


@dataclass(frozen=True)
class BeamRange:
    """How far a beam went from its floating frame, over a run.

    Attributes
    ----------
    name
        Of the beam.
    deflection
        Largest displacement relative to the undeformed beam in its frame, over its length [-].
    rotation
        Largest section rotation relative to the frame [rad].
    strain
        Largest axial strain with that of bending at the outer fibers of a rectangle [-].
    error
        What the strains of the beam make of that: error of its deformation relative to itself;
        None if they have no limit. Measured (see validation/): up to three times as much for a
        single beam, down to a thirtieth in pure bending, less for one of several welded together.
    remedies
        What helps besides cutting it into several bodies, as settings of the beam.
    """

    name: str
    deflection: float
    rotation: float
    strain: float
    error: float | None = None
    remedies: tuple[str, ...] = ()

    @property
    def warning(self) -> str | None:
        """A sentence, if its strains are not good for so much."""
        if self.error is None or self.error <= LEAST_ERROR:
            return None
        worth = f"off by about {100 * self.error:.2g} %" if self.error < _MOST_ERROR else "wrong"
        bodies = 2 ** ceil(log(LEAST_ERROR / min(self.error, _MOST_ERROR)) / log(_LEFT_BY_HALVING))
        settings = "".join(f", or set {remedy}" for remedy in self.remedies)
        return (
            f"{self.name}: it bends {self.rotation:.2g} rad away from its floating frame "
            f"({self.deflection:.2g} of its length), where its strains make the deformation "
            f"{worth}: cut it into {bodies} with bd.welded_beams(..., bodies={bodies}){settings}."
        )


def measure_beam_ranges_of_run(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> tuple[BeamRange, ...]:
    """How far each beam went, over some hundreds of the times of a run."""
    if not equations.ranges:
        return ()
    # Between steps as well: those of Radau are long.
    start = trajectory.intervals[0].t[0]
    _, state = trajectory.at(np.unique(np.linspace(start, trajectory.end, _ROWS)))
    return measure_beam_ranges(equations, state.q)


def measure_beam_ranges(equations: EquationsOfMotion, q: np.ndarray) -> tuple[BeamRange, ...]:
    """How far each beam went, over rows of coordinates."""
    found = []
    for term in equations.ranges:
        said = term.statement
        deflection, rotation, strain = map(float, term.largest(q))
        error = None
        if said.error is not None:
            error = said.error[0] * rotation + said.error[1] * rotation**2
        found.append(BeamRange(said.part, deflection, rotation, strain, error, said.remedies))
    return tuple(found)
