"""Repetition of runs with more accurate beams."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.parts.mechanism import AS_DRAWN, EQUILIBRIUM
from beamdae.results.run_data import RunData
from beamdae.results.trajectory import Trajectory

if TYPE_CHECKING:
    from beamdae.equations.assembly.refined_beams import RefinedBeams

# Repeats a run with other equations, given a similar motion with their coordinates.
RunAgain = Callable[[EquationsOfMotion, Trajectory], RunData | None]

# Steps times coordinates of runs that are repeated, which takes up to about two seconds.
_MAX_WORK = 2e5


class RefinedRun(NamedTuple):
    """Run with more accurate beams.

    Attributes
    ----------
    run
        The run.
    exact, halved
        Names of the beams with exact strains and with halved elements.
    """

    run: RunData
    exact: tuple[str, ...]
    halved: tuple[str, ...]


def is_short(run: RunData) -> bool:
    """Return True if a run is short enough to repeat, and has no laws with a memory."""
    e = run.equations
    return not e.controllers and run.trajectory.steps * e.n <= _MAX_WORK


def refine_run(
    run: RunData,
    run_again: RunAgain,
    *,
    exact: Collection[str] = (),
    halved: Collection[str] = (),
) -> RefinedRun | None:
    """Repeat a short run from t = 0 with exact strains and halved elements of the named beams.

    Returns None if the run is long or has sampled controllers, whose laws may have a memory, if no
    beam can be refined, or if the run fails.

    Parameters
    ----------
    run
        The run.
    run_again
        Function that repeats the run with other equations, given a similar motion with their
        coordinates, or returns None if it fails.
    exact, halved
        Names of beams.
    """
    if not is_short(run):
        return None
    # Imported here because few runs need it, and the import slows the start of the others.
    from beamdae.equations.assembly.refined_beams import refine_beams

    start = EQUILIBRIUM if run.start.request == EQUILIBRIUM else AS_DRAWN
    refined = refine_beams(run.equations, exact=exact, halved=halved, start=start)
    if refined is None:
        return None
    equations = refined.equations
    if start == AS_DRAWN:
        first = run.trajectory.intervals[0].rows
        q, v = (refined.prolongation @ x[0] for x in (first.q, first.v))
        equations = replace(equations, q0=refined.start + q, v0=v)
    other = run_again(equations, _prolong(run.trajectory, refined))
    return None if other is None else RefinedRun(other, refined.exact, refined.halved)


def _prolong(trajectory: Trajectory, refined: RefinedBeams) -> Trajectory:
    """Return the positions and velocities of a motion in the coordinates of refined beams."""
    matrix, intervals = refined.prolongation, []
    for interval in trajectory.intervals:
        q, v, *others = interval.rows
        rows = State(refined.start + (matrix @ q.T).T, (matrix @ v.T).T, *others)
        intervals.append(replace(interval, rows=rows))
    return Trajectory(tuple(intervals))
