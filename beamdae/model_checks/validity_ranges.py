"""Ranges of validity: of linear elasticity, tables, beams with sliding points, friction at rest."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from beamdae.beams.beam import Beam, beams_of
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.watched_terms import compile_table_arguments
from beamdae.errors import format_percent, list_first, merge_parts
from beamdae.results.outcome import Status
from beamdae.results.trajectory import Trajectory

if TYPE_CHECKING:
    from beamdae.results.run_data import RunData

Array = np.ndarray

# Strain beyond which Hooke's law with the section of the undeformed beam is off by tens of percent
# for any material, and the one at which all stiff materials yield or break: metals, ceramics and
# composites have moduli of at least 10 GPa, rubber and most plastics lower ones.
_MAX_STRAIN = 0.5
_MAX_STIFF_STRAIN, _MIN_STIFF_MODULUS = 0.02, 1e10
# Runs of many steps end at strains above this multiple of these limits.
_MEANINGLESS_STRAIN_RATIO = 2.0
_MEANINGLESS_DEFORMATION = "so the deformation is meaningless"
# Number of times at which strains are evaluated, one per step, and size of the positions [bytes].
_MIN_SAMPLE_COUNT, _MAX_SAMPLE_COUNT = 400, 20_000
_MAX_SAMPLE_BYTES = 5e7


def sample_positions(trajectory: Trajectory) -> Array:
    """Return the coordinates (k, n) at the times of a run at which strains are checked."""
    return trajectory.positions_at(sample_times(trajectory))


def sample_times(trajectory: Trajectory) -> Array:
    """Return the times (k,) of a run at which strains are checked [s]."""
    intervals = trajectory.intervals
    row_bytes = 8 * max(intervals[0].rows.q.shape[1], 1)
    limit = min(_MAX_SAMPLE_COUNT, _MAX_SAMPLE_BYTES / row_bytes)
    count = max(_MIN_SAMPLE_COUNT, int(min(sum(len(x.t) for x in intervals), limit)))
    # Sampled at equally spaced times because the steps of Radau may be too long.
    return np.unique(np.linspace(intervals[0].t[0], trajectory.end, count))


def strain_warnings(
    equations: EquationsOfMotion,
    q: Array,
    remedy: str = "reduce the loads, or check section and units",
) -> Iterator[str]:
    """Yield a warning of the beams whose strains at q (k, n) are beyond linear elasticity.

    The limit of linear elasticity is the yield stress of the material, if it is known.
    """
    strains = _find_strains(equations, q)
    clause = _describe_meaningless(strains, 1.0) or _describe_yielding(strains)
    if clause:
        yield f"{clause}; {remedy}."


def names_strains(status: Status) -> bool:
    """Return True if strains beyond linear elasticity are among the reasons of an early end."""
    return _MEANINGLESS_DEFORMATION in status.sentence


def describe_meaningless_strain(
    equations: EquationsOfMotion, q: Array, ratio: float = _MEANINGLESS_STRAIN_RATIO
) -> str:
    """Return a clause about strains at q (k, n) that are meaningless for any material, or "".

    Strains of up to `ratio` times those with a warning have none.
    """
    return _describe_meaningless(_find_strains(equations, q), ratio)


def _find_strains(equations: EquationsOfMotion, q: Array) -> dict[Beam, float]:
    """Return the largest strain of each beam."""
    rows = {part.name: part.rows for part in equations.parts}
    return {
        beam: float(beam.kinematics.largest_strain(q[:, rows[beam.name]]))
        for beam in beams_of(equations.mechanism)
    }


def _describe_meaningless(strains: Mapping[Beam, float], ratio: float) -> str:
    clauses = (
        (
            beam.name,
            strain,
            f"{beam.name}: the largest strain is {strain:.3g}, far beyond linear elasticity, "
            f"{_MEANINGLESS_DEFORMATION}",
        )
        for beam, strain in strains.items()
        if strain > ratio * _strain_limit(beam)
    )
    return next(merge_parts(clauses), "")


def _describe_yielding(strains: Mapping[Beam, float]) -> str:
    clauses = []
    for beam, strain in strains.items():
        material = beam.section.at(0.0).material
        stress, limit = material.E * strain, material.yield_stress
        if limit is not None and stress > limit:
            text = f"{beam.name}: the largest stress is {stress:.4g} Pa, beyond the yield stress "
            text += f"{limit:.4g} Pa of its material, so the deformation is not elastic"
            clauses.append((beam.name, stress / limit, text))
    return next(merge_parts(clauses), "")


def _strain_limit(beam: Beam) -> float:
    is_stiff = beam.section.at(0.0).material.E >= _MIN_STIFF_MODULUS
    return _MAX_STIFF_STRAIN if is_stiff else _MAX_STRAIN


IGNORED = (
    "friction depends on the sliding velocity and is zero at rest, so this equilibrium ignores it"
)
DAMPING = (
    "about a state at rest, friction acts as a damper, which friction_speed determines, and damps "
    "small motions only; omit it from linear analyses, or choose an instant of sliding"
)


def friction_warnings(
    e: EquationsOfMotion, consequence: str, inactive: Collection[str]
) -> Iterator[str]:
    """Yield a warning that names the active parts with friction."""
    names = [name for name in e.frictions if name not in inactive]
    if names:
        yield f"{list_first(names)}: {consequence}."


_MIN_EXCESS = 1e-3  # outside a table, relative to its range; less hardly changes its value
_MAX_OVERRUN = 0.01  # beyond an end of a beam, relative to its length


def table_range_warnings(run: RunData) -> Iterator[str]:
    """Yield a warning per argument of a table that leaves its range in a run.

    Tables over time are exempt, because they usually hold their last value, and so are sides at
    which the table is zero or constant: one-sided forces and limits continue there as they should.
    """
    for term in compile_table_arguments(run.equations):
        intervals = [x for x in run.trajectory.intervals if term.part not in x.inactive]
        is_exempt = term.is_limited or term.table.is_repeated or not term.depends_on_motion
        if is_exempt or not intervals:
            continue
        t = np.concatenate([x.t for x in intervals])
        x = np.concatenate([term.argument.values(i.with_branch(i.t), i.state) for i in intervals])
        low, high = term.limits
        sides = {0: low - x, -1: x - high}
        held = [beyond for side, beyond in sides.items() if not term.continues_as_constant(side)]
        excess = np.max(held, axis=0, initial=0.0) if held else np.zeros(len(x))
        k = int(np.argmax(excess))
        if excess[k] > _MIN_EXCESS * (high - low):
            yield (
                f"{term.describe(float(x[k]))} at t = {t[k]:.6g} s, where its value is held; "
                "extend the table, repeat its last value if it stays constant, or pass "
                "outside='repeat' or 'error'; check the units."
            )


def overrun_warnings(run: RunData) -> Iterator[str]:
    """Yield a warning per sliding point and end of its beam beyond which it slides."""
    mechanism = run.equations.mechanism
    parts = () if mechanism is None else mechanism.parts.values()
    points: list[Any] = [x for x in parts if x.moves_along_beam and x.coordinates]
    if mechanism is None or not points:
        return
    times = sample_times(run.trajectory)
    q = run.trajectory.positions_at(times)
    for point in points:
        beam, rows = point.beam, map_coordinates(mechanism).slice_of(point)
        s = q[:, rows].ravel()
        for end, overrun in (("start", -s), ("end", s - beam.length)):
            (beyond,) = np.nonzero(overrun > _MAX_OVERRUN * beam.length)
            if len(beyond):
                share = format_percent(np.max(overrun) / beam.length)
                yield (
                    f"{point.name}: {point.a.body.name} is beyond the {end} of {beam.name} at "
                    f"t = {times[beyond[0]]:.4g} s and later by up to {share} of its length; end "
                    'the run earlier, set ends="stop", or check the unit of the speed.'
                )
