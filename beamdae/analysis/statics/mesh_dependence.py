"""Verdicts on stability, and values at the end of a path, that depend on the mesh.

A small eigenvalue of the stiffness may have the wrong sign on a coarse mesh. For example, a hinged
elastica that is bent beyond a figure eight is unstable with an eigenvalue of 1e-3 of the next one.
With 8 elements, it is stable, and a false branch point precedes. Therefore, small eigenvalues
between critical points and at the end of a path are computed again with half the element length.
So is the end of a path at which beams have few elements, or these are long for their axial tension,
see `results.diagnostics.meshes.coarse_elements`, and, with exact strains, the end of a path at
which beams are bent so far that the strains of their floating frame may be wrong.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise, takewhile
from typing import NamedTuple

import numpy as np

from beamdae.analysis.statics.corrector import Corrector, CorrectorError, EquilibriumPoint
from beamdae.analysis.statics.load_scaling import LoadedEquations, Loading, build_loading
from beamdae.analysis.statics.neutral_motions import hold_neutral_motions
from beamdae.analysis.statics.path_controls import (
    Control,
    DisplacementControl,
    LoadControl,
    PathDirection,
    StepNorm,
)
from beamdae.analysis.statics.path_tracing import EquilibriumPath, PathSettings, trace_path
from beamdae.equations.assembly.refined_beams import RefinedBeams, refine_beams
from beamdae.equations.equations_of_motion import EquationsOfMotion, State
from beamdae.equations.measures import ObservedRows
from beamdae.errors import BeamdaeError, hold_messages
from beamdae.results.columns import UNITS_OF_POSITIONS, Header, largest_by
from beamdae.results.diagnostics.meshes.beam_ranges import (
    BeamDoubt,
    BeamRange,
    find_strain_doubt,
    measure_beam_ranges,
)
from beamdae.results.diagnostics.meshes.coarse_elements import (
    MIN_SHARE_AT_REST,
    describe_changes,
    find_coarse_beam,
    headers_of_sections,
)
from beamdae.results.diagnostics.meshes.mesh_errors import LoadedStates, find_negligible_columns
from beamdae.results.equilibrium import CriticalPoint

Array = np.ndarray

# An eigenvalue below this fraction of the next one may have the wrong sign. The errors of the
# smallest eigenvalue of the elastica are 2e-2, 4e-3 and 1e-3 of the next one with 4, 6 and 8
# elements.
_SMALL_EIGENVALUE_RATIO = 2e-2
# Estimated error by strains from which on the end of a path is compared with exact strains. Near a
# critical point, which the estimate does not include, the error of a column at 0.975 of its
# buckling load is 18 times the estimate of 0.8 %.
_MIN_STRAIN_ERROR = 5e-4
# Rotation at the end of a path, relative to the largest one, at which the end is compared.
_SAME_ROTATION = 0.99
_LOAD_FACTOR = "load factor [-]"
# Points times coordinates of paths that are traced again, which takes up to two seconds.
_MAX_TRACED_WORK = 1e5


class StabilityRecheck(NamedTuple):
    """Stability of the points of a path, confirmed by a finer mesh.

    Attributes
    ----------
    unstable
        Number of unstable directions of each point (k,); -1 if two meshes disagree.
    critical
        Critical points without those that the finer mesh does not have.
    notes
        Remarks on points on which the meshes disagree.
    """

    unstable: Array
    critical: tuple[CriticalPoint, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class RefinedPath:
    """Load stages of a path with more accurate beams.

    Attributes
    ----------
    coarse, fine
        Load stages of both mechanisms.
    refined
        The mechanism with more accurate beams.
    """

    coarse: Loading
    fine: Loading
    refined: RefinedBeams

    @classmethod
    def of(cls, coarse: Loading, exact: Collection[str] | None = None) -> RefinedPath | None:
        """Return the stages with halved elements, or None if no beam can be refined.

        If `exact` are names of beams, these have exact strains instead.
        """
        halved = None if exact is None else ()
        refined = refine_beams(coarse.full_equations, exact=exact or (), halved=halved)
        if refined is None:
            return None
        loads = [list(stage) for stage in coarse.stages]
        t = float(coarse.systems[0].loaded.time[0])
        return cls(coarse, build_loading(refined.mechanism, refined.equations, loads, t), refined)

    def transfer(self, point: EquilibriumPoint) -> tuple[LoadedEquations, Array]:
        """Return the fine system of a point, and (q, lam) near the point."""
        k = [system.loaded is point.system.loaded for system in self.coarse.systems].index(True)
        system, n = self.fine.systems[k], self.refined.prolongation.shape[1]
        multipliers = dict(zip(point.system.equations.lam_names, point.x[n:], strict=True))
        lam = [multipliers.get(name, 0.0) for name in system.equations.lam_names]
        x = np.append(self.refined.start + self.refined.prolongation @ point.x[:n], lam)
        if point.system.held_coordinates:
            system = hold_neutral_motions(system, x)
        return system, x

    def negative_count(self, point: EquilibriumPoint, secant: PathDirection) -> int:
        """Return the number of negative eigenvalues on the fine mesh; -1 if it is unknown.

        The equilibrium is sought at the position of `point` along the direction `secant` of the
        path.
        """
        system, x = self.transfer(point)
        e, n = system.equations, self.refined.prolongation.shape[1]
        along = np.append(self.refined.prolongation @ secant.x[:n], np.zeros(e.m))
        motion = StepNorm(e.group_scales, np.inf).max_norm(along)
        # Load and motion contribute equally to the distance along the path.
        # Loads under which no point moves, such as those within a linear element, count alone.
        factor = abs(secant.mu) / (motion or 1.0) if secant.mu else np.inf
        norm = StepNorm(e.group_scales, factor)
        control = norm.arc_length_control(x, point.mu, PathDirection(along, secant.mu))
        try:
            return Corrector(system).correct(control, 0.0, x, point.mu).negative_count
        except CorrectorError:
            return -1

    def correct(self, point: EquilibriumPoint, settings: PathSettings) -> EquilibriumPoint | None:
        """Return the equilibrium with the same load factor or, if given, the same position.

        None if it is not found.
        """
        system, x = self.transfer(point)
        control: Control = LoadControl()
        target = point.mu
        if settings.column:
            time = system.loaded.time
            control, coarse = (
                DisplacementControl.from_name(e, settings.column, time)
                for e in (self.refined.equations, self.coarse.full_equations)
            )
            target = coarse.value(point.x, point.mu)
        try:
            return Corrector(system).correct(control, target, x, point.mu)
        except CorrectorError:
            return None

    def trace(self, q: Array, settings: PathSettings) -> EquilibriumPath | None:
        """Return the path that begins near the positions `q` (n,) of the coarse mechanism.

        None if it does not reach its end.
        """
        with hold_messages():
            try:
                path = trace_path(
                    self.fine, self.refined.start + self.refined.prolongation @ q, settings
                )
            except BeamdaeError:
                return None
        return path if path.status.success else None


class PathComparison(NamedTuple):
    """Comparison of a path with more accurate beams.

    Attributes
    ----------
    notes
        Remarks on values that change by over 1 %.
    has_exact_strains
        True if the beams whose strains may be wrong were compared with exact strains.
    has_critical_points
        True if critical points were compared with those of halved elements.
    """

    notes: tuple[str, ...]
    has_exact_strains: bool
    has_critical_points: bool


class _Comparison(NamedTuple):
    """Remarks on values that change with more accurate beams, and if a path was traced for them."""

    notes: tuple[str, ...]
    is_traced: bool


def compare_path(
    loading: Loading,
    path: EquilibriumPath,
    settings: PathSettings,
    ranges: Sequence[BeamRange],
    q: Array,
) -> PathComparison:
    """Compare the end of a path with exact strains and with halved elements, if these are coarse.

    If the path ends at a given position, the load factor is compared, too. The end is compared with
    exact strains if no beam is more deformed before it. With halved elements, the whole path is
    traced again if it has critical points, or if its end is not found near that of the path or has
    another number of unstable directions; its critical points are compared.

    Parameters
    ----------
    loading, path
        See `recheck_stability`.
    settings
        Settings of the path.
    ranges
        Largest deformations of beams along the path.
    q
        Positions (n,) near which the path begins.
    """
    e, last = loading.full_equations, path.points[-1].x[None, : loading.full_equations.n]
    is_compared = loading.parameter is None and path.status.kind != "interrupted"
    if not is_compared or not (e.observed_headers or path.critical):
        return PathComparison((), False, False)
    coarse = find_coarse_beam(e, last)
    by_mesh = None if coarse is None else _compare(loading, path, settings, coarse, q)
    strained, by_strains = find_strain_doubt(ranges, _MIN_STRAIN_ERROR), None
    if strained is not None:
        doubt, names = strained
        at_end = {x.name: x.rotation for x in measure_beam_ranges(e, last)}
        if all(at_end[x.name] > _SAME_ROTATION * x.rotation for x in ranges if x.name in names):
            by_strains = _compare(loading, path, settings, doubt, q, names)
    notes = tuple(x for one in (by_mesh, by_strains) if one is not None for x in one.notes)
    return PathComparison(notes, by_strains is not None, by_mesh is not None and by_mesh.is_traced)


def _compare(
    loading: Loading,
    path: EquilibriumPath,
    settings: PathSettings,
    doubt: BeamDoubt,
    q: Array,
    exact: Collection[str] | None = None,
) -> _Comparison | None:
    """Return remarks on values that change with more accurate beams, or None if unknown."""
    e, last = loading.full_equations, path.points[-1]
    refined = RefinedPath.of(loading, exact)
    if refined is None:
        return None
    fine, traced = refined.correct(last, settings), None
    is_other = fine is None or fine.negative_count != last.negative_count
    is_short = path.status.success and len(path.points) * e.n <= _MAX_TRACED_WORK
    if exact is None and is_short and (path.critical or is_other):
        traced = refined.trace(q, settings)
    if fine is None and traced is not None:
        fine = traced.points[-1]
    if fine is None:
        return None
    values, scales = _compare_ends(loading, path, refined.fine, fine)
    if settings.column:
        values[_LOAD_FACTOR], scales[_LOAD_FACTOR] = (last.mu, fine.mu), abs(last.mu)
    notes: list[str] = []
    if traced is not None:
        factors = _pair_critical_points(path.critical, traced.critical)
        values |= factors
        scales |= {name: abs(pair[0]) for name, pair in factors.items()}
        further = traced.critical[len(path.critical) :]
        if further and len(factors) == len(path.critical):
            notes.append(
                f"{doubt.cause}: {doubt.comparison}, the path has a {further[0].kind} at the load "
                f"factor {further[0].factor:.6g}; {doubt.remedy(0.0)}."
            )
    # With halved elements, section forces are compared with the loads, see `mesh_errors`.
    omitted = headers_of_sections(e) if exact is None else _find_negligible(e, last, values)
    reactions = largest_by((x.unit for x in e.multipliers), np.abs(last.x[e.n :]).tolist())
    notes += describe_changes(
        e,
        doubt,
        values,
        scales,
        min_share=MIN_SHARE_AT_REST,
        omitted=omitted,
        mechanism=reactions,
    )
    return _Comparison(tuple(notes), traced is not None)


def _compare_ends(
    loading: Loading, path: EquilibriumPath, fine_loading: Loading, fine: EquilibriumPoint
) -> tuple[dict[str, tuple[float, float]], dict[str, float]]:
    """Return the observed columns at the ends of both paths, and their sizes, by header."""
    e = loading.full_equations
    positions = np.array([point.x[: e.n] for point in path.points])
    multipliers = np.array([point.x[e.n :] for point in path.points])
    rows = _observe(
        loading, np.vstack([e.q0, positions]), np.vstack([multipliers[:1], multipliers])
    )
    n = fine_loading.full_equations.n
    (of_fine,) = _observe(fine_loading, fine.x[None, :n], fine.x[None, n:])
    headers = e.observed_headers
    sizes = np.where(
        [Header.of(header).unit in UNITS_OF_POSITIONS for header in headers],
        np.ptp(rows, axis=0),
        np.max(np.abs(rows[1:]), axis=0, initial=0.0),
    )
    pairs = zip(rows[-1].tolist(), of_fine.tolist(), strict=True)
    return dict(zip(headers, pairs, strict=True)), dict(zip(headers, sizes.tolist(), strict=True))


def _find_negligible(
    e: EquationsOfMotion, point: EquilibriumPoint, values: Mapping[str, tuple[float, float]]
) -> set[str]:
    """Return the headers of stresses, strains and section forces that are small along the beam."""
    q, lam = point.x[None, : e.n], np.zeros((1, e.m))
    at = LoadedStates(np.zeros((1, 2)), State(q, np.zeros_like(q), np.zeros_like(q), lam), [])
    return find_negligible_columns(e, lambda x: np.array([values[x][0]]), lambda _: at)


def _pair_critical_points(
    coarse: Sequence[CriticalPoint], fine: Sequence[CriticalPoint]
) -> dict[str, tuple[float, float]]:
    """Return the load factors of critical points on two paths, up to the first different kind."""
    pairs = takewhile(lambda pair: pair[0].kind == pair[1].kind, zip(coarse, fine, strict=False))
    values: dict[str, tuple[float, float]] = {}
    counts = Counter[str]()
    for one, other in pairs:
        counts[one.kind] += 1
        number = counts[one.kind]
        name = f"the {one.kind}" if number == 1 else f"{one.kind} {number}"
        values[f"load factor of {name} [-]"] = one.factor, other.factor
    return values


def _observe(loading: Loading, q: Array, lam: Array) -> Array:
    """Return rows of the observed columns at rest, given rows of the unknowns of a load stage."""
    e, at_rest = loading.full_equations, np.zeros_like(q)
    inactive = frozenset() if e.configurations is None else e.configurations.initially_inactive
    times = np.tile(loading.systems[0].loaded.time, (len(q), 1))
    observe = ObservedRows(e.without_loads_of(inactive))
    return observe(times, q, at_rest, at_rest, loading.full_multipliers(q, lam))


def recheck_stability(loading: Loading, path: EquilibriumPath) -> StabilityRecheck:
    """Compare small eigenvalues of the stiffness with those on a mesh of halved elements.

    Between two critical points, one point with a large eigenvalue proves that the stability does
    change there, and no further eigenvalues are computed. Without such a point, the point with the
    largest eigenvalue ratio is checked, and the end of the path if its ratio is small. If the
    meshes disagree, all points with a small eigenvalue are checked. Points under forces without a
    potential are not checked.

    Parameters
    ----------
    loading
        Load stages of the path.
    path
        The path.
    """
    points = path.points
    unstable = np.array([point.unstable_count for point in points])
    unchanged = StabilityRecheck(unstable, path.critical, ())
    if loading.parameter is not None:
        return unchanged
    rows = [one.row for one in path.critical]
    doubtful = set[int]()
    for first, last in pairwise([-1, *rows, len(points)]):
        doubtful.update(_doubtful_rows(points, range(first + 1, last)))
    # The end of a failed path, for example just before a limit point, is no result.
    last = len(points) - 1
    is_small = last not in rows and points[last].eigenvalue_ratio < _SMALL_EIGENVALUE_RATIO
    if path.status.success and is_small:
        doubtful.add(last)
    if not doubtful:
        return unchanged
    mesh = RefinedPath.of(loading)
    if mesh is None:
        return unchanged

    def disagrees(row: int) -> bool:
        return counts[row] not in (-1, points[row].negative_count)

    counts = {row: _fine_count(mesh, path, row) for row in doubtful}
    if not any(map(disagrees, counts)):
        return unchanged
    for row, point in enumerate(points):
        is_small = point.eigenvalue_ratio < _SMALL_EIGENVALUE_RATIO
        if is_small and row not in rows and row not in counts:
            counts[row] = _fine_count(mesh, path, row)
    undecided = sorted(filter(disagrees, counts))
    unstable[undecided] = -1
    critical = tuple(one for one in path.critical if _is_confirmed(one, path, counts, undecided))
    unstable[[one.row for one in path.critical if one not in critical]] = -1
    notes = tuple(_describe(path, counts, undecided, critical))
    return StabilityRecheck(unstable, critical, notes)


def _doubtful_rows(points: Sequence[EquilibriumPoint], rows: Sequence[int]) -> list[int]:
    """Return the row with the largest eigenvalue ratio, or none if one of them is not small.

    The last point is considered first, because the eigenvalue at the end of a path is needed
    anyway.
    """
    ratios = []
    for row in reversed(rows):
        ratios.append(points[row].eigenvalue_ratio)
        if ratios[-1] >= _SMALL_EIGENVALUE_RATIO:
            return []
    return [rows[::-1][int(np.argmax(ratios))]] if ratios else []


def _fine_count(mesh: RefinedPath, path: EquilibriumPath, row: int) -> int:
    """Return the number of negative eigenvalues at a point on the fine mesh; -1 if unknown.

    The number on the coarse mesh is returned if no neighbor belongs to the same load stage.
    """
    points = path.points
    for one, other in ((row - 1, row), (row, row + 1)):
        if one >= 0 and other < len(points) and points[one].system is points[other].system:
            change = points[other].x - points[one].x
            secant = PathDirection(change, points[other].mu - points[one].mu)
            if np.any(change):
                return mesh.negative_count(points[row], secant)
    return points[row].negative_count


def _is_confirmed(
    critical: CriticalPoint, path: EquilibriumPath, counts: dict[int, int], undecided: list[int]
) -> bool:
    """Return False if the stability on the fine mesh does not change at a critical point.

    It is compared between the nearest points before and after on which the meshes agree, because
    the critical point of the fine mesh may lie at another position. If they disagree up to an end
    of the path, the point there is used. Points unknown on the fine mesh are ignored.
    """
    excluded = {one.row for one in path.critical} | {row for row in counts if counts[row] < 0}
    before = [row for row in range(critical.row) if row not in excluded]
    after = [row for row in range(critical.row + 1, len(path.points)) if row not in excluded]
    if not before or not after or not {before[-1], after[0]}.intersection(undecided):
        return True

    def count(row: int) -> int:
        return counts.get(row, path.points[row].negative_count)

    last = next((row for row in reversed(before) if row not in undecided), before[0])
    first = next((row for row in after if row not in undecided), after[-1])
    return count(last) != count(first)


def _describe(
    path: EquilibriumPath,
    counts: dict[int, int],
    undecided: list[int],
    critical: tuple[CriticalPoint, ...],
) -> Iterator[str]:
    """Yield a remark on the points on which meshes disagree, and one per missing critical point."""
    row = undecided[-1]
    point = path.points[row]
    yield (
        f"equilibrium: the stability of {len(undecided)} points up to the load factor "
        f"{point.mu:.6g} is not decided by this mesh (there, the number of unstable directions is "
        f"{point.negative_count}, but {counts[row]} with elements of half the length); "
        "use more elements."
    )
    for one in path.critical:
        if one not in critical:
            yield (
                f"equilibrium: the {one.kind} at the load factor {one.factor:.6g} is omitted, "
                "because it vanishes with elements of half the length; use more elements."
            )
