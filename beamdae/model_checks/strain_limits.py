"""Strains of beams beyond linear elasticity."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from beamdae.beams.beam import Beam, beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import merge_parts
from beamdae.results.outcome import Status
from beamdae.results.trajectory import Trajectory

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
_MAX_NAMES = 5  # of further beams in a warning


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
    return next(merge_parts(clauses, _MAX_NAMES), "")


def _describe_yielding(strains: Mapping[Beam, float]) -> str:
    clauses = []
    for beam, strain in strains.items():
        material = beam.section.at(0.0).material
        stress, limit = material.E * strain, material.yield_stress
        if limit is not None and stress > limit:
            text = f"{beam.name}: the largest stress is {stress:.4g} Pa, beyond the yield stress "
            text += f"{limit:.4g} Pa of its material, so the deformation is not elastic"
            clauses.append((beam.name, stress / limit, text))
    return next(merge_parts(clauses, _MAX_NAMES), "")


def _strain_limit(beam: Beam) -> float:
    is_stiff = beam.section.at(0.0).material.E >= _MIN_STIFF_MODULUS
    return _MAX_STIFF_STRAIN if is_stiff else _MAX_STRAIN
