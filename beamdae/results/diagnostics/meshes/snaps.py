"""Warnings about motions of beams that snap, which depend on the elements.

A shallow arch that snaps through, or almost does, passes unstable states. Small errors of the limit
load then change the time of the snap and the motion after it by far more than the state under a
given load. Errors are therefore not estimated: such a run is repeated with halved elements.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from beamdae.beams.beam import Beam, beams_of
from beamdae.beams.dispersion import section_values
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import format_count, name_with_others
from beamdae.results.diagnostics.meshes.beam_ranges import BeamDoubt
from beamdae.results.diagnostics.meshes.coarse_elements import evaluate_forces, headers_of_sections
from beamdae.results.diagnostics.meshes.refined_runs import (
    RunAgain,
    RunChanges,
    is_short,
    refine_run,
)
from beamdae.results.diagnostics.meshes.sampled_vibrations import rotation_coordinates
from beamdae.results.diagnostics.unstable_symmetry import find_least_stable
from beamdae.results.run_data import RunData
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Smallest change with a warning, and largest number of elements of beams that are halved. Of 54
# runs of arches, frames and buckled strips that snap, with errors of up to 99 %, 16 of 22 with 3 or
# 4 elements have errors of over 2 %, and 3 of 18 with 7 or 8. Changes by halved elements are 0.8 to
# 1.1 times the errors up to 50 %. The last number applies to runs that are too long to repeat.
_MAX_ERROR, _MAX_ELEMENTS, _FEW_ELEMENTS = 0.02, 16, 4
# Vibrations about states that are almost unstable have smaller errors: those of 3 arches at 0.75 to
# 0.9 of the limit load are off by 2 to 5 % with 5 elements. Smallest eigenvalue of the stiffness
# relative to that at the start, from which on they are not compared, and numbers of elements that
# are; `element_errors` compares fewer ones.
_SOFTENED, _SOFT_ELEMENTS = 0.5, range(3, 7)
# Compressive force by which beams buckle, over EI / L^2 with the length L of all beams: pi^2 / 4
# for a cantilever, more for all other supports.
_MIN_LOAD = 0.25 * np.pi**2
_SAMPLES = 96  # states whose compressive forces are evaluated
_PARTS = 4  # of the run, in which the stability of the most compressed state is examined
_MIN_BENDING = 0.5  # rotations within a beam, relative to the largest one of an unstable motion
_MAX_COORDINATES = 300  # of dense matrices


def snap_warnings(run: RunData, run_again: RunAgain | None) -> Iterator[str]:
    """Yield a warning if columns of a run in which a beam snaps change with halved elements.

    Of beams with few elements, vibrations about almost unstable states are compared, too. A run in
    which a beam snaps, and which is too long to repeat, has a warning if a beam has few elements.

    Parameters
    ----------
    run
        The run.
    run_again
        Function that repeats the run with other equations, or returns None if it fails; None if
        the run cannot be repeated.
    """
    e = run.equations
    all_beams = beams_of(e.mechanism)
    limit = _MAX_ELEMENTS if is_short(run) else _FEW_ELEMENTS
    if run_again is None or e.n > _MAX_COORDINATES:
        return
    if all(x.mesh.elements > limit for x in all_beams):
        return
    if not run._energy_ledger.force.scale > _MIN_LOAD * _buckling_unit(all_beams):
        return
    snap, motion, unnamed = find_snap(e, run.trajectory), "through unstable states", set[str]()
    numbers = range(1, limit + 1)
    if snap is None and is_short(run) and any(x.mesh.elements in _SOFT_ELEMENTS for x in all_beams):
        snap, motion = find_snap(e, run.trajectory, _SOFTENED), "near unstable states"
        numbers, unnamed = _SOFT_ELEMENTS, headers_of_sections(e)
    beams = [] if snap is None else [x for x in snap.beams if x.mesh.elements in numbers]
    if snap is None or not beams:
        return
    if not is_short(run):
        yield (
            f"{_describe(snap.t, beams, motion, 'may be')}, and the run is too long to repeat it "
            f"with halved elements; compare with {_recommend(beams)}."
        )
        return
    finer = refine_run(run, run_again, halved=[x.name for x in beams])
    if finer is None:
        return
    changes = RunChanges.measure(run, finer.run)
    if max((changes.errors[x] for x in changes.errors if x not in unnamed), default=0) > _MAX_ERROR:
        halved = [x for x in beams if x.name in finer.halved]
        cause, remedy = _describe(snap.t, halved, motion), f"use {_recommend(halved)}"
        doubt = BeamDoubt(halved[0].name, cause, "with halved elements", lambda _: remedy)
        yield from changes.describe(doubt, run_again, unnamed)


def _buckling_unit(beams: Sequence[Beam]) -> float:
    """Return EI / L^2 [N] with the smallest stiffness and the length of all beams."""
    stiffness = min(float(np.min(section_values(x, "EI"))) for x in beams)
    return stiffness / sum(x.length for x in beams) ** 2


def _describe(t: float, beams: Sequence[Beam], motion: str, verb: str = "") -> str:
    few = min(x.mesh.elements for x in beams)
    name, *others = (x.name for x in beams)
    return (
        f"{name_with_others(name, others)}: {format_count(few, 'element')} "
        f"{verb or ('is' if few == 1 else 'are')} too few for a motion {motion} "
        f"(as at t = {t:.4g} s)"
    )


def _recommend(beams: Sequence[Beam]) -> str:
    return f"elements={2 * beams[0].mesh.elements}" if len(beams) == 1 else "twice the elements"


class Snap(NamedTuple):
    """Instability of beams in a run, or a state that is almost unstable.

    Attributes
    ----------
    t
        First of the examined times in such a state [s].
    beams
        The beams that the least stable motion bends.
    """

    t: float
    beams: list[Beam]


def find_snap(
    equations: EquationsOfMotion, trajectory: Trajectory, softened: float = 0.0
) -> Snap | None:
    """Return an instability of beams in a run; None if there is none.

    A motion x that the joints allow is unstable if x^T (K + s C + s^2 M) x < 0 with the stiffness K
    at rest in the positions of the run, and s = 1 / (duration of the run). Motions of mechanisms
    that do not bend beams, such as those of pendulums, are no snaps. A few states with the largest
    compressive forces of beams are examined.

    Parameters
    ----------
    equations, trajectory
        The equations of motion and the steps of the run.
    softened
        Smallest eigenvalue of states that are not found, relative to that at the start.
    """
    duration = trajectory.end - trajectory.start
    if not duration > 0.0:
        return None
    beams, intervals = beams_of(equations.mechanism), trajectory.intervals
    step = 1 + sum(len(x.nodes) for x in intervals) // _SAMPLES
    times, positions = (
        np.concatenate([x[::step] for x in rows])
        for rows in ([x.nodes for x in intervals], [x.rows.q for x in intervals])
    )
    loads = np.zeros(len(times))
    for _, forces in evaluate_forces(equations, positions):
        compression = -np.min(forces[..., 0], axis=(1, 2))
        loads = np.maximum(loads, compression / _buckling_unit(beams))
    limit, rate = 0.0, 1.0 / duration
    if softened > 0.0:
        first = find_least_stable(equations, trajectory, trajectory.start, rate)
        # Motions that do not bend beams depend on the inertia.
        if first is None or not _find_bent_beams(equations, first.shape):
            return None
        limit = softened * first.eigenvalue
    for part in np.array_split(np.arange(len(times)), min(_PARTS, len(times))):
        k = part[np.argmax(loads[part])]
        if loads[k] > _MIN_LOAD:
            t = float(times[k])
            motion = find_least_stable(equations, trajectory, t, rate, only_unstable=limit <= 0.0)
            if motion is not None and motion.eigenvalue < limit:
                bent = _find_bent_beams(equations, motion.shape)
                if bent:
                    return Snap(t, bent)
    return None


def _find_bent_beams(equations: EquationsOfMotion, shape: Array) -> list[Beam]:
    """Return the beams that a motion (n,) bends, and does not only move."""
    largest = np.max(np.abs(shape[equations.is_angle]), initial=0.0)
    bent = []
    for beam in beams_of(equations.mechanism):
        rotations = shape[rotation_coordinates(equations, beam)]
        if len(rotations) > 1 and np.ptp(rotations) > _MIN_BENDING * largest:
            bent.append(beam)
    return bent
