"""Validity range of beam strain measures: largest deformations and the resulting errors."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, log

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.results.trajectory import Trajectory

MAX_UNREPORTED_ERROR = 0.01  # relative error of the deformation above which a beam is reported
_MAX_PREDICTED_ERROR = 0.5  # beyond this, predictions of the error are meaningless
# Ratio of the errors after and before splitting a beam in half;
# validation/strain_validity/run.py measures 0.05 to 0.3.
_ERROR_AFTER_HALVING = 0.2
_SAMPLE_COUNT = 400  # number of times at which beams are checked


@dataclass(frozen=True)
class BeamRange:
    """Largest deformation of a beam relative to its floating frame.

    Attributes
    ----------
    name
        Name of the beam.
    deflection
        Largest displacement relative to the undeformed beam in its frame, over the beam length [-].
    rotation
        Largest section rotation relative to the frame [rad].
    strain
        Largest axial strain at the outer fibers of a rectangular section, including bending [-].
    error
        Predicted relative error of the deformation due to the strain measure. None if the strain
        measure does not limit the rotation. Measured errors of a single beam (see validation/)
        range from a thirtieth of this value in pure bending to three times this value and
        are smaller for one of several welded beams.
    remedies
        Settings of the beam that reduce the error, as alternatives to splitting the beam.
    """

    name: str
    deflection: float
    rotation: float
    strain: float
    error: float | None = None
    remedies: tuple[str, ...] = ()

    @property
    def warning(self) -> str | None:
        """Warning if the predicted error exceeds 1 %, otherwise None."""
        if self.error is None or self.error <= MAX_UNREPORTED_ERROR:
            return None
        consequence = "the deformation is wrong"
        if self.error < _MAX_PREDICTED_ERROR:
            consequence = f"the error of the deformation is about {100 * self.error:.2g} %"
        reduction = MAX_UNREPORTED_ERROR / min(self.error, _MAX_PREDICTED_ERROR)
        bodies = 2 ** ceil(log(reduction) / log(_ERROR_AFTER_HALVING))
        settings = "".join(f", or set {remedy}" for remedy in self.remedies)
        return (
            f"{self.name}: the beam bends {self.rotation:.2g} rad away from the "
            f"floating frame (deflection {self.deflection:.2g} of the length), where "
            f"{consequence}; split the beam with bd.welded_beams(..., "
            f"bodies={bodies}){settings}."
        )


def measure_beam_ranges_of_run(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> tuple[BeamRange, ...]:
    """Return the largest deformation of each beam over a run, sampled at 400 times."""
    if not equations.ranges:
        return ()
    # Sampled at equally spaced times because the steps of Radau may be too long.
    times = np.linspace(trajectory.intervals[0].t[0], trajectory.end, _SAMPLE_COUNT)
    _, state = trajectory.at(np.unique(times))
    return measure_beam_ranges(equations, state.q)


def measure_beam_ranges(equations: EquationsOfMotion, q: np.ndarray) -> tuple[BeamRange, ...]:
    """Return the largest deformation of each beam over coordinates q (k, n)."""
    ranges = []
    for term in equations.ranges:
        statement = term.statement
        deflection, rotation, strain = map(float, term.largest_deformation(q))
        error = None
        if statement.error is not None:
            error = statement.error[0] * rotation + statement.error[1] * rotation**2
        ranges.append(
            BeamRange(statement.part, deflection, rotation, strain, error, statement.remedies)
        )
    return tuple(ranges)
