"""Tolerances of the multipliers of mechanisms whose motion joints and drivers prescribe."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from beamdae.integrators.error_control import MotionScales
from beamdae.integrators.run_plan import RunPlan

Array = np.ndarray

# Tolerance of multipliers: this multiple of rtol, within limits, relative to their largest values
# so far, or to a fraction of the force scale of the motion, if that is larger.
_TOLERANCE_FACTOR = 10.0
_TOLERANCES = (1e-6, 0.01)
_LEAST_FORCE_SHARE = 1e-2
_LEAST_FORCE = 1e-200  # avoids division by zero without any forces
# Forces may jump: shorter steps, relative to the time scale of the motion, are not tested.
_SHORTEST_TESTED_STEP = 1e-4


class MultiplierTolerances(NamedTuple):
    """Tolerances of the error test of multipliers, by default none.

    Attributes
    ----------
    weights
        Reciprocal tolerances of the multipliers, (m,), which fall as the multipliers grow; (0,) if
        they are not tested.
    tolerance
        Tolerance relative to the largest values.
    shortest_step
        Step [s] below which multipliers are not tested, because they may jump.
    """

    weights: Array = np.zeros(0)
    tolerance: float = 0.0
    shortest_step: float = math.inf


UNTESTED_MULTIPLIERS = MultiplierTolerances()


def plan_multiplier_tolerances(
    plan: RunPlan, scales: MotionScales, rtol: float
) -> MultiplierTolerances:
    """Return the tolerances of a run with `rtol`; none if there are free motions.

    If joints and drivers prescribe all motions, positions and velocities do not reveal errors of
    the multipliers.
    """
    equations = plan.equations
    if not equations.is_driven:
        return UNTESTED_MULTIPLIERS
    tolerance = float(np.clip(_TOLERANCE_FACTOR * rtol, *_TOLERANCES))
    arms = equations.length / equations.constraint_scales
    forces = np.maximum(_LEAST_FORCE_SHARE * scales.force * arms, _LEAST_FORCE)
    largest = np.maximum(np.abs(plan.state.lam), forces)
    shortest = _SHORTEST_TESTED_STEP / scales.rate
    return MultiplierTolerances(1.0 / (tolerance * largest), tolerance, shortest)
