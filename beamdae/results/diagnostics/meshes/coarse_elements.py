"""Elements of beams that are too few, or too long for their axial tension.

The deflection of a beam under the tension N has boundary layers of the length sqrt(EI / N) at
clamps and at loads. Elements that are several times as long are too stiff or too flexible, so that
travels, reactions and frequencies are wrong. A few elements do not contain the bent shape of an
arc, nor straight ones that under distributed loads. In such cases, the state is computed again with
halved elements: an equilibrium under the same loads or, of a run, a quasi-static motion with the
same accelerations, in which changes of the positions have the rates 1 / T and 1 / T^2, with the
duration T of the run.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Container, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from beamdae.beams.beam import Beam, beams_of
from beamdae.beams.dispersion import section_values
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.formulations.tangents import compute_tangent
from beamdae.errors import format_count, format_percent, name_with_others
from beamdae.linear.saddle_point import factorize_saddle_point
from beamdae.results.columns import (
    NO_OTHERS,
    UNITS_OF_POSITIONS,
    Header,
    format_apart,
    largest_of_kind,
    mark_vanishing_columns,
    remove_unit,
)
from beamdae.results.diagnostics.meshes.beam_ranges import BeamDoubt
from beamdae.results.diagnostics.meshes.moving_loads import measured_quantity
from beamdae.results.diagnostics.resolution.missed_peaks import StepExtremes
from beamdae.results.trajectory import Instant, Trajectory
from beamdae.symbolic.statements import Quantity

if TYPE_CHECKING:
    from beamdae.equations.assembly.refined_beams import RefinedBeams

Array = np.ndarray

# Square of the length of elements, relative to sqrt(EI / N), from which on the state is computed
# again. In 60 runs of clamped and hinged beams with 1 to 8 elements, errors are below 0.1 % at 15,
# 2 % of the moment at a clamp at 70, and 20 % at 60 with a single element beside the load.
LONG = 10.0
# The same for strains in the boundary layer at a clamp, whose errors are about 1 % from here on.
LONG_FOR_STRAINS = 1.2**2
# In 400 equilibria of straight, curved and tapered beams, travels and reactions have errors of over
# 1 % without tension only if a beam has up to 3 elements. Runs, in which the comparison takes as
# long as 500 steps, are only examined for beams with up to 2: curved ones, with this turn of an
# element [rad], and others if a motion within an element is observed. In 240 runs of cantilevers,
# clamped, hinged and tapered beams, rotors and connecting rods, those are off by up to 5 % (angles
# by tens of percent), and motions of element ends and forces by up to 1 %, unless they vibrate.
_FEW_ELEMENTS, _FEW_ELEMENTS_OF_RUN, _LARGE_TURN = 3, 2, 0.1
# Recommended length of elements, relative to sqrt(EI / N).
_SHORT_ELEMENT = 5.0
_MAX_ERROR = 0.01
# Elements of half the length reduce smaller errors to 1 %.
LARGE_CHANGE = 2.0**4 * _MAX_ERROR
# Columns that are smaller, relative to the largest one of their kind, are left out: of runs, whose
# state is compared approximately, and of equilibria, whose parasitic motions matter to flexures.
MIN_SHARE, MIN_SHARE_AT_REST = 1e-2, 1e-5
# So are positions that change by less [length of the mechanism, rad].
_ROUNDING = 1e-8
_ROWS = 24  # states of a run that are examined
_MODES = 10  # of which the slowest vibration is compared
_MAX_ITERATIONS = 15
_TOLERANCE = 1e-8  # of Newton's method, in natural sizes
_MAX_STEP = 1.0  # larger corrections mean that it diverges
_HALVED = "with halved elements"


def find_taut_beams(equations: EquationsOfMotion, q: Array, long: float = LONG) -> list[BeamDoubt]:
    """Return the beams whose elements are long for their tension in the states q (k, n).

    That with the longest elements is the first. Elements are `long` from this square of their
    length, relative to sqrt(EI / N), on.
    """
    found = []
    for beam, forces in evaluate_forces(equations, q):
        tension, lengths = np.max(forces[..., 0], axis=2), beam.mesh.element_lengths
        ratios = tension * lengths**2 / section_values(beam, "EI")[0]
        row, k = map(int, np.unravel_index(np.argmax(ratios), ratios.shape))
        if ratios[row, k] > long:
            layer = lengths[k] / np.sqrt(ratios[row, k])
            cause = (
                f"{beam.name}: the elements of {lengths[k]:.3g} m are too long for its tension of "
                f"{tension[row, k]:.3g} N"
            )
            remedy = (
                f"use elements of at most {_SHORT_ELEMENT * layer:.2g} m ({_SHORT_ELEMENT:g} "
                "sqrt(EI / N)) beside clamps and loads"
            )
            # Rounding does not choose between the beams of a symmetric mechanism.
            ratio = float(f"{ratios[row, k]:.3g}")
            found.append((ratio, BeamDoubt(beam.name, cause, _HALVED, _always(remedy), row, True)))
    return [x for _, x in sorted(found, key=lambda x: -x[0])]


def _always(remedy: str) -> Callable[[float], str]:
    return lambda _: remedy


def find_coarse_beam(
    equations: EquationsOfMotion, q: Array, long: float = LONG
) -> BeamDoubt | None:
    """Return a beam whose elements are long for its tension, or few; None if there is none.

    Parameters
    ----------
    equations
        The equations of motion.
    q
        States (k, n). Of few elements, that with the largest bending moment is compared.
    long
        See `find_taut_beams`.
    """
    taut = find_taut_beams(equations, q, long)
    few = (x.name for x in beams_of(equations.mechanism) if x.mesh.elements <= _FEW_ELEMENTS)
    return taut[0] if taut else find_few_elements(equations, q, set(few))


def find_few_elements(
    equations: EquationsOfMotion, q: Array, names: Container[str]
) -> BeamDoubt | None:
    """Return one of the beams `names`, whose elements are few; None if there is none."""
    for beam, forces in evaluate_forces(equations, q):
        if beam.name in names:
            row = int(np.argmax(np.max(np.abs(forces[..., 2]), axis=(1, 2))))
            return doubt_few_elements([beam])._replace(row=row)
    return None


def doubt_few_elements(beams: Sequence[Beam]) -> BeamDoubt:
    """Return the doubt about beams whose elements are few; the first one has the fewest."""
    few = beams[0].mesh.elements
    names = name_with_others(beams[0].name, [x.name for x in beams[1:]])
    cause = f"{names}: {format_count(few, 'element')} {'is' if few == 1 else 'are'} too few"

    def recommend(change: float) -> str:
        # Large changes may differ from the error: halved elements are not accurate, either.
        factor, use = (2, "use") if change < LARGE_CHANGE else (4, "use at least")
        if len(beams) == 1:
            return f"{use} elements={factor * few}"
        return f"{use} {'twice' if factor == 2 else 'four times'} the elements"

    return BeamDoubt(beams[0].name, cause, _HALVED, recommend)


def evaluate_forces(equations: EquationsOfMotion, q: Array) -> Iterator[tuple[Beam, Array]]:
    """Yield beams, and (N, Q, M) at their stiffness points in states (k, elements, points, 3)."""
    mechanism = equations.mechanism
    if mechanism is None:
        return
    coordinates = map_coordinates(mechanism)
    for beam in beams_of(mechanism):
        forces = beam.kinematics.point_forces(q[:, coordinates.slice_of(beam)])
        if forces is not None:
            yield beam, forces


def sample_instants(trajectory: Trajectory) -> list[Instant]:
    """Return a few states of a run that are stored."""
    ends = np.cumsum([len(x.nodes) for x in trajectory.intervals])
    # Not np.unique, which imports the modules of masked arrays.
    nodes = sorted(set(np.linspace(0, ends[-1] - 1, _ROWS).astype(int).tolist()))
    instants = []
    for k, node in zip(np.searchsorted(ends, nodes, "right").tolist(), nodes, strict=True):
        interval, row = trajectory.intervals[k], node - int(ends[k])
        time = np.array([interval.nodes[row], interval.branch])
        state = State(*(x[row] for x in interval.rows))
        instants.append(Instant(time, state, interval.configuration))
    return instants


def describe_changes(
    equations: EquationsOfMotion,
    doubt: BeamDoubt,
    values: Mapping[str, tuple[float, float]],
    scales: Mapping[str, float],
    when: str = "",
    min_share: float = MIN_SHARE,
    omitted: Collection[str] = (),
    mechanism: Mapping[str, float] = NO_OTHERS,
) -> Iterator[str]:
    """Yield a warning if a value changes by more than 1 % of its scale with more accurate beams.

    Parameters
    ----------
    equations
        The equations of motion.
    doubt
        Why the values were computed again.
    values
        Values of the model and with more accurate beams, by header.
    scales
        Size of the values, by header. Other values are ignored.
    when
        Phrase that follows the first value.
    min_share
        Size relative to the largest value of its kind from which on a value is compared.
    omitted
        Headers of values that are compared elsewhere, or negligible.
    mechanism
        Sizes of the rates and the reactions of all parts, see `measure_mechanism`.
    """
    pairs = {header: pair for header, pair in values.items() if header not in omitted}
    errors = find_changes(equations, pairs, scales, min_share, mechanism=mechanism)
    if not errors:
        return
    worst, *others = errors
    coarse, fine = values[worst]
    also = [f"{remove_unit(x)} {format_percent(errors[x])}" for x in others]
    change = name_with_others(format_percent(errors[worst]), also)
    one, other = format_apart(worst, fine, coarse)
    yield (
        f"{doubt.cause}: {doubt.comparison}, {remove_unit(worst)}{when} is {one} instead of "
        f"{other}, a change of {change}; {doubt.remedy(errors[worst])}."
    )


def scales_of_columns(extremes: Mapping[str, StepExtremes]) -> dict[str, float]:
    """Return the ranges of positions and angles and the largest magnitudes of other columns.

    Rates and accelerations are omitted; see `peaks_of_rates`.
    """
    return {
        header: x.max - x.min
        if Header.of(header).unit in UNITS_OF_POSITIONS
        else max(abs(x.min), abs(x.max))
        for header, x in extremes.items()
        if "/s" not in Header.of(header).unit
    }


def peaks_of_rates(extremes: Mapping[str, StepExtremes]) -> dict[str, float]:
    """Return the largest magnitudes of velocities, angular velocities and accelerations."""
    units = [f"{x}/s{power}" for x in UNITS_OF_POSITIONS for power in ("", "^2")]
    return {
        header: max(abs(x.min), abs(x.max))
        for header, x in extremes.items()
        if Header.of(header).unit in units
    }


def describe_changes_of_rates(errors: Mapping[str, float]) -> str:
    """Return a clause with the changes of peaks, by header, the largest one first."""
    worst, *others = errors
    also = [f"{remove_unit(x)} {format_percent(errors[x])}" for x in others]
    change = name_with_others(format_percent(errors[worst]), also)
    return f"the peak of {remove_unit(worst)} differs by {change}"


def find_changes(
    equations: EquationsOfMotion,
    values: Mapping[str, tuple[float, float]],
    scales: Mapping[str, float],
    min_share: float = MIN_SHARE,
    min_change: float = 0.0,
    mechanism: Mapping[str, float] = NO_OTHERS,
) -> dict[str, float]:
    """Return changes of over 1 % relative to the scale, by header, the largest one first.

    Columns that are rounding errors, or small beside others of their kind, are omitted.
    Deformations and deflections of beams are a kind of their own beside positions.

    Parameters
    ----------
    equations
        The equations of motion.
    values
        Values of the model and with more accurate beams, by header.
    scales
        Size of the values, by header. Other values are ignored.
    min_share
        Size relative to the largest value of its kind from which on a value is compared.
    min_change
        Smallest change relative to the largest value of its kind, of values that are small.
    mechanism
        Sizes of the rates and the reactions of all parts, see `measure_mechanism`.
    """
    of_deformations = _headers_of(equations, Beam.is_deformation)
    compared = [x for x in values if x in scales]
    errors: dict[str, float] = {}
    for are_deformations in (False, True):
        headers = [x for x in compared if (x in of_deformations) == are_deformations]
        sizes = np.array([scales[x] for x in headers])
        lengths = {"m": equations.length, "rad": 1.0}
        rounding = [_ROUNDING * lengths.get(Header.of(x).unit, 0.0) for x in headers]
        is_noise = mark_vanishing_columns(headers, sizes, equations.length, others=mechanism)
        # Moments are not compared with forces: those at clamps are small, but bend the beam.
        is_angle = [Header.of(x).unit == "rad" for x in headers]
        of_kinds = (largest_of_kind(headers, sizes, x) for x in (equations.length, 0.0))
        largest = np.where(is_angle, *of_kinds)
        changes = np.array([abs(values[x][1] - values[x][0]) for x in headers])
        is_noise |= (sizes <= min_share * largest) | (sizes <= rounding)
        is_noise |= changes <= min_change * largest
        errors |= {
            header: float(change / size)
            for header, change, size, noise in zip(headers, changes, sizes, is_noise, strict=True)
            if not noise and _MAX_ERROR < change / size < np.inf
        }
    return dict(sorted(errors.items(), key=lambda x: -x[1]))


def pair_frequencies(
    coarse: Array, fine: Array, lowest: int = 1, least: float = 0.0
) -> dict[str, tuple[float, float]]:
    """Return the lowest natural frequencies above `least` [Hz] of two models, by name.

    Parameters
    ----------
    coarse, fine
        Eigenvalues of the model and with more accurate beams [1/s].
    lowest
        Largest number of frequencies.
    least
        Smallest frequency [Hz].
    """
    rates = (np.sort(x.imag[x.imag > 2.0 * np.pi * least]) for x in (coarse, fine))
    pairs = zip(*((x[:lowest] / (2.0 * np.pi)).tolist() for x in rates), strict=False)
    return {
        f"natural frequency {k} [Hz]" if k > 1 else "lowest natural frequency [Hz]": pair
        for k, pair in enumerate(pairs, 1)
    }


def headers_of_sections(equations: EquationsOfMotion) -> set[str]:
    """Return the headers of stresses, strains and section forces of beams."""
    return _headers_of(equations, lambda x: Beam.sections_of_strains(x) is not None)


def _headers_of(equations: EquationsOfMotion, is_selected: Callable[[Quantity], bool]) -> set[str]:
    """Return the headers of the selected quantities, also of those that sensors measure."""
    mechanism, headers = equations.mechanism, set[str]()
    observed = {} if mechanism is None else mechanism.observables
    for observable in equations.observables:
        one = observed.get(observable.name)
        if one is not None and is_selected(measured_quantity(one)[0]):
            headers.update(observable.headers)
    return headers


def find_refined_instant(
    equations: EquationsOfMotion, halved: RefinedBeams, coarse: Instant, duration: float
) -> Instant | None:
    """Return the instant of a run with more accurate beams and the same accelerations, or None.

    Changes of the positions have the rates 1 / T and 1 / T^2, with the duration T [s].
    """
    # Imported here because few runs need it, and the import slows the start of the others.
    from beamdae.equations.starts.reduced_equations import remove_redundant_constraints

    whole, active, now = halved.equations, halved.equations, coarse.configuration
    if now is not None and whole.configurations is not None:
        now = whole.configurations.configuration_without(whole, now.inactive, now.frozen_gaps)
        active = now.equations
    time, state = coarse.time, coarse.state
    reduction = remove_redundant_constraints(active, time) if active.redundant else None
    reduced = active if reduction is None else reduction.equations
    multipliers = dict(zip(equations.lam_names, state.lam.tolist(), strict=True))
    start = State(
        halved.start + halved.prolongation @ state.q,
        halved.prolongation @ state.v,
        halved.prolongation @ state.a,
        np.array([multipliers[name] for name in reduced.lam_names]),
    )
    fine = _solve(reduced, time, start, duration)
    if fine is None:
        return None
    lam = fine.lam
    if reduction is not None:
        lam = reduction.restore_reactions(time[None], fine.q[None], lam[None])[0]
    multipliers |= dict(zip(active.lam_names, lam.tolist(), strict=True))
    lam = np.array([multipliers[name] for name in whole.lam_names])
    return Instant(time, fine._replace(lam=lam), now)


def _solve(e: EquationsOfMotion, time: Array, state: State, duration: float) -> State | None:
    """Return the state under the same accelerations, by Newton's method; None if it diverges."""
    rate, scales = 1.0 / duration, e.position_scales
    start = state
    for _ in range(_MAX_ITERATIONS):
        tangent = compute_tangent(e, time, state)
        block = tangent.stiffness + rate * tangent.damping + rate**2 * tangent.mass
        rows = tangent.position_jacobian + rate * tangent.velocity_jacobian
        solve = factorize_saddle_point(block, tangent.reactions, rows)
        if solve is None:
            return None
        change = -solve(tangent.residual)
        q = state.q + change[: e.n]
        size = np.max(np.abs(change[: e.n] / scales), initial=0.0)
        if not size < _MAX_STEP:
            return None
        moved = q - start.q
        state = State(
            q, start.v + rate * moved, start.a + rate**2 * moved, state.lam + change[e.n :]
        )
        if size < _TOLERANCE:
            return state
    return None
