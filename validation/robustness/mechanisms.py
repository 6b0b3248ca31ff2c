"""Random mechanisms: runs with default settings are accurate, or warn, or end with a reason.

Mechanisms are those of `tests/properties`, half of them with an event. Two tight runs with short
steps are the references. Mechanisms on which they disagree, because the motion is chaotic or
discontinuous, are not judged.
"""

import warnings
from collections.abc import Callable
from random import Random
from typing import NamedTuple

import numpy as np
from properties.random_drawings import draw_mechanism
from properties.run_laws import (
    build_with_observations,
    distant_points,
    max_relative_difference,
)

import beamdae as bd

RTOL = 1e-5  # of all runs: the default of the adaptive integrators
MAX_ERROR = 100.0  # over rtol, of positions and angles; the guaranteed bound of undamped models
MAX_ENERGY_IMBALANCE = 0.1  # relative to the energy exchanged
SEED_COUNT = 300
INTEGRATORS: dict[str, Callable[..., bd.Integrator]] = {
    "Auto": bd.Auto,
    "Ida": bd.Ida,
    "Radau": bd.Radau,
    "GeneralizedAlpha": lambda rtol, **limits: bd.GeneralizedAlpha(rtol=rtol, **limits),
}
_RUN_TIME_LIMIT, _REFERENCE_TIME_LIMIT = 10.0, 30.0  # s
# Steps of the references: they do not pass over short contacts and crossings.
_MIN_REFERENCE_STEPS = 1000
_ROWS = 400  # of a run
_LARGE_ERROR = 0.04  # of columns that runs name
# Parts of warnings that do not concern the errors of the integration.
_OTHER_WARNINGS = ("output rows miss", "where its value is held")
_MAX_DISAGREEMENT = 0.1 * MAX_ERROR * RTOL  # of two references
_EVENT_SHARE = 0.5


class Run(NamedTuple):
    """Outcome of a run.

    Attributes
    ----------
    ended, reason
        Kind of the status and its sentence.
    warnings
        Warnings about errors of the integration.
    imbalance
        Energy imbalance.
    error
        Largest error of positions and angles over rtol; NaN without a reference.
    """

    ended: str
    reason: str = ""
    warnings: str = ""
    imbalance: float = 0.0
    error: float = np.nan


def build_mechanism(seed: int) -> bd.Mechanism:
    """Return the random mechanism of a seed."""
    rng = Random(seed)
    drawing = draw_mechanism(rng)
    mech = build_with_observations(drawing)
    if rng.random() < _EVENT_SHARE:
        name, point = rng.choice(list(distant_points(drawing, mech).items()))
        axis = rng.randrange(2)
        value = float(point.point[axis]) + rng.uniform(-0.3, 0.3)
        add_event = rng.choice((_release, _catch, _rebound))
        add_event(mech, rng, point, f"{name}.{'xy'[axis]}", value)
    return mech


Point = bd.results.Attachment


def _release(mech: bd.Mechanism, rng: Random, point: Point, column: str, value: float) -> None:
    """Let an event deactivate a spring."""
    x, y = point.point
    anchor = mech.ground.at(x + rng.uniform(0.2, 0.8), y + rng.uniform(0.2, 0.8))
    spring = mech.add(bd.Spring("released", anchor, point, 10.0 ** rng.uniform(0.5, 2.5)))
    mech.when(column, value, "both", do=bd.deactivate(spring), name="release")


def _catch(mech: bd.Mechanism, rng: Random, point: Point, column: str, value: float) -> None:
    """Let an event hold a point at its distance from the ground."""
    x, y = point.point
    anchor = mech.ground.at(x + rng.uniform(0.5, 1.0), y + rng.uniform(0.5, 1.0))
    link = mech.add(bd.Distance("link", anchor, point))
    mech.deactivate(link)
    mech.when(column, value, "both", do=bd.activate(link, as_is=True), name="catch")


