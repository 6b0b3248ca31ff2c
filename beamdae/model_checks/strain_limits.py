"""Strains of beams beyond linear elasticity."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from beamdae.beams.beam import Beam, beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.errors import format_percent, kind_of_message, merge_parts
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Strain at the outer fibers above which a beam is reported: between half and one and a half times
# the length, Hooke's law with the section of the undeformed beam is off by tens of percent for any
# material; beyond, the axis may even be inverted.
_MAX_STRAIN = 0.5
# The same for stiff materials: metals, ceramics and composites yield or fail at strains of at most
# a few percent, and their moduli are at least 10 GPa; those of rubber and most plastics are lower.
_MAX_STIFF_STRAIN, _MIN_STIFF_MODULUS = 0.05, 1e10
# Steels, titanium and fibers of high modulus yield or break before 2 %: the elastic limit is 1.3 %
# for maraging steel and 1.9 % for drawn wires, the strongest metals.
_MAX_STRAIN_OF_METALS, _MIN_STEEL_MODULUS = 0.02, 1e11
# Runs of many steps end at strains above this multiple of these limits.
_MEANINGLESS_STRAIN_RATIO = 2.0
_RPM = np.pi / 30.0  # rad/s
MEANINGLESS_DEFORMATION = "so the deformation is meaningless"
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


def strain_warnings(equations: EquationsOfMotion, q: Array) -> Iterator[str]:
    """Yield a warning of the beams whose strains at q (k, n) are beyond linear elasticity."""
    for clause in _describe_strains(equations, q):
        yield f"{clause}; reduce the loads, or check section and units."


def describe_meaningless_strain(
    equations: EquationsOfMotion, q: Array, ratio: float = _MEANINGLESS_STRAIN_RATIO
) -> str:
    """Return the clause of `strain_warnings` for strains at q (k, n), or "".

    Strains of up to `ratio` times those with a warning have none.
    """
    return next(_describe_strains(equations, q, ratio), "")


def rotation_warnings(equations: EquationsOfMotion, q: Array, speed: float) -> Iterator[str]:
    """Yield a warning of metal beams that a rotation strains beyond the strength of metals.

    `q` (n,) are the coordinates in the steady rotation at `speed` [rad/s]; such speeds are usually
    meant in rpm.
    """
    strains = _largest_strains(equations, q[None])
    yield from _merge_beams(
        (
            beam.name,
            strain,
            f"{beam.name}: the rotation at {speed:g} rad/s ({speed / _RPM:.0f} rpm) causes strains "
            f"of {format_percent(strain)}, but metals bear at most "
            f"{format_percent(_MAX_STRAIN_OF_METALS)}; speeds are in rad/s "
            f"({speed:g} rpm are {speed * _RPM:.4g} rad/s).",
        )
        for beam, strain in strains.items()
        if strain > _MAX_STRAIN_OF_METALS and beam.section.at(0.0).material.E >= _MIN_STIFF_MODULUS
    )


def _largest_strains(equations: EquationsOfMotion, q: Array) -> dict[Beam, float]:
    rows = {part.name: part.rows for part in equations.parts}
    beams = beams_of(equations.mechanism)
    return {beam: beam.kinematics.largest_strain(q[:, rows[beam.name]]) for beam in beams}


def _describe_strains(equations: EquationsOfMotion, q: Array, ratio: float = 1.0) -> Iterator[str]:
    """Yield a clause on the beams whose strains exceed `ratio` times the limit."""
    yield from _merge_beams(
        (
            beam.name,
            strain,
            f"{beam.name}: the largest strain is {strain:.3g}, far beyond linear elasticity, "
            f"{MEANINGLESS_DEFORMATION}",
        )
        for beam, strain in _largest_strains(equations, q).items()
        if strain > ratio * _strain_limit(beam)
    )


def _strain_limit(beam: Beam) -> float:
    """Return the strain above which a beam is reported; it depends on the material."""
    modulus = beam.section.at(0.0).material.E
    if modulus >= _MIN_STEEL_MODULUS:
        return _MAX_STRAIN_OF_METALS
    return _MAX_STIFF_STRAIN if modulus >= _MIN_STIFF_MODULUS else _MAX_STRAIN


def _merge_beams(warned: Iterable[tuple[str, float, str]]) -> Iterator[str]:
    """Yield the sentences of beams; of those that differ only in numbers, that of the worst.

    Parameters
    ----------
    warned
        Name, size of the error and sentence of each beam.
    """
    kinds: dict[str, list[tuple[float, str, str]]] = {}
    for name, size, sentence in warned:
        text = sentence.removeprefix(f"{name}: ")
        kinds.setdefault(kind_of_message(f": {text}"), []).append((size, name, text))
    for beams in kinds.values():
        yield from merge_parts(((name, size, text) for size, name, text in beams), _MAX_NAMES)
