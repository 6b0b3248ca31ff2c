"""Warnings about observed stresses, strains and section forces on coarse meshes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

from beamdae.beams.beam import Beam
from beamdae.beams.shape_functions import gauss_points, lagrange_weights
from beamdae.equations.assembly.coordinate_map import map_coordinates
from beamdae.equations.equations_of_motion import EquationsOfMotion, State, format_headers
from beamdae.errors import format_percent, merge_parts, name_with_others
from beamdae.results.columns import remove_unit, split_unit
from beamdae.results.diagnostics.meshes.moving_loads import measured_quantity
from beamdae.results.section_forces.balance import (
    SAME_SECTION_TOLERANCE,
    balanced_and_elastic_forces,
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
# Columns whose largest magnitude is below this share of the largest one along the beam in the run,
# such as moments in hinges, are negligible. The latter is that in this number of rows.
_NEGLIGIBLE_SHARE, _COMPARED_ROWS = 0.05, 50
# Values below this share of those that the largest of N, Q and M / radius of gyration would cause
# have errors relative to this share; those of unloaded sections are rounding errors.
_MIN_STRESS_SHARE = 1e-3
# So do strains below this one in beams without loads, whose rounding errors are up to 1e-12.
_ROUNDING_STRAIN = 1e-10
_SAME_VALUE = 1e-6  # relative difference of values that are not distinguished
# Vibrations of a run are those in this share of its rows, at its end, if their range is at least
# this share of the largest magnitude.
_LATE_SHARE, _MIN_RANGE_SHARE = 1.0 / 3.0, 0.01
_MIN_LATE_ROWS = 10
# If less than this share of the range is indicated at the largest magnitude and at the row of the
# range with the most different value, its error is small.
_NO_INDICATED_ERROR = 1e-3
_LARGER_ERROR = 1.2  # ratio of the errors of this range and of the largest magnitude


class LoadedState(NamedTuple):
    """State of a mechanism and the load factors that act in it.

    Attributes
    ----------
    time
        Time and branch, (1, 2).
    state
        The state as arrays with one row.
    factors
        Load factors by part name; missing factors are 1.
    """

    time: Array
    state: State
    factors: Mapping[str, float]


class _ColumnError(NamedTuple):
    """Largest magnitude or range of a column, and its error.

    Attributes
    ----------
    header
        Header of the column.
    s
        Arc length [m].
    value, balanced
        The value from the strains and the value in equilibrium with the loads.
    relative
        Relative error [-].
    """

    header: str
    s: float
    value: float
    balanced: float
    relative: float


def mesh_error_warnings(
    equations: EquationsOfMotion,
    column_of: Callable[[str], Array],
    state_at: Callable[[int], LoadedState],
    has_vibrations: bool = False,
    excluded: Collection[str] = (),
) -> Iterator[str]:
    """Yield a warning per beam whose stresses, strains or section forces are wrong by over 2 %.

    The columns follow from the strains of one element, whose polynomials do not follow boundary
    layers, such as those near the clamps of beams under tension, of the length sqrt(EI / N), and
    loads within elements. At its largest magnitude, a column is compared with the section forces in
    equilibrium with the loads, whose errors are much smaller; see `SectionForces`. If loads act
    within elements, a largest stress over the length of the beam is compared with that in the
    sections of `section_forces`, which include those at the loads. The range of late vibrations,
    such as those of a rotating blade after its run-up, may have a much larger relative error; it
    has a warning of its own.

    Parameters
    ----------
    equations
        The equations of motion.
    column_of
        Function that returns an observed column (k,) by header.
    state_at
        Function that returns the state of a row of the columns.
    has_vibrations
        True if rows are those of a run, in which ranges of vibrations are compared.
    excluded
        Headers of columns that are wrong for another reason.
    """
    mechanism = equations.mechanism
    errors: dict[Beam, list[_ColumnError]] = {}
    ranges: dict[Beam, list[_ColumnError]] = {}
    evaluator = _Evaluator(equations, state_at)
    for name, observed in ({} if mechanism is None else mechanism.observables).items():
        quantity, names = measured_quantity(observed)
        sections = Beam.sections_of_strains(quantity)
        if sections is None:
            continue
        all_names = [x.name for x in quantity.columns]
        for header, column in zip(format_headers(name, observed.columns), names, strict=True):
            if header in excluded:
                continue
            index, values = all_names.index(column), column_of(header)
            error = evaluator.measure(header, values, quantity, index, *sections)
            limit = MAX_UNREPORTED_ERROR
            if error is not None and error.relative > limit:
                errors.setdefault(sections[0], []).append(error)
                limit = _LARGER_ERROR * error.relative
            if not has_vibrations or Beam.covers_beam(quantity):
                continue
            error = evaluator.measure_late_range(header, values, quantity, index, *sections)
            if error is not None and error.relative > limit:
                ranges.setdefault(sections[0], []).append(error)
    for by_beam, what in (
        (errors, "largest value"),
        (ranges, "range in the last third of the run"),
    ):
        yield from merge_parts(
            (beam.name, max(x.relative for x in of_beam), _describe(beam, of_beam, what))
            for beam, of_beam in by_beam.items()
        )


class _Evaluator:
    """Errors of columns at rows of a result."""

    def __init__(
        self, equations: EquationsOfMotion, state_at: Callable[[int], LoadedState]
    ) -> None:
        arguments = equations, cache(state_at)
        # Columns of one beam often have their extremes in the same row. Cached methods would refer
        # to this object, so that the result of a run would stay in memory until the next garbage
        # collection.
        self._evaluate = cache(partial(_evaluate_forces, *arguments))
        self._evaluate_points = cache(partial(_evaluate_point_forces, *arguments))
        self._select_sections = cache(partial(_select_sections, *arguments))
        self._attached_at = cache(partial(_find_attached_sections, equations))
        self._has_loads_within_elements = cache(partial(_has_loads_within_elements, equations))

    def measure(
        self,
        header: str,
        values: Array,
        quantity: Quantity,
        column: int,
        beam: Beam,
        sections: tuple[float, ...],
    ) -> _ColumnError | None:
        """Return the error of a column at its largest magnitude; None if it is small or zero."""
        row = _find_largest_row(values)
        value = float(values[row])
        if value == 0.0 or not np.isfinite(value):
            return None

        convert = partial(_convert, quantity, column)
        indicated = self._indicate(row, convert, beam, sections)
        # The sections of a largest stress are at element ends. The comparison with further sections
        # takes more time than the whole equilibrium of a small beam.
        has_further_sections = Beam.covers_beam(quantity) and self._has_loads_within_elements(beam)
        if indicated < _MIN_INDICATED_ERROR * abs(value) and not has_further_sections:
            return None
        s = (*sections, *beam.mesh.element_bounds.tolist())
        if has_further_sections:
            s += self._select_sections(beam, row)
        forces = self._evaluate(beam, row, s)
        balanced, elastic = (convert(x, s) for x in forces)
        of_sections = slice(len(sections))
        largest = int(np.argmax(np.abs(balanced[of_sections])))
        change = float(balanced[largest] - elastic[np.argmax(np.abs(elastic[of_sections]))])
        at_sections = float(balanced[largest])
        if indicated < max(_MIN_INDICATED_ERROR * abs(value), _MIN_INDICATED_SHARE * abs(change)):
            change, at_sections = 0.0, max(at_sections, value)
        if has_further_sections:
            largest = int(np.argmax(balanced))
            change += max(float(balanced[largest]) - at_sections, 0.0)
        negligible = _find_negligible_size(convert, beam, s[largest], forces[0])
        scale = max(
            abs(value),
            abs(value + change),
            MIN_SHARE * float(np.max(np.abs(balanced))),
            negligible,
        )
        relative = abs(change) / scale
        if relative > MAX_UNREPORTED_ERROR and not Beam.covers_beam(quantity):
            size = max(abs(value), abs(value + change))
            if self._is_negligible(size, quantity, column, beam, len(values)):
                return None
        return _ColumnError(header, s[largest], value, value + change, relative)

    def measure_late_range(
        self,
        header: str,
        values: Array,
        quantity: Quantity,
        column: int,
        beam: Beam,
        sections: tuple[float, ...],
    ) -> _ColumnError | None:
        """Return the error of the range of a column in late rows; None if it is small or zero."""
        first = int((1.0 - _LATE_SHARE) * len(values))
        late = values[first:]
        rows = [first + int(np.argmin(late)), first + int(np.argmax(late))]
        size = float(np.ptp(values[rows]))
        is_vibration = size > _MIN_RANGE_SHARE * float(np.max(np.abs(values)))
        if len(late) < _MIN_LATE_ROWS or not is_vibration or not np.isfinite(size):
            return None
        convert = partial(_convert, quantity, column)
        # The state of the largest magnitude is known; further ones take time. One of them suffices,
        # because the largest value may be that of a tension that does not bend the beam.
        largest = _find_largest_row(values)
        farther = max(rows, key=lambda row: abs(values[row] - values[largest]))
        indicate = cache(lambda row: self._indicate(row, convert, beam, sections))
        if max(indicate(largest), indicate(farther)) < _NO_INDICATED_ERROR * size:
            return None
        changes, scale = [], size
        for row in rows:
            indicated = indicate(row)
            changes.append(0.0)
            if indicated < _MIN_INDICATED_ERROR * size:
                continue
            forces = self._evaluate(beam, row, sections)
            scale = max(scale, _find_negligible_size(convert, beam, sections[0], forces[0]))
            balanced, elastic = (convert(x, sections) for x in forces)
            change = float(balanced[0] - elastic[0])
            if indicated >= _MIN_INDICATED_SHARE * abs(change):
                changes[-1] = change
        balanced_size = size + changes[1] - changes[0]
        relative = abs(balanced_size - size) / max(scale, balanced_size)
        if relative > MAX_UNREPORTED_ERROR and self._is_negligible(
            max(size, balanced_size), quantity, column, beam, len(values)
        ):
            return None
        return _ColumnError(header, sections[0], size, balanced_size, relative)

    def _indicate(
        self,
        row: int,
        convert: Callable[[Array, tuple[float, ...]], Array],
        beam: Beam,
        sections: tuple[float, ...],
    ) -> float:
        """Return the error that interpolation across the end of an element indicates, or inf."""
        points = self._evaluate_points(beam, row)
        if points is None or beam.mesh.elements == 1:
            return np.inf
        interpolations = _interpolate(beam, points, sections, self._attached_at(beam))
        if interpolations is None:
            return np.inf
        own, smoothed = (convert(x, sections) for x in interpolations)
        return float(np.max(np.abs(smoothed - own)))

    def _is_negligible(
        self, size: float, quantity: Quantity, column: int, beam: Beam, count: int
    ) -> bool:
        """Return True if a column is small beside the largest one along the beam."""
        rows = np.unique(np.linspace(0, count - 1, _COMPARED_ROWS).astype(int))
        along_beam = (self._find_largest(quantity, column, beam, k) for k in rows.tolist())
        return size < _NEGLIGIBLE_SHARE * max(along_beam)

    def _find_largest(self, quantity: Quantity, column: int, beam: Beam, row: int) -> float:
        """Return the largest magnitude of a column at the stiffness points of a beam in a row."""
        points = self._evaluate_points(beam, row)
        if points is None:
            return 0.0
        xi, _ = gauss_points(points.shape[1])
        starts, lengths = beam.mesh.element_bounds[:-1], beam.mesh.element_lengths
        s = (starts[:, None] + 0.5 * (1.0 + xi) * lengths[:, None]).ravel()
        forces = points.reshape(len(s), -1).T
        return float(
            np.max(np.abs(Beam.values_of_section_forces(quantity, forces, s.tolist())[column]))
        )


def _find_largest_row(values: Array) -> int:
    """Return the row of the largest magnitude.

    Steady columns share the first row, instead of rows that rounding chooses.
    """
    sizes = np.abs(values)
    return int(np.argmax(sizes >= (1.0 - _SAME_VALUE) * np.max(sizes)))


def _convert(quantity: Quantity, column: int, forces: Array, s: tuple[float, ...]) -> Array:
    """Return a column of a quantity at arc lengths, given the section forces (3, sections)."""
    return Beam.values_of_section_forces(quantity, forces, s)[column]


def _find_negligible_size(
    convert: Callable[[Array, tuple[float, ...]], Array], beam: Beam, s: float, forces: Array
) -> float:
    """Return the size of a column up to which it is negligible or a rounding error.

    `forces` are section forces (3, sections) of the beam.
    """
    section = beam.section.at(s)
    radius = np.sqrt(section.second_moment / section.area)
    force = np.max(np.abs(forces) / np.array([[1.0], [1.0], [radius]]))
    force = max(_MIN_STRESS_SHARE * force, _ROUNDING_STRAIN * section.EA)
    return float(np.max(np.abs(convert(np.diag([force, force, force * radius]), (s,) * 3))))


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
    equations: EquationsOfMotion, state_at: Callable[[int], LoadedState], beam: Beam, row: int
) -> tuple[float, ...]:
    """Return the arc lengths [m] of `section_forces`, on both sides of loads and jumps."""
    time, state, factors = state_at(row)
    groups = [(np.zeros(1, int), factors)]
    s, before = default_sections(beam, equations, time, state, groups)
    return tuple(np.where(before, beam.mesh.just_before(s), s).tolist())


def _evaluate_forces(
    equations: EquationsOfMotion,
    state_at: Callable[[int], LoadedState],
    beam: Beam,
    row: int,
    s: tuple[float, ...],
) -> tuple[Array, Array]:
    """Return section forces from the loads and from the strains, (3, sections) each."""
    time, state, factors = state_at(row)
    arc_lengths = np.array(s)
    before = arc_lengths > (1.0 - SAME_SECTION_TOLERANCE) * beam.length
    forces = balanced_and_elastic_forces(beam, equations, time, state, arc_lengths, before, factors)
    balanced, elastic = (x[:, 0] for x in forces)
    return balanced, elastic


def _evaluate_point_forces(
    equations: EquationsOfMotion, state_at: Callable[[int], LoadedState], beam: Beam, row: int
) -> Array | None:
    """Return section forces at the stiffness points, see `Kinematics.point_forces`."""
    assert equations.mechanism is not None
    rows = map_coordinates(equations.mechanism).slice_of(beam)
    forces = beam.kinematics.point_forces(state_at(row).state.q[:1, rows])
    return None if forces is None else forces[0]


def _interpolate(
    beam: Beam, points: Array, sections: tuple[float, ...], attached_at: tuple[float, ...]
) -> tuple[Array, Array] | None:
    """Interpolate section forces between the stiffness points, (3, sections) each.

    The first interpolation uses the points of the element only, as the strains do, and the second
    one also the nearest point of an adjacent element. Section forces jump or have kinks at the
    element ends `attached_at` [m]. Return None if an element has no other neighbor.
    """
    mesh = beam.mesh
    distances = np.abs(np.subtract.outer(mesh.element_bounds, [0.0, beam.length, *attached_at]))
    is_smooth = np.min(distances, axis=1) > SAME_SECTION_TOLERANCE * beam.length
    xi_points, _ = gauss_points(points.shape[1])
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
        forces = points[element]
        own.append(np.dot(lagrange_weights(xi_points, xi), forces))
        more_points = np.append(xi_points, side * (1.0 + gap))
        more_forces = np.vstack([forces, points[neighbor][0 if side > 0 else -1]])
        smoothed.append(np.dot(lagrange_weights(more_points, xi), more_forces))
    return np.array(own).T, np.array(smoothed).T


def _describe(beam: Beam, errors: list[_ColumnError], what: str) -> str:
    errors = sorted(errors, key=lambda x: -x.relative)
    worst, unit = errors[0], split_unit(errors[0].header)[1]
    others = [f"{remove_unit(x.header)} {_percent(x)}" for x in errors[1:]]
    # The deformation of a single element is less accurate than the loads suggest.
    least = "at least " if beam.mesh.elements == 1 else ""
    return (
        f"{beam.name}: the mesh error of {remove_unit(worst.header)} is {least}about "
        f"{name_with_others(_percent(worst), others)}: "
        f"its {what}, from the strains, is {worst.value:.4g} "
        f"{unit}, and equilibrium with the loads requires {worst.balanced:.4g} {unit}; use shorter "
        f"elements near s = {worst.s:.4g} m, or solution.section_forces({beam.name!r})."
    )


def _percent(error: _ColumnError) -> str:
    return format_percent(error.relative)