def _rebound(mech: bd.Mechanism, rng: Random, point: Point, column: str, value: float) -> None:
    """Let a point rebound from a line below it."""
    x, y = point.point
    gap = bd.LineSurface(mech.ground.at(x, y - rng.uniform(0.05, 0.5))).gap(point)
    action = bd.impact(gap, restitution=rng.uniform(0.5, 1.0))
    mech.when(gap, 0.0, "down", do=action, name="rebound")


def end_time(seed: int) -> float:
    """Return the end time of the mechanism of a seed [s]."""
    return round(Random(-seed - 1).uniform(0.4, 1.5), 2)


def list_names() -> list[str]:
    """Return all seeds."""
    return [str(seed) for seed in range(SEED_COUNT)]


def try_name(name: str) -> list[str | None]:
    """Return the complaint about the run of each integrator; None if it cannot be judged."""
    seed, limits = int(name), {"time_limit": _RUN_TIME_LIMIT}
    try:
        bd.equations_of_motion(build_mechanism(seed))
    except bd.BeamdaeError:  # Parts of random mechanisms may contradict each other.
        return [None]
    reference = _compute_reference(seed)
    complaints: list[str | None] = []
    # One run at a time: each may have millions of steps, and its refined repetition even more.
    for method, make in INTEGRATORS.items():
        solution = _simulate(seed, make(RTOL, **limits))
        status, error = solution.status, np.nan
        if status.success and reference is not None:
            error = max_relative_difference(solution, reference) / RTOL
        imbalance = solution.quality.energy_imbalance
        run = Run(status.kind, status.sentence, describe_warnings(solution), imbalance, error)
        complaint = find_run_complaint(run)
        if complaint:
            complaints.append(f"{method}: {complaint}")
        else:
            complaints.append(None if status.success and reference is None else "")
    return complaints


def _simulate(seed: int, integrator: bd.Integrator) -> bd.results.Solution:
    t_end = end_time(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        return bd.simulate(build_mechanism(seed), integrator, t_end, output_step=t_end / _ROWS)


def _compute_reference(seed: int) -> bd.results.Solution | None:
    """Return a reference with which another one agrees; None if there is none."""
    longest = end_time(seed) / _MIN_REFERENCE_STEPS
    limits = {"max_step": longest, "time_limit": _REFERENCE_TIME_LIMIT}
    first = _simulate(seed, bd.Radau(1e-8, **limits))
    if not first.status.success:
        return None
    for other in (bd.Ida(1e-8, **limits), bd.Radau(1e-10, **limits)):
        second = _simulate(seed, other)
        if second.status.success and max_relative_difference(second, first) <= _MAX_DISAGREEMENT:
            return first
    return None


def describe_warnings(solution: bd.results.Solution) -> str:
    """Return the warnings of a run that concern the errors of its integration.

    Warnings about output rows and the validity of laws do not, and neither do errors by elements
    and strains.
    """
    sentences = [x for x in solution.model_warnings if not any(y in x for y in _OTHER_WARNINGS)]
    unchecked = [x for x in solution.warnings if x.startswith("errors: not checked")]
    if unchecked:
        sentences += unchecked
    elif (solution.errors.table()["time"] > _LARGE_ERROR).any():
        sentences += solution.errors.sentences()
    return " ".join(sentences)


def find_run_complaint(run: Run) -> str:
    """Return the reason why a run is not accepted, or an empty text."""
    if run.ended != "ok":
        is_right = run.ended in ("failed", "limited") and run.reason
        return "" if is_right else f"it ended {run.ended}, {run.reason!r}"
    if run.warnings:
        return ""
    if not run.imbalance < MAX_ENERGY_IMBALANCE:
        return f"energies do not close, by {run.imbalance:.2g}, without a warning"
    if run.error > MAX_ERROR:
        return f"it is {run.error:.3g} rtol off without a warning"
    return ""
