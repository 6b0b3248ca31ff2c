"""Random mechanisms by three integrators: each ends with a reason, and those that end agree."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from tolerances.random_cases import STILL, RandomCase, random_case
from tolerances.tolerance_case import deviations

import beamdae as bd
from beamdae.verification import exceeded

RTOL, TIME_LIMIT = 1e-4, 20.0
# A mechanism takes three runs, and an estimate of those that disagree without a word.
LIMIT = 300.0
COUNT, THINNED = 200, 10
# What bd.verify allows two methods to differ by, over rtol, and where the books have to close.
AGREED, CLOSED = 100.0, 0.1
INTEGRATORS: dict[str, Callable[[], bd.Integrator]] = {
    "Auto": lambda: bd.Auto(RTOL, time_limit=TIME_LIMIT),
    "Radau": lambda: bd.Radau(RTOL, time_limit=TIME_LIMIT),
    "GeneralizedAlpha": lambda: bd.GeneralizedAlpha(rtol=RTOL, time_limit=TIME_LIMIT),
}


@dataclass(frozen=True)
class Line:
    """What became of a mechanism by one integrator.

    `apart` is over rtol, of the worst column; `warnings` are those of errors, not of strains.
    """

    seed: int
    integrator: str
    status: str
    reason: str
    imbalance: float
    apart: float
    warnings: str
    wall: float
    complaint: str


def see_seed(name: str) -> list[Line]:
    """The lines of a seed."""
    case, seed = random_case(int(name)), int(name)
    solutions: dict[str, bd.Solution | str] = {}
    for method, integrator in INTEGRATORS.items():
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", bd.BeamdaeWarning)
                solutions[method] = case.run(integrator())
        except Exception as problem:  # Whatever it is, it is not right.
            solutions[method] = f"{type(problem).__name__}: {problem}"[:200]
    apart = _apart(case, {m: s for m, s in solutions.items() if isinstance(s, bd.Solution)})
    return [_line(seed, method, s, apart.get(method, np.nan)) for method, s in solutions.items()]


def _apart(case: RandomCase, solutions: dict[str, bd.Solution]) -> dict[str, float]:
    """How far each method is from the nearest other one, over rtol.

    The nearest: of three the one that is off is told, and not the two that agree.
    """
    ended = {m: case.observed(s) for m, s in solutions.items() if s.status.success}
    apart = dict.fromkeys(ended, np.inf if len(ended) > 1 else np.nan)
    for first, second in combinations(ended, 2):
        moving = np.ptp(ended[first], axis=0) > STILL
        rows, others = ended[first][:, moving], ended[second][:, moving]
        found = float(np.max(deviations(rows, others), initial=0.0)) / RTOL
        for method in (first, second):
            apart[method] = min(apart[method], found)
    return apart


def _line(seed: int, method: str, solution: bd.Solution | str, apart: float) -> Line:
    if isinstance(solution, str):
        return Line(seed, method, "raised", solution, np.nan, apart, "", np.nan, "it raised")
    # That a beam bends too far for its strains says nothing of the integrator.
    bending = {beam.warning for beam in solution.validity}
    told = " ".join(w for w in solution.warnings if w not in bending)
    imbalance = solution.quality.energy_imbalance
    if solution.status.success and apart > AGREED and not told:
        told = exceeded(solution, bd.error_estimate(solution))
    status, wall = solution.status, solution.statistics.wall_time
    why = complaint(status.kind, status.sentence, imbalance, apart, told)
    return Line(seed, method, status.kind, status.sentence, imbalance, apart, told, wall, why)


def complaint(kind: str, reason: str, imbalance: float, apart: float, told: str) -> str:
    """Why a run is not right; nothing if it is."""
    if kind != "ok":
        return "" if kind in ("failed", "limited") and reason else f"it ended {kind}, {reason!r}"
    if not imbalance < CLOSED and not told:
        return f"energies do not close, by {imbalance:.2g}, without a warning"
    if apart > AGREED and not told:
        return f"{apart:.3g} rtol from the other methods without a warning"
    return ""


def lost(name: str, died: bool) -> Line:
    """The line of a seed whose process died, or did not end."""
    why = "it crashed" if died else "it hung"
    return Line(int(name), "", "", "", np.nan, np.nan, "", np.nan, why)
