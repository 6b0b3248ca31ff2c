"""Warnings about observed stresses, strains and section forces on coarse meshes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from functools import cache, partial
from math import ceil
from typing import Any, NamedTuple

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.beams.shape_functions import gauss_points, lagrange_weights
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion, State, format_headers
from beamdae.errors import format_percent, merge_parts, name_with_others
from beamdae.results.columns import remove_unit, split_unit
from beamdae.results.diagnostics.meshes.moving_loads import measured_quantity
from beamdae.results.run_data import RunData
from beamdae.results.section_forces.balance import (
    SAME_SECTION_TOLERANCE,
    RowGroup,
    balanced_and_elastic_forces,
    group_rows,
)
from beamdae.results.section_forces.default_sections import default_sections
from beamdae.symbolic.statements import Quantity

Array = np.ndarray

# In 98 equilibria and runs beside a mesh of 4 times as many elements, 61 have a warning. In 3 of
# these, all errors of its columns are below 1 %; from a limit of 4 %, 1 of 49.
MAX_UNREPORTED_ERROR = 0.02
# Values below this share of the largest one along the beam, such as moments near hinges, have
# errors relative to this share.
MIN_SHARE = 0.25
# Interpolation across the end of an element indicates mesh errors. Columns with a smaller indicated
# error, relative to their largest magnitude, are not compared with the loads, which takes ten times
# as long. Indicated errors are at least 0.15 times the mesh error; smaller ones, of 0.02 to 0.12,
# were measured where the strains of a floating frame are wrong.
_MIN_INDICATED_ERROR = 0.01
_MIN_INDICATED_SHARE = 0.14
# Columns whose largest magnitude is below this share of the largest one along the beam, such as
# moments in hinges, are negligible, and so are ranges below this share of the largest magnitude,
# such as those at free ends after impacts.
_NEGLIGIBLE_SHARE = 0.05
# Values below this share of those that the largest of N, Q and M / radius of gyration would cause
# have errors relative to this share; those of unloaded sections are rounding errors.
_MIN_STRESS_SHARE = 1e-3
# So do strains below this one in beams without loads, whose rounding errors are up to 1e-12.
_ROUNDING_STRAIN = 1e-10
_SAME_VALUE = 1e-6  # relative difference of values that are not distinguished
# Rows of a result that are compared. Its late rows are those in this share of it, at its end.
_COMPARED_ROWS, _LATE_SHARE = 50, 1.0 / 3.0
_MIN_LATE_ROWS = 10
# Share of the rows with the largest errors, and with the smallest ones, that are left out: single
# rows after a start or an impact contain waves that elements do not resolve. With them, errors of
# over 10 times the range were stated after starts with a velocity. In 218 runs beside a mesh of 4
# to 12 times as many elements (leaf spring stages, drops, blades, cantilevers, beams with two
# supports, connecting rods; 1 to 8 elements), 251 columns have a warning about their range, and the
# error varies by less than 1 % of it in 3. Of 693 columns with an error of over 5 % of the range,
# 463 have a warning of this module; in most others, the strains fit the loads of a wrong motion.
_SINGLE_SHARE = 0.05
_LARGER_ERROR = 1.2  # ratio of an error of a range and of one that has a warning already


class LoadedStates(NamedTuple):
    """States of a mechanism and the load factors that act in them.

    Attributes
    ----------
    times
        Rows of time and branch, (k, 2).
    state
        The states, one row per time.
    groups
        Indices of ascending rows and their load factors by part name; missing factors are 1.
    """

    times: Array
    state: State
    groups: Sequence[RowGroup]


class _Column(NamedTuple):
    """Observed column that follows from the strains of a beam.

    Attributes
    ----------
    header
        Header of the column.
    values
        The column, (k,).
    quantity, entry
        The quantity and the index of the column among its columns.
    beam
        The beam.
    sections
        Arc lengths at which the strains are evaluated [m].
    """

    header: str
    values: Array
    quantity: Quantity
    entry: int
    beam: Beam
    sections: tuple[float, ...]

    @property
    def covers_beam(self) -> bool:
        """True for the largest stress over the length of the beam."""
        return Beam.covers_beam(self.quantity)

    def convert(self, forces: Array, s: Sequence[float]) -> Array:
        """Return the column at arc lengths [m], given the section forces (3, ..., sections)."""
        return Beam.values_of_section_forces(self.quantity, forces, s)[self.entry]

    def convert_rows(self, forces: Array) -> Array:
        """Return the column at each section (rows, sections), given the section forces there."""
        return self.convert(forces, self.sections)


class _ColumnError(NamedTuple):
    """Error of a column.

    Attributes
    ----------
    header
        Header of the column.
    s, time
        Arc length [m] and time [s] of the values.
    value, balanced
        The value from the strains and the value in equilibrium with the loads.
    relative
        Relative error [-].
    """

    header: str
    s: float
    time: float
    value: float
    balanced: float
    relative: float


_LARGEST = "largest value"
_RANGE, _LATE_RANGE = "of its range", "of its range in the last third of the run"


class MeshErrors(NamedTuple):
    """Stresses, strains and section forces that are wrong by over 2 %.

    Attributes
    ----------
    columns
        Their headers.
    warnings
        A warning per beam.
    """

    columns: frozenset[str] = frozenset()
    warnings: tuple[str, ...] = ()


def find_mesh_errors(
    equations: EquationsOfMotion,
    column_of: Callable[[str], Array],
    states_at: Callable[[Array], LoadedStates],
    is_run: bool = False,
    excluded: Collection[str] = (),
) -> MeshErrors:
    """Return the stresses, strains and section forces of beams that are wrong by over 2 %.

    The columns follow from the strains of one element, whose polynomials do not follow boundary
    layers, such as those near the clamps of beams under tension, of the length sqrt(EI / N), loads
    within elements and the inertia of long ones. They are compared with the section forces in
    equilibrium with the loads, whose errors are much smaller; see `SectionForces`. At its largest
    magnitude, the error of a column is relative to this magnitude. If loads act within elements, a
    largest stress over the length of the beam is compared with that in the sections of
    `section_forces`, which include those at the loads. In rows of the whole run and of its last
    third, the variation of the error is relative to the range of the column: errors may be small at
    the largest magnitude only, or small beside it, such as those of vibrations about a tension.

    Parameters
    ----------
    equations
        The equations of motion.
    column_of
        Function that returns an observed column (k,) by header.
    states_at
        Function that returns the states of ascending rows of the columns.
    is_run
        True if rows are those of a run, in which ranges are compared.
    excluded
        Headers of columns that are wrong for another reason.
    """
    errors: dict[str, dict[Beam, list[_ColumnError]]] = {}
    columns = list(_list_columns(equations, column_of, excluded))
    evaluator = _Evaluator(equations, states_at, columns)
    for column in columns:
        measures = evaluator.measure_largest(column)
        if is_run and not column.covers_beam:
            measures |= evaluator.measure_ranges(column)
        worst, limit = "", MAX_UNREPORTED_ERROR
        for what, error in measures.items():
            if error.relative > limit:
                worst, limit = what, _LARGER_ERROR * error.relative
        if worst and not evaluator.is_negligible(column):
            errors.setdefault(worst, {}).setdefault(column.beam, []).append(measures[worst])
    warnings: list[str] = []
    for what, by_beam in errors.items():
        warnings += merge_parts(
            (beam.name, max(x.relative for x in of_beam), _describe(beam, of_beam, what))
            for beam, of_beam in by_beam.items()
        )
    every = (x for by_beam in errors.values() for of_beam in by_beam.values() for x in of_beam)
    return MeshErrors(frozenset(x.header for x in every), tuple(warnings))


def find_negligible_columns(
    equations: EquationsOfMotion,
    column_of: Callable[[str], Array],
    states_at: Callable[[Array], LoadedStates],
) -> set[str]:
    """Return the headers of stresses, strains and section forces that are small along the beam.

    See `find_mesh_errors` for the arguments. Their relative errors, such as those of moments in
    hinges, do not matter.
    """
    columns = list(_list_columns(equations, column_of, ()))
    evaluator = _Evaluator(equations, states_at, columns)
    return {column.header for column in columns if evaluator.is_negligible(column)}


def states_at_nodes(run: RunData, rows: Array) -> LoadedStates:
    """Return the states at the nodes next to ascending rows of a run.

    Load factors of inactive parts are zero. See `results.elastic_columns` for states between nodes.
    """
    times, state = run.trajectory.at_nearest_nodes(run.t[rows])
    return LoadedStates(times, state, group_rows(run.trajectory, run.t[rows]))


def _list_columns(
    equations: EquationsOfMotion, column_of: Callable[[str], Array], excluded: Collection[str]
) -> Iterator[_Column]:
    mechanism = equations.mechanism
    for name, observed in ({} if mechanism is None else mechanism.observables).items():
        quantity, names = measured_quantity(observed)
        sections = Beam.sections_of_strains(quantity)
        all_names = [x.name for x in quantity.columns]
        for header, column in zip(format_headers(name, observed.columns), names, strict=True):
            if sections is None or header in excluded:
                continue
            values = column_of(header)
            if values.any() and np.isfinite(values).all():
                yield _Column(header, values, quantity, all_names.index(column), *sections)


class _Evaluator:
    """Errors of columns at rows of a result."""

    def __init__(
        self,
        equations: EquationsOfMotion,
        states_at: Callable[[Array], LoadedStates],
        columns: Sequence[_Column],
    ) -> None:
        self._states_at = cache(lambda rows: states_at(np.array(rows)))
        arguments = equations, self._states_at
        rows = {_find_largest_row(x.values) for x in columns}
        for count in {len(x.values) for x in columns}:
            rows |= set(np.linspace(0, count - 1, _COMPARED_ROWS).astype(int).tolist())
        self._rows = tuple(sorted(rows))
        # Columns of one beam share rows. Cached methods would refer to this object, so that the
        # result of a run would stay in memory until the next garbage collection.
        self._evaluate = cache(partial(_evaluate_forces, *arguments))
        self._evaluate_points = cache(partial(_evaluate_points, *arguments, self._rows))
        self._interpolate = cache(partial(_interpolate, equations, self._evaluate_points))
        self._select_sections = cache(partial(_select_sections, *arguments))
        self._has_loads_within_elements = cache(partial(_has_loads_within_elements, equations))

    def measure_largest(self, column: _Column) -> dict[str, _ColumnError]:
        """Return the error of a column at its largest magnitude, unless it is small."""
        beam, sections, convert = column.beam, column.sections, column.convert
        row = _find_largest_row(column.values)
        value = float(column.values[row])
        indicated = abs(float(self._indicate(column)[self._rows.index(row)]))
        # The sections of a largest stress are at element ends. The comparison with further sections
        # takes more time than the whole equilibrium of a small beam.
        has_further_sections = column.covers_beam and self._has_loads_within_elements(beam)
        if indicated < _MIN_INDICATED_ERROR * abs(value) and not has_further_sections:
            return {}
        s = (*sections, *beam.mesh.element_bounds.tolist())
        if has_further_sections:
            s += self._select_sections(beam, (row,))
        forces, strained = (x[:, 0] for x in self._evaluate(beam, (row,), s))
        balanced, elastic = convert(forces, s), convert(strained, s)
        of_sections = slice(len(sections))
        largest = int(np.argmax(np.abs(balanced[of_sections])))
        change = float(balanced[largest] - elastic[np.argmax(np.abs(elastic[of_sections]))])
        at_sections = float(balanced[largest])
        if indicated < max(_MIN_INDICATED_ERROR * abs(value), _MIN_INDICATED_SHARE * abs(change)):
            change, at_sections = 0.0, max(at_sections, value)
        if has_further_sections:
            largest = int(np.argmax(balanced))
            change += max(float(balanced[largest]) - at_sections, 0.0)
        scale = max(
            abs(value),
            abs(value + change),
            MIN_SHARE * float(np.max(np.abs(balanced))),
            _find_rounding_size(column, s[largest], forces),
        )
        time = float(self._states_at((row,)).times[0, 0])
        error = abs(change) / scale
        return {
            _LARGEST: _ColumnError(column.header, s[largest], time, value, value + change, error)
        }

    def measure_ranges(self, column: _Column) -> dict[str, _ColumnError]:
        """Return the variations of the error of a column over its rows, unless they are small."""
        header, values, beam, sections = column.header, column.values, column.beam, column.sections
        rows, errors, indicated_errors = self._rows, {}, self._indicate(column)
        for what, first in (_RANGE, 0), (_LATE_RANGE, int((1.0 - _LATE_SHARE) * len(values))):
            size = float(np.ptp(values[first:]))
            is_negligible = size < _NEGLIGIBLE_SHARE * np.max(np.abs(values))
            if is_negligible or len(values) - first < _MIN_LATE_ROWS:
                continue
            selected = np.array(rows) >= first
            indicated = _measure_variation(indicated_errors[selected])
            if indicated < _MIN_INDICATED_ERROR * size:
                continue
            forces = self._evaluate(beam, rows, sections)
            balanced, elastic = (np.max(column.convert_rows(x), axis=1)[selected] for x in forces)
            variation = _measure_variation(balanced - elastic)
            if indicated < _MIN_INDICATED_SHARE * variation:
                continue
            scale = max(size, _find_rounding_size(column, sections[0], forces[0].reshape(3, -1)))
            # The largest error of a row that is not left out.
            k = int(np.argsort(np.abs(balanced - elastic))[-1 - ceil(_SINGLE_SHARE * len(elastic))])
            time = float(self._states_at(rows).times[selected, 0][k])
            pair = float(elastic[k]), float(balanced[k])
            errors[what] = _ColumnError(header, sections[0], time, *pair, variation / scale)
        return errors

    def is_negligible(self, column: _Column) -> bool:
        """Return True if a column is small beside the largest one along its beam."""
        beam = column.beam
        points = self._evaluate_points(beam)
        if points is None:
            return False
        xi, _ = gauss_points(points.shape[2])
        starts, lengths = beam.mesh.element_bounds[:-1], beam.mesh.element_lengths
        s = (starts[:, None] + 0.5 * (1.0 + xi) * lengths[:, None]).ravel()
        forces = points.reshape(-1, points.shape[3]).T
        along_beam = np.abs(column.convert(forces, s.tolist() * len(points)))
        return bool(np.max(np.abs(column.values)) < _NEGLIGIBLE_SHARE * np.max(along_beam))

    def _indicate(self, column: _Column) -> Array:
        """Return errors at rows that interpolation across element ends indicates, or infinity."""
        interpolations = self._interpolate(column.beam, column.sections)
        if interpolations is None:
            return np.full(len(self._rows), np.inf)
        own, smoothed = map(column.convert_rows, interpolations)
        errors = smoothed - own
        return errors[np.arange(len(errors)), np.argmax(np.abs(errors), axis=1)]


def _measure_variation(errors: Array) -> float:
    """Return the range of errors (k,) without the largest and the smallest ones."""
    if np.isinf(errors[0]):
        return np.inf
    dropped = ceil(_SINGLE_SHARE * len(errors))
    ordered = np.sort(errors)
    return float(ordered[-1 - dropped] - ordered[dropped])


def _find_largest_row(values: Array) -> int:
    """Return the row of the largest magnitude.

    Steady columns share the first row, instead of rows that rounding chooses.
    """
    sizes = np.abs(values)
    return int(np.argmax(sizes >= (1.0 - _SAME_VALUE) * np.max(sizes)))


def _find_rounding_size(column: _Column, s: float, forces: Array) -> float:
    """Return the size of a column up to which it is negligible or a rounding error.

    `forces` are section forces (3, k) of the beam.
    """
    section = column.beam.section.at(s)
    radius = np.sqrt(section.second_moment / section.area)
    force = np.max(np.abs(forces) / np.array([[1.0], [1.0], [radius]]))
    force = max(_MIN_STRESS_SHARE * force, _ROUNDING_STRAIN * section.EA)
    extreme_forces = np.diag([force, force, force * radius])
    return float(np.max(np.abs(column.convert(extreme_forces, (s,) * 3))))


def _find_attached_sections(equations: EquationsOfMotion, beam: Beam) -> tuple[float, ...]:
    """Return the arc lengths [m] at which parts are attached to a beam."""
    assert equations.mechanism is not None
    return tuple(
        float(attachment.s)
        for part in equations.mechanism.parts.values()
        for attachment in part.attachments
        if attachment.body is beam and attachment.s is not None
    )


def _has_loads_within_elements(equations: EquationsOfMotion, beam: Beam) -> bool:
    """Return True if a part is attached between the ends of an element, or moves along the beam."""
    assert equations.mechanism is not None
    parts: list[Any] = list(equations.mechanism.parts.values())
    return any(part.moves_along_beam and part.beam is beam for part in parts) or not all(
        map(beam.mesh.has_end_at, _find_attached_sections(equations, beam))
    )


def _select_sections(
    equations: EquationsOfMotion,
    states_at: Callable[[tuple[int, ...]], LoadedStates],
    beam: Beam,
    rows: tuple[int, ...],
) -> tuple[float, ...]:
    """Return the arc lengths [m] of `section_forces`, on both sides of loads and jumps."""
    times, state, groups = states_at(rows)
    s, before = default_sections(beam, equations, times, state, list(groups))
    return tuple(np.where(before, beam.mesh.just_before(s), s).tolist())


def _evaluate_forces(
    equations: EquationsOfMotion,
    states_at: Callable[[tuple[int, ...]], LoadedStates],
    beam: Beam,
    rows: tuple[int, ...],
    s: tuple[float, ...],
) -> Array:
    """Return section forces from the loads and from the strains, (2, 3, rows, sections)."""
    times, state, groups = states_at(rows)
    arc_lengths = np.array(s)
    before = arc_lengths > (1.0 - SAME_SECTION_TOLERANCE) * beam.length
    forces = np.empty((2, 3, len(rows), len(s)))
    for k, factors in groups:
        states = State(*(x[k] for x in state))
        forces[:, :, k] = balanced_and_elastic_forces(
            beam, equations, times[k], states, arc_lengths, before, factors
        )
    return forces


def _evaluate_points(
    equations: EquationsOfMotion,
    states_at: Callable[[tuple[int, ...]], LoadedStates],
    rows: tuple[int, ...],
    beam: Beam,
) -> Array | None:
    """Return section forces at the stiffness points, see `Kinematics.point_forces`."""
    assert equations.mechanism is not None
    coordinates = map_coordinates(equations.mechanism).slice_of(beam)
    return beam.kinematics.point_forces(states_at(rows).state.q[:, coordinates])


def _interpolate(
    equations: EquationsOfMotion,
    evaluate_points: Callable[[Beam], Array | None],
    beam: Beam,
    sections: tuple[float, ...],
) -> tuple[Array, Array] | None:
    """Interpolate section forces between the stiffness points, (3, rows, sections) each.

    The first interpolation uses the points of the element only, as the strains do, and the second
    one also the nearest point of an adjacent element. Section forces jump or have kinks at element
    ends where parts are attached. Return None if an element has no other neighbor.
    """
    points = None if beam.mesh.elements == 1 else evaluate_points(beam)
    if points is None:
        return None
    attached_at = _find_attached_sections(equations, beam)
    mesh = beam.mesh
    distances = np.abs(np.subtract.outer(mesh.element_bounds, [0.0, beam.length, *attached_at]))
    is_smooth = np.min(distances, axis=1) > SAME_SECTION_TOLERANCE * beam.length
    xi_points, _ = gauss_points(points.shape[2])
    lengths = mesh.element_lengths
    own, smoothed = [], []
    for s in sections:
        element, xi = mesh.locate(s)
        sides = [1, -1] if xi > 0.0 else [-1, 1]
        side = next((x for x in sides if is_smooth[element + (x + 1) // 2]), None)
        if side is None:
            return None
        neighbor = element + side
        gap = (1.0 - xi_points[-1]) * lengths[neighbor] / lengths[element]
        forces = np.moveaxis(points[:, element], 1, 0)
        own.append(np.tensordot(lagrange_weights(xi_points, xi), forces, 1))
        more_points = np.append(xi_points, side * (1.0 + gap))
        nearest = points[:, neighbor, 0 if side > 0 else -1]
        more_forces = np.concatenate([forces, nearest[None]])
        smoothed.append(np.tensordot(lagrange_weights(more_points, xi), more_forces, 1))
    return np.array(own).T, np.array(smoothed).T


def _describe(beam: Beam, errors: list[_ColumnError], what: str) -> str:
    errors = sorted(errors, key=lambda x: -x.relative)
    worst, unit = errors[0], split_unit(errors[0].header)[1]
    others = [f"{remove_unit(x.header)} {_percent(x)}" for x in errors[1:]]
    # The deformation of a single element is less accurate than the loads suggest.
    least = "at least " if beam.mesh.elements == 1 else ""
    size = f"{least}about {name_with_others(_percent(worst), others)}"
    if what == _LARGEST:
        error = f"is {size}: its largest value, from the strains, is"
    else:
        error = f"varies by {size} {what}: at t = {worst.time:.4g} s, its value from the strains is"
    return (
        f"{beam.name}: the mesh error of {remove_unit(worst.header)} {error} {worst.value:.4g} "
        f"{unit}, and equilibrium with the loads requires {worst.balanced:.4g} {unit}; use shorter "
        f"elements near s = {worst.s:.4g} m, or solution.section_forces({beam.name!r})."
    )


def _percent(error: _ColumnError) -> str:
    return format_percent(error.relative)
