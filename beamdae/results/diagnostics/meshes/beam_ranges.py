"""Validity range of beam strain measures: largest deformations and the resulting errors."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, inf, log, pi
from typing import NamedTuple

import numpy as np
import scipy.linalg as la

from beamdae.beams.beam import Beam, beams_of
from beamdae.equations.equations_of_motion import EquationsOfMotion, RangeTerm
from beamdae.equations.starts.consistent_start import ConsistencySolver
from beamdae.equations.starts.rank import scaled_null_space
from beamdae.errors import format_percent, kind_of_message, merge_parts, name_with_others
from beamdae.memory import release_freed_memory
from beamdae.results.trajectory import Trajectory

Array = np.ndarray

# Estimated error above which a beam is reported. The median estimate is 2.5 times the error; with
# this limit, no error of deflections above 0.5 % is unreported in validation/strain_validity and
# validation/record.
MAX_UNREPORTED_ERROR = 0.01
_MAX_ESTIMATED_ERROR = 0.5  # beyond this, estimates of the error are meaningless
# Ratio of the errors after and before splitting a beam in half;
# validation/strain_validity/run.py measures 0.05 to 0.3.
_ERROR_AFTER_HALVING = 0.2
# Strain at the outer fibers above which a beam is reported, whatever its strain measure: between
# half and one and a half times the length, Hooke's law with the section of the undeformed beam is
# off by tens of percent for any material; beyond, the axis may even be inverted.
MAX_UNREPORTED_STRAIN = 0.5
# The same for stiff materials: metals, ceramics and composites yield or fail at strains of at most
# a few percent, and their moduli are at least 10 GPa; those of rubber and most plastics are lower.
_MAX_UNREPORTED_STIFF_STRAIN, _MIN_STIFF_MODULUS = 0.05, 1e10
# Steels, titanium and fibers of high modulus yield or break before 2 %: the elastic limit is 1.3 %
# for maraging steel and 1.9 % for drawn wires, the strongest metals.
_MAX_STRAIN_OF_METALS, _MIN_STEEL_MODULUS = 0.02, 1e11
# Runs of many steps end at strains above this multiple of these limits.
_MEANINGLESS_STRAIN_RATIO = 2.0
_RPM = np.pi / 30.0  # rad/s
MEANINGLESS_DEFORMATION = "so the deformation is meaningless"
# Limits of the number of times at which beams are checked, one time per step. With fewer times than
# four per period, long vibrations would be undersampled and their phase error missed.
_MIN_SAMPLE_COUNT = 400
_MAX_SAMPLE_COUNT = 20_000
# Above this size of the sampled positions [bytes], freed memory is returned to the system. It is
# three times as large.
_MAX_RETAINED_BYTES = 5e7
_MAX_NAMES = 5  # of further beams in a warning
_DEFECT_SAMPLE_COUNT = 16  # times of the largest motions at which exact strains are evaluated
_AXIAL_SAMPLE_COUNT = 2  # further times, of the largest axial displacements

# Error of deflections over the relative change of the deformation by exact strains. The error grows
# with the number of oscillations, whose frequencies are wrong: a relative change e of the stiffness
# shifts the phase by pi e per oscillation, and harmonics by a multiple. With these values, the
# estimate covers the 62 mechanisms of validation/strain_validity/mechanisms.py with an error above
# 1e-4; the median estimate is 2.5 times the error.
_ERROR_OF_MOTION = 4.0
_ERROR_PER_OSCILLATION = 5.0
# A vibration with the damping ratio z forgets errors of the phase after 1 / (2 pi z) oscillations,
# and so does a driven motion. A press with a rod of 1 kHz and z = 0.03: errors of 0.05 %, estimates
# of 1.1 % after 5 turns and 3.2 % after 12 turns without this limit, of 0.7 % with it. Counts of up
# to 3 oscillations are not limited. Of large models, the ratio is not computed.
_MIN_COHERENT_OSCILLATIONS = 3.0
_MAX_COORDINATES = 400
# Stretched beams follow most motions without vibrations: their error is that in equilibrium, and
# only oscillations about the motion averaged over the longest period add to it. In 32 runs of rods
# with end masses under forces that jump, rise, repeat, break off or are harmonic (strains of 0.001
# to 0.002), the estimate covers 31 errors with and without this, and its median is 2.9 instead of
# 6.0 times the error. Longer periods are not separated from the motion.
_MAX_SHARE_OF_PERIOD = 0.2  # of the run
_COHERENCE_SAMPLES = 3  # positions at which the ratio is computed
# Smaller vibrations, relative to the largest deformation, are errors of the integration.
_MIN_VIBRATION_RATIO = 1e-4
# Error of deflections in equilibrium over that change, relative to the largest deflection. Measured
# by validation/strain_validity/run.py on cantilevers.
_ERROR_OF_EQUILIBRIUM = 1.1
# Errors of natural frequencies about a deformed state, and of linear buckling loads, over that
# change. Measured: up to 1.0 for stretched strings and rotating beams, 0.7 to 3.9 for bent
# cantilevers and compressed columns at half their buckling load, more near it; 1.1 for buckling
# loads of thick columns.
_ERROR_OF_FREQUENCY = 4.0
_ERROR_OF_FREQUENCY_IN_TENSION = 1.2
_ERROR_OF_BUCKLING = 2.0


@dataclass(frozen=True)
class BeamRange:
    """Largest deformation of a beam relative to its floating frame.

    Attributes
    ----------
    name
        Name of the beam.
    deflection
        Largest displacement of a node relative to the undeformed beam in its frame, divided by the
        beam length [-].
    rotation
        Largest rotation of a node relative to the undeformed beam in its frame [rad].
    strain
        Largest axial strain at the outer fibers of a rectangular section, including bending [-].
    error
        Estimated error of deflections due to the strain measure, relative to half their range. In
        equilibrium, the range includes the undeformed beam: for a load in one direction, half the
        range is half the deflection. None if the strain measure does not limit the rotation. In the
        mechanisms of validation/strain_validity with errors above 1e-4, estimates below 0.5 are 1.1
        to 15 times the error (median 2.5). The estimate is far too large for flexures whose
        deformation is prescribed by heavier parts, and meaningless above 0.5.
    remedies
        Settings of the beam that reduce the error, as alternatives to splitting the beam; may be
        empty.
    axial_error
        Error that the axial vibrations of a bent beam cause; `error` is at least as large. Zero if
        the beam is stretched rather than bent: then, `error` is the error of axial vibrations.
    """

    name: str
    deflection: float
    rotation: float
    strain: float
    error: float | None = None
    remedies: tuple[str, ...] = ()
    axial_error: float = 0.0

    @property
    def warning(self) -> str | None:
        """Warning if the estimated error exceeds 1 %, otherwise None."""
        if self.error is None or self.error <= MAX_UNREPORTED_ERROR:
            return None
        return self._describe(self.error, "deflections")

    def _describe(self, error: float, quantity: str) -> str:
        """Return a warning about the error of a quantity, with the remedies."""
        consequence = "the deformation is wrong"
        if error < _MAX_ESTIMATED_ERROR:
            consequence = f"the error of {quantity} is at most about {format_percent(error)}"
        return f"{self.name}: {self.cause}, where {consequence}; {self.recommend(error)}."

    @property
    def cause(self) -> str:
        """Clause on the deformation."""
        deflection = f"(deflection {self.deflection:.2g} of the length)"
        if _is_stretched(self.deflection, self.rotation):
            return f"the beam is stretched or compressed {deflection}"
        if self._vibrates_axially:
            return (
                f"the beam bends {self.rotation:.2g} rad and vibrates along its axis {deflection}"
            )
        return f"the beam bends {self.rotation:.2g} rad away from the floating frame {deflection}"

    @property
    def _vibrates_axially(self) -> bool:
        return self.axial_error == self.error

    def recommend(self, error: float) -> str:
        """Return a clause on settings for which an error becomes small."""
        if _is_stretched(self.deflection, self.rotation) or self._vibrates_axially:
            # Shorter bodies have the same strain.
            return "set strain='exact'"
        reduction = MAX_UNREPORTED_ERROR / min(error, _MAX_ESTIMATED_ERROR)
        bodies = 2 ** ceil(log(reduction) / log(_ERROR_AFTER_HALVING))
        settings = "".join(f", or set {remedy}" for remedy in self.remedies)
        return f"split the beam with bd.welded_beams(..., bodies={bodies}){settings}"


class BeamDoubt(NamedTuple):
    """Reason to compute a state again with more accurate beams.

    Attributes
    ----------
    name
        Name of the beam.
    cause, comparison
        Parts of a sentence about the error: "cause: comparison, a value is ...; remedy."
    remedy
        Function of the largest change that returns the last part.
    row
        Index of the state that is compared.
    is_taut
        True if the elements are long for the tension of the beam.
    """

    name: str
    cause: str
    comparison: str
    remedy: Callable[[float], str]
    row: int = 0
    is_taut: bool = False


class _Deformations(NamedTuple):
    """Largest deformations of a beam, and positions at which its strains are compared.

    Attributes
    ----------
    largest
        Largest deflection / length [-], rotation [rad] and strain [-], (3,).
    error_factor
        Error of deflections over the relative change of the deformation by exact strains.
    samples
        Coordinates (k, n) at which exact strains are evaluated; None if the strain measure does not
        limit the rotation.
    axial_factor
        The factor for displacements along the axis.
    axial_samples
        Coordinates (k, n) with large displacements along the axis; None for a stretched beam.
    """

    largest: Array
    error_factor: float = 0.0
    samples: Array | None = None
    axial_factor: float = 0.0
    axial_samples: Array | None = None

    def has_factors_of(self, other: _Deformations) -> bool:
        """Return True if both factors are those of other deformations."""
        return (self.error_factor, self.axial_factor) == (other.error_factor, other.axial_factor)

    def with_limited_factors(self, limit: float) -> _Deformations:
        """Return a copy with factors of at most a limit."""
        return self._replace(
            error_factor=min(self.error_factor, limit), axial_factor=min(self.axial_factor, limit)
        )


def measure_beam_ranges_of_run(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> tuple[BeamRange, ...]:
    """Return the largest deformation of each floating-frame beam over a run."""
    if not equations.ranges:
        return ()
    q = sample_positions(trajectory)
    deformations = [_find_deformations(x, q, _error_factor_of_run) for x in equations.ranges]
    is_large = q.nbytes > _MAX_RETAINED_BYTES
    # Exact strains are evaluated at few of the positions, and take as much memory as all of them.
    del q
    if is_large:
        release_freed_memory()
    ranges = tuple(map(_beam_range, equations.ranges, deformations))
    if any(x.error is not None and x.error > MAX_UNREPORTED_ERROR for x in ranges):
        coherent, period = _measure_vibrations(equations, trajectory)
        coherent = max(_MIN_COHERENT_OSCILLATIONS, coherent)
        limit = _ERROR_OF_MOTION + _ERROR_PER_OSCILLATION * coherent
        limited = [
            _limit_by_axial_vibrations(term, x.with_limited_factors(limit), trajectory, period)
            for term, x in zip(equations.ranges, deformations, strict=True)
        ]
        ranges = tuple(
            beam if new.has_factors_of(old) else _beam_range(term, new)
            for term, beam, old, new in zip(
                equations.ranges, ranges, deformations, limited, strict=True
            )
        )
    if is_large:
        release_freed_memory()
    return ranges


def _limit_by_axial_vibrations(
    term: RangeTerm, deformations: _Deformations, trajectory: Trajectory, period: float
) -> _Deformations:
    """Return the deformations; a stretched beam has at most the factor of its vibrations.

    `period` [s] is that of the slowest vibration.
    """
    is_bent = deformations.samples is None or deformations.axial_samples is not None
    if is_bent or period > _MAX_SHARE_OF_PERIOD * (trajectory.end - trajectory.start):
        return deformations
    times = sample_times(trajectory)
    motion = term.displacements(sample_positions(trajectory))
    count = count_axial_oscillations(motion, round(period / (times[1] - times[0])))
    factor = min(_ERROR_OF_MOTION, _error_factor_of_equilibria(motion))
    factor += _ERROR_PER_OSCILLATION * count
    return deformations._replace(error_factor=min(deformations.error_factor, factor))


def _measure_vibrations(
    equations: EquationsOfMotion, trajectory: Trajectory
) -> tuple[float, float]:
    """Return the coherence of the least damped vibration, and the longest period [s].

    The coherence is the number of oscillations after which the vibration has decayed by 1/e. Both
    are infinite if they are unknown, and the coherence if a vibration is not damped. Modes with
    less than one oscillation in the run are not considered.
    """
    has_switched_parts = any(x.configuration is not None for x in trajectory.intervals)
    if has_switched_parts or equations.n > _MAX_COORDINATES:
        return inf, inf
    solver, first = ConsistencySolver(equations), trajectory.intervals[0]
    smallest = 2.0 * pi / (trajectory.end - trajectory.start)
    ratios, slowest = [inf], inf
    times = np.linspace(trajectory.start, trajectory.end, _COHERENCE_SAMPLES)
    for t, q in zip(times, trajectory.positions_at(times), strict=True):
        time = np.array([t, first.branch])
        stiffness, damping, mass = solver.linearize_forces(time, solver.rest_state(q))
        basis = scaled_null_space(solver.constraint_matrix(time, q), equations.position_scales)
        if not basis.shape[1]:
            continue
        reduced, inertia = (basis.T @ (x @ basis) for x in (stiffness, mass))
        try:
            squares, modes = la.eigh(0.5 * (reduced + reduced.T), 0.5 * (inertia + inertia.T))
        except (la.LinAlgError, ValueError):  # states without inertia, infinite forces
            return inf, inf
        motions = basis @ modes
        rates = np.sum(motions * (damping @ motions), axis=0)
        if squares[0] < -(smallest**2):
            return inf, inf
        vibrates = squares > smallest**2
        ratios.extend(0.5 * rates[vibrates] / np.sqrt(squares[vibrates]))
        slowest = min(slowest, *np.sqrt(squares[vibrates]), inf)
    smallest_ratio = min(ratios)
    coherent = float(1.0 / (2.0 * pi * smallest_ratio)) if smallest_ratio > 0.0 else inf
    return coherent, 2.0 * pi / slowest if slowest < inf else inf


def measure_beam_ranges(equations: EquationsOfMotion, q: Array) -> tuple[BeamRange, ...]:
    """Return the largest deformation of each floating-frame beam over the equilibria q (k, n)."""
    deformations = [_find_deformations(x, q, _error_factor_of_equilibria) for x in equations.ranges]
    return tuple(map(_beam_range, equations.ranges, deformations))


def sample_positions(trajectory: Trajectory) -> Array:
    """Return the coordinates (k, n) at the times of a run at which strains are checked."""
    return trajectory.positions_at(sample_times(trajectory))


def sample_times(trajectory: Trajectory) -> Array:
    """Return the times (k,) of a run at which strains are checked [s]."""
    intervals = trajectory.intervals
    row_bytes = 8 * max(intervals[0].rows.q.shape[1], 1)
    limit = min(_MAX_SAMPLE_COUNT, _MAX_RETAINED_BYTES / row_bytes)
    count = max(_MIN_SAMPLE_COUNT, int(min(sum(len(x.t) for x in intervals), limit)))
    # Sampled at equally spaced times because the steps of Radau may be too long.
    return np.unique(np.linspace(intervals[0].t[0], trajectory.end, count))


def find_strain_doubt(
    ranges: Sequence[BeamRange], least: float = MAX_UNREPORTED_ERROR
) -> tuple[BeamDoubt, tuple[str, ...]] | None:
    """Return why states are to be compared with exact strains, and the names of these beams.

    Returns None if no beam has an estimated error above `least`.
    """
    doubtful = [x for x in ranges if x.error is not None and x.error > least]
    if not doubtful:
        return None
    worst = max(doubtful, key=lambda x: x.error or 0.0)
    others = [x.name for x in doubtful if x is not worst]
    cause = f"{name_with_others(worst.name, others, _MAX_NAMES)}: {worst.cause}"
    doubt = BeamDoubt(worst.name, cause, "with exact strains", worst.recommend)
    return doubt, tuple(x.name for x in doubtful)


def range_warnings(ranges: Iterable[BeamRange]) -> Iterator[str]:
    """Yield `BeamRange.warning` of all beams; one sentence if they differ only in numbers."""
    warned = [(x.name, x.error or 0.0, x.warning) for x in ranges]
    yield from _merge_beams((name, error, text) for name, error, text in warned if text)


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


def measure_frequency_ranges(equations: EquationsOfMotion, q: Array) -> list[BeamRange]:
    """Return the beams whose strains at q (n,) cause errors of frequencies of over 1 %."""
    ratios = _ERROR_OF_FREQUENCY, _ERROR_OF_FREQUENCY_IN_TENSION
    return list(_measure_state(equations, q, *ratios))


def frequency_warnings(ranges: Iterable[BeamRange]) -> Iterator[str]:
    """Yield warnings of the beams of `measure_frequency_ranges`."""
    yield from _merge_beams(_describe_ranges(ranges, "natural frequencies"))


def buckling_warnings(equations: EquationsOfMotion, q: Array) -> Iterator[str]:
    """Yield warnings of the beams whose strains at q (n,) cause errors of buckling loads."""
    ranges = _measure_state(equations, q, _ERROR_OF_BUCKLING, _ERROR_OF_BUCKLING)
    yield from _merge_beams(_describe_ranges(ranges, "buckling loads"))


def _describe_ranges(
    ranges: Iterable[BeamRange], quantity: str
) -> Iterator[tuple[str, float, str]]:
    for beam in ranges:
        assert beam.error is not None
        yield beam.name, beam.error, beam._describe(beam.error, quantity)


def _measure_state(
    equations: EquationsOfMotion, q: Array, error_ratio: float, error_ratio_in_tension: float
) -> Iterator[BeamRange]:
    for term in equations.ranges:
        statement = term.statement
        if statement.defect is None:
            continue
        deflection, rotation, strain = map(float, term.largest_deformation(q[None]))
        error = error_ratio * relative_change_by_exact_strains(term, q[None])
        elongation = term.axial_displacements(q[None])[0].sum()
        if _is_stretched(deflection, rotation) and elongation > 0.0:
            error *= error_ratio_in_tension / error_ratio
        if error > MAX_UNREPORTED_ERROR:
            yield BeamRange(statement.part, deflection, rotation, strain, error, statement.remedies)


def strain_warnings(
    equations: EquationsOfMotion, ranges: Sequence[BeamRange], positions: Callable[[], Array]
) -> Iterator[str]:
    """Yield a warning of the beams whose strains are too large for linear elasticity.

    Parameters
    ----------
    equations
        Equations of motion.
    ranges
        Largest deformations of the beams that have a range of validity.
    positions
        Function that returns the coordinates (k, n) at which the strains of other beams, such as
        exact beams, are evaluated.
    """
    strains = {beam.name: beam.strain for beam in ranges}
    if any(x.name not in strains for x in beams_of(equations.mechanism)):
        strains |= _largest_strains_of_others(equations, strains, positions())
    for clause in _describe_strains(equations, strains):
        yield f"{clause}; reduce the loads, or check section and units."


def describe_meaningless_strain(
    equations: EquationsOfMotion, q: Array, ratio: float = _MEANINGLESS_STRAIN_RATIO
) -> str:
    """Return the clause of `strain_warnings` for strains at q (k, n), or "".

    Strains of up to `ratio` times those with a warning have none.
    """
    return next(_describe_strains(equations, _largest_strains(equations, q), ratio), "")


def rotation_warnings(equations: EquationsOfMotion, q: Array, speed: float) -> Iterator[str]:
    """Yield a warning of metal beams that a rotation strains beyond the strength of metals.

    `q` (n,) are the coordinates in the steady rotation at `speed` [rad/s]; such speeds are usually
    meant in rpm.
    """
    strains = _largest_strains(equations, q[None])
    yield from _merge_beams(
        (
            beam.name,
            strains[beam.name],
            f"{beam.name}: the rotation at {speed:g} rad/s ({speed / _RPM:.0f} rpm) causes strains "
            f"of {format_percent(strains[beam.name])}, but metals bear at most "
            f"{format_percent(_MAX_STRAIN_OF_METALS)}; speeds are in rad/s "
            f"({speed:g} rpm are {speed * _RPM:.4g} rad/s).",
        )
        for beam in beams_of(equations.mechanism)
        if strains[beam.name] > _MAX_STRAIN_OF_METALS
        and beam.section.at(0.0).material.E >= _MIN_STIFF_MODULUS
    )


def _largest_strains(equations: EquationsOfMotion, q: Array) -> dict[str, float]:
    """Return the largest strains of all beams at q (k, n), by name."""
    strains = {x.statement.part: float(x.largest_deformation(q)[2]) for x in equations.ranges}
    return strains | _largest_strains_of_others(equations, strains, q)


def _largest_strains_of_others(
    equations: EquationsOfMotion, known: Mapping[str, float], q: Array
) -> dict[str, float]:
    """Return the largest strains at q (k, n) of the beams that are not in `known`, by name."""
    rows = {part.name: part.rows for part in equations.parts}
    return {
        beam.name: beam.kinematics.largest_strain(q[:, rows[beam.name]])
        for beam in beams_of(equations.mechanism)
        if beam.name not in known
    }


def _describe_strains(
    equations: EquationsOfMotion, strains: Mapping[str, float], ratio: float = 1.0
) -> Iterator[str]:
    """Yield a clause on the strains by name of the beam that exceed `ratio` times the limit."""
    limits = {beam.name: _strain_limit(beam) for beam in beams_of(equations.mechanism)}
    yield from _merge_beams(
        (
            name,
            strain,
            f"{name}: the largest strain is {strain:.3g}, far beyond linear elasticity, "
            f"{MEANINGLESS_DEFORMATION}",
        )
        for name, strain in strains.items()
        if strain > ratio * limits.get(name, MAX_UNREPORTED_STRAIN)
    )


def _strain_limit(beam: Beam) -> float:
    """Return the strain above which a beam is reported; it depends on the material."""
    modulus = beam.section.at(0.0).material.E
    if modulus >= _MIN_STEEL_MODULUS:
        return _MAX_STRAIN_OF_METALS
    return _MAX_UNREPORTED_STIFF_STRAIN if modulus >= _MIN_STIFF_MODULUS else MAX_UNREPORTED_STRAIN


def _find_deformations(
    term: RangeTerm, q: Array, error_factor: Callable[[Array], float]
) -> _Deformations:
    """Return the deformations at q (k, n); `error_factor` is a function of the motion."""
    if term.statement.defect is None:
        return _Deformations(term.largest_deformation(q))
    largest, rotations, axial = term.largest_and_motions(q)
    if _is_stretched(*largest[:2]):
        motion = term.displacements(q)
        return _Deformations(largest, error_factor(motion), q[_select_samples(motion)])
    bending = (error_factor(rotations), q[_select_samples(rotations)])
    # Axial vibrations are faster than those of bending: their phase error can be larger.
    axial_samples = q[_select_samples(axial)[-_AXIAL_SAMPLE_COUNT:]]
    return _Deformations(largest, *bending, error_factor(axial), axial_samples)


def _is_stretched(deflection: float, rotation: float) -> bool:
    """Return whether a beam is stretched rather than bent.

    Bending turns sections by more than the deflection over the length.
    """
    return rotation < deflection


def _beam_range(term: RangeTerm, deformations: _Deformations) -> BeamRange:
    statement, error, axial_error = term.statement, None, 0.0
    deflection, rotation, strain = map(float, deformations.largest)
    samples, axial_samples = deformations.samples, deformations.axial_samples
    if samples is not None:
        rows = samples if axial_samples is None else np.concatenate([samples, axial_samples])
        largest, changes = term.deformation_changes(rows)
        count = len(samples)
        ratio = _relative_change(term, samples, largest[:count], changes[:count])
        error = deformations.error_factor * ratio
        # Without faster vibrations along the axis, as in equilibria, the bending error includes it.
        vibrates = deformations.axial_factor > deformations.error_factor
        if axial_samples is not None and vibrates and deflection > 0.0:
            change = float(np.max(changes[:, 2])) / (deflection * term.length)
            axial_error = deformations.axial_factor * change
            error = max(error, axial_error)
    return BeamRange(
        statement.part, deflection, rotation, strain, error, statement.remedies, axial_error
    )


def _error_factor_of_run(motion: Array) -> float:
    return _ERROR_OF_MOTION + _ERROR_PER_OSCILLATION * count_oscillations(motion)


def _error_factor_of_equilibria(motion: Array) -> float:
    """Return the factor of errors relative to half the range, as in runs and certificates."""
    most = motion[:, np.argmax(_largest_of_rows(motion.T))]
    half_range = 0.5 * np.ptp(np.append(most, 0.0))
    if not half_range > 0.0:
        return _ERROR_OF_EQUILIBRIUM
    return float(_ERROR_OF_EQUILIBRIUM * np.abs(most).max() / half_range)


def relative_change_by_exact_strains(term: RangeTerm, q: Array) -> float:
    """Return the change of the deformation with exact strains / the largest deformation [-].

    The beam is considered alone, under unchanged loads; see `RangeTerm.deformation_changes`. The
    result is the larger of the ratios for displacements and for rotations, because under bending
    moments only the displacements change.
    """
    deflection, rotation, _ = term.largest_deformation(q)
    motion = term.displacements(q) if _is_stretched(deflection, rotation) else term.rotations(q)
    samples = q[_select_samples(motion)]
    return _relative_change(term, samples, *term.deformation_changes(samples))


def _select_samples(motion: Array) -> Array:
    """Return the indices of the largest motions in different sections of the run."""
    largest = _largest_of_rows(motion)
    # Peaks of sections of the run: adjacent times of one peak have almost the same deformation.
    peaks = _find_peaks(largest, min(len(largest), _MIN_SAMPLE_COUNT))
    return peaks[np.argsort(largest[peaks])[-_DEFECT_SAMPLE_COUNT:]]


def _largest_of_rows(values: Array) -> Array:
    """Return the largest absolute value of each row, without an array of all absolute values."""
    return np.maximum(values.max(axis=1), -values.min(axis=1))


def _relative_change(term: RangeTerm, samples: Array, largest: Array, changes: Array) -> float:
    deformation, change = (np.max(x[:, :2], axis=0) for x in (largest, changes))
    # The rotations of a beam that is stretched are small, and their changes insignificant.
    deformation[1] = max(deformation[1], term.largest_deformation(samples)[0])
    deformed = deformation > 0.0
    with np.errstate(invalid="ignore"):  # infinite deformations
        return float(np.max(change[deformed] / deformation[deformed], initial=0.0))


def _find_peaks(values: Array, count: int) -> Array:
    """Return the index of the largest value in each of `count` sections, as of np.array_split."""
    length, n_longer = divmod(len(values), count)
    end = n_longer * (length + 1)
    longer, shorter = values[:end].reshape(-1, length + 1), values[end:].reshape(-1, length)
    return np.concatenate(
        [
            np.argmax(longer, axis=1) + (length + 1) * np.arange(len(longer)),
            np.argmax(shorter, axis=1) + end + length * np.arange(len(shorter)),
        ]
    )


def count_oscillations(motion: Array) -> float:
    """Return the effective number of oscillations of a beam, a measure of the phase error.

    The relative error of a frequency of bending is proportional to the square of the rotation.
    Therefore, each oscillation has the weight (largest value of the oscillation / of the run)^2. It
    applies to both half-cycles, even if the beam is almost straight in one of them, as in a
    vibration about the deflection by weight. The error of the motion is proportional to the phase
    error and to the amplitude. The result is therefore the largest product over time of the
    accumulated weights and the ratio of the amplitude that remains to the initial amplitude.

    Parameters
    ----------
    motion
        Section rotations [rad], or displacements [m] of a stretched beam, (k, n). The column with
        the largest range is evaluated.
    """
    widest = motion[:, np.argmax(np.ptp(motion, axis=0))]
    vibration = widest - np.mean(widest)
    amplitude = np.maximum.accumulate(np.abs(vibration)[::-1])[::-1]
    largest = _largest_of_rows(motion)
    if not amplitude[0] > _MIN_VIBRATION_RATIO * np.max(largest):
        return 0.0
    # Two sign changes are one oscillation.
    changes = np.diff(np.sign(vibration), prepend=np.sign(vibration[0])) != 0.0
    half_cycle = np.cumsum(changes)
    peaks = np.zeros(half_cycle[-1] + 1)
    np.maximum.at(peaks, half_cycle, largest)
    peaks[:-1] = np.maximum(peaks[:-1], peaks[1:])
    phase = np.cumsum(0.5 * changes * (peaks[half_cycle] / np.max(peaks)) ** 2)
    return float(np.max(phase * amplitude) / amplitude[0])


def count_axial_oscillations(motion: Array, width: int) -> float:
    """Return the effective number of oscillations of a stretched beam, as `count_oscillations`.

    Oscillations about the average over `width` rows, the longest period, are counted: a motion that
    the beam follows without vibrations has no phase error. An oscillation shifts the phase of later
    ones with at most its own amplitude: what is excited later begins without the error.
    """
    # Imported here because few runs need it, and the import slows the start of the others.
    from scipy.ndimage import uniform_filter1d

    widest = motion[:, np.argmax(np.ptp(motion, axis=0))]
    half_range = 0.5 * np.ptp(widest)
    if not half_range > 0.0:
        return 0.0
    vibration = widest - uniform_filter1d(widest, width, mode="nearest")
    starts = np.concatenate([[0], np.flatnonzero(np.diff(np.sign(vibration))) + 1])
    amplitudes = np.maximum.reduceat(np.abs(vibration), starts)
    peaks = np.maximum.reduceat(_largest_of_rows(motion), starts)
    peaks[:-1] = np.maximum(peaks[:-1], peaks[1:])
    weights = 0.5 * (peaks / np.max(peaks)) ** 2
    later = np.maximum.accumulate(amplitudes[::-1])[::-1]
    errors = [
        float(weights[:k] @ np.minimum(amplitudes[:k], later[k - 1]))
        for k in range(1, len(starts) + 1)
    ]
    return max(errors) / half_range
