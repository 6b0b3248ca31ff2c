"""Static equations of a load stage with one control equation: plans, loop and its results."""

from __future__ import annotations

import weakref
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import reduce
from itertools import compress
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.analysis.statics.krylov_eigenvalues import KrylovSpace, largest_eigenvalues
from beamdae.analysis.statics.newton_loop import (
    CONVERGED,
    CORRECT,
    COUNT_SIGNS,
    DISPLACE,
    DIVERGED,
    EVALUATE_FORCES,
    EVALUATE_TANGENT,
    EXTEND_SPACE,
    FOLLOW_LOAD,
    HALTED,
    ITERATE,
    LINEARIZE,
    PREDICT,
    SOLVE,
    BorderedWorkspace,
    LoadPart,
    perform_task,
)
from beamdae.analysis.statics.path_controls import (
    Control,
    LinearControl,
    LoadControl,
    PathDirection,
)
from beamdae.analysis.statics.saddle_elimination import (
    ASYMMETRY_TOLERANCE,
    NEGLIGIBLE_STIFFNESS,
    SaddlePoint,
    count_signs_by_scipy,
)
from beamdae.analysis.statics.strain_increments import StrainIncrements
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.static_equations import (
    StaticEquations,
    StaticSums,
    plan_static_sums,
)
from beamdae.equations.starts.rigid_motions import DisplacementMeasure
from beamdae.equations.structure import (
    ConstraintTerm,
    ForceTerm,
    Structure,
    cache_on_owner,
    comparison_key,
    intern_structure,
)
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.linear.factorizations import SingularMatrixError
from beamdae.native.object_code import is_native_enabled
from beamdae.native.return_codes import DONE, NOT_CONVERGED
from beamdae.symbolic.sparse_operators import column_indices
from beamdae.symbolic.sums.kernel_sums import Kernel, SumPlan, set_matrix_factors, set_time

Array = np.ndarray

# Machine code that is not in the cache is compiled when interpreted iterations have taken longer
# than compiling would. Times [s]: of an interpreted iteration, as 100 + n coordinates; of compiling
# a kernel, and more for each of its instructions; and of compiling the loop.
_COORDINATE_SECONDS = 4e-6
_OTHER_COORDINATES = 100
_KERNEL_SECONDS = 0.01
_INSTRUCTION_SECONDS = 6e-5
_LOOP_SECONDS = 3.0

# Load steps in one call of the loop take at most this number of coordinates. Ctrl-C interrupts a
# path between calls.
_PATH_COORDINATES = 40_000
_MAX_STEPS = 100

# Differences of opposite entries up to this fraction of the largest entry are rounding errors, in
# terms that the load factor scales.
_LOAD_ROUNDING = 1e-10
# Loads whose asymmetry in soft motions is below this fraction of their stiffness have a potential:
# forces normal to sections instead of the axis do work on shear strains.
_MIN_LOAD_ASYMMETRY = 1e-5
_SOFT_MOTION_COUNT = 6
# Soft motions of thin beams are sought with this shift of the stiffness, relative to its largest
# entry: larger than rounding errors, and about the bending stiffness of a beam with L/h = 1e6.
_SOFT_SHIFT = 1e-13


# Distance of a parameter from the value about which equations are linearized, in steps.
_CENTER_TOLERANCE = 1e-6

SINGULAR = "the tangent stiffness is singular at the next point"
_FAILURES = {
    DIVERGED: "Newton's method diverges",
    NOT_CONVERGED: "Newton's method did not converge in 15 iterations",
}


class Correction(NamedTuple):
    """Result of Newton's method.

    Attributes
    ----------
    x, mu
        Point (q, lam), (n + m,), and load factor at the end.
    iterations
        Number of iterations.
    failure
        Reason why the point is no equilibrium, without final period; None if it is one.
    motion, correction
        Largest displacements of the equilibrium, in natural sizes, from the given point and from
        that after the step.
    direction
        Derivative of (x, mu) with respect to the control; None if it has not been computed.
    """

    x: Array
    mu: float
    iterations: int
    failure: str | None
    motion: float
    correction: float
    direction: PathDirection | None


class LoadSteps(NamedTuple):
    """Result of steps of load control.

    Attributes
    ----------
    x, mu, iterations
        Equilibria (q, lam), (k, n + m), their load factors and numbers of Newton iterations, (k,).
    all_iterations
        Number of iterations, with those before a step was shortened.
    direction
        Derivative of (x, mu) with respect to the load factor at the last one.
    step
        Proposed size of the next step.
    has_arrived, has_halted
        True at the target, and true if the next step fails or needs further decisions.
    """

    x: Array
    mu: Array
    iterations: Array
    all_iterations: int
    direction: PathDirection
    step: float
    has_arrived: bool
    has_halted: bool


class VariedEquations(NamedTuple):
    """Static equations that depend on a parameter, with values from `begin` to `end`.

    Attributes
    ----------
    at
        Function that returns the equations at a value. They differ in numbers and time only.
    begin, end, step
        First and last value, and step of derivatives by the parameter.
    """

    at: Callable[[float], StaticEquations]
    begin: float
    end: float
    step: float


class NearestModes(NamedTuple):
    """Eigenvalues of Z^T S K S Z nearest to zero, see `Stability`.

    Attributes
    ----------
    eigenvalues, vectors
        Eigenvalues [J], ascending, and orthonormal vectors S^-1 q, (n, number of eigenvalues).
    negative_count
        Number of all negative eigenvalues.
    size
        Size of the entries of S K S [J].
    """

    eigenvalues: Array
    vectors: Array
    negative_count: int
    size: float


class PartPlan(NamedTuple):
    """Plans of one of the parts C, U and L; `tangent` adds to the bordered matrix."""

    residual: SumPlan
    tangent: SumPlan


class BorderedPlan(NamedTuple):
    """Patterns and plans of the static equations of a load stage, without numbers of the model.

    Attributes
    ----------
    sums
        Plans of the parts C, U and L.
    pattern, bordered
        Patterns of the tangent, (n + m, n + m), and of the bordered matrix.
    tangent_targets, tangent_sources
        Indices of the non-zeros of `pattern` in those of `bordered`, and the inverse.
    held_targets, row_targets
        Indices of the springs and of the last row in the non-zeros of `bordered`.
    part_rows
        First coordinate of each part, and the number of coordinates.
    idle_loops
        Compiled loop of a system that no longer exists, which the next system uses: building its
        workspace takes as long as several load steps.
    """

    sums: tuple[PartPlan, ...]
    pattern: sp.csc_array
    bordered: sp.csc_array
    tangent_targets: Array
    tangent_sources: Array
    held_targets: Array
    row_targets: Array
    part_rows: Array
    idle_loops: deque[StepLoop[BorderedWorkspace]]


@cache_on_owner
def _plan_bordered(
    common: Structure,
    unloaded: Structure,
    loaded: Structure,
    held: tuple[int, ...],
    part_rows: tuple[int, ...],
) -> BorderedPlan:
    parts = [plan_static_sums(structure) for structure in (common, unloaded, loaded)]
    patterns = [x.pattern for x in parts]
    ones, shape = np.ones(len(held)), patterns[0].shape
    patterns.append(sp.csc_array((ones, (held, held)), shape=shape))
    union = sp.csc_array(reduce(lambda one, other: one + other, patterns))
    union.sort_indices()
    size = union.shape[0]
    tangent_targets = np.arange(union.nnz) + column_indices(union)
    keys = column_indices(union).astype(np.intp) * size + union.indices
    diagonal = np.searchsorted(keys, [k * (size + 1) for k in held])
    tangent_sources = np.zeros(union.nnz + 2 * size + 1, int)
    tangent_sources[tangent_targets] = np.arange(union.nnz)
    indptr = np.append(union.indptr + np.arange(size + 1), union.nnz + 2 * size + 1)
    row_targets = (indptr[1:] - 1).astype(np.uint32)
    indices = np.zeros(indptr[-1], np.int32)
    indices[tangent_targets], indices[row_targets] = union.indices, size
    indices[indptr[size] :] = np.arange(size + 1)
    entries = (np.ones(len(indices)), indices, indptr)

    def plan(sums: StaticSums) -> PartPlan:
        own = column_indices(sums.pattern).astype(np.intp) * size + sums.pattern.indices
        targets = tangent_targets[np.searchsorted(keys, own)].astype(np.uint32)
        tangent = replace(
            sums.tangent,
            add_targets=targets[sums.tangent.add_targets],
            weighted_targets=targets[sums.tangent.weighted_targets],
        )
        return PartPlan(sums.residual, tangent)

    return BorderedPlan(
        sums=tuple(map(plan, parts)),
        pattern=union,
        bordered=sp.csc_array(entries, shape=(size + 1, size + 1)),
        tangent_targets=tangent_targets,
        tangent_sources=tangent_sources,
        held_targets=tangent_targets[diagonal].astype(np.uint32),
        row_targets=row_targets,
        part_rows=np.array(part_rows, np.intp),
        idle_loops=deque(maxlen=1),
    )


def _has_entries(plan: SumPlan) -> bool:
    return len(plan.add_targets) > 0 or len(plan.weighted_targets) > 0


@dataclass
class Usage:
    """Estimated time of the interpreted iterations with a structure in this process [s].

    The time of what has been compiled is subtracted.
    """

    seconds: float = 0.0


@cache_on_owner
def _usage_of(structure: Structure) -> Usage:
    # Paths share this count; that threads may lose a few evaluations does not matter.
    return Usage()


@cache_on_owner
def _term_keys(structure: Structure) -> tuple[tuple[tuple[Any, ...], slice], ...]:
    """Return keys of kernels and operators, and the data, of all terms: forces, then joints."""

    def key(term: ForceTerm | ConstraintTerm) -> tuple[Any, ...]:
        # Forces and joints have different kernels, so that their keys differ.
        return tuple(comparison_key(x) for name, x in vars(term).items() if name != "data")

    terms: tuple[ForceTerm | ConstraintTerm, ...] = (*structure.forces, *structure.joints)
    return tuple((key(term), term.data) for term in terms)


def _split_structures(
    unloaded: EquationsOfMotion, loaded: EquationsOfMotion
) -> tuple[Structure, Structure, Structure]:
    """Return the common terms of both equations, and those of only one of them.

    Common terms have equal kernels, operators and numbers.
    """
    keys = [
        [(key, e.p[data].tobytes()) for key, data in _term_keys(e.structure)]
        for e in (unloaded, loaded)
    ]
    counts = [Counter(x) for x in keys]
    is_common: list[tuple[bool, ...]] = []
    for own, other in zip(keys, reversed(counts), strict=True):
        flags = []
        for key in own:
            flags.append(other[key] > 0)
            other[key] -= 1
        is_common.append(tuple(flags))
    only_unloaded, only_loaded = (tuple(not x for x in flags) for flags in is_common)
    return (
        _select_terms(unloaded.structure, is_common[0]),
        _select_terms(unloaded.structure, only_unloaded),
        _select_terms(loaded.structure, only_loaded),
    )


@cache_on_owner
def _select_terms(structure: Structure, is_selected: tuple[bool, ...]) -> Structure:
    if all(is_selected):
        # Structures too large to be shared keep the plans of `StaticEquations`.
        return structure
    count = len(structure.forces)
    forces = tuple(compress(structure.forces, is_selected[:count]))
    joints = tuple(compress(structure.joints, is_selected[count:]))
    return intern_structure(replace(structure, forces=forces, joints=joints, states=()))


def _iterate_inversely(inverse: Callable[[Array], Array], vectors: Array) -> Array:
    """Return an orthonormal basis after two inverse iterations of `vectors`, (n, k)."""
    for _ in range(2):
        vectors = np.linalg.qr(inverse(vectors))[0]
    return vectors


class BorderedSystem:
    """Static equations of one load stage, evaluated and solved by machine code if available.

    Do not share an instance between threads.

    Parameters
    ----------
    unloaded, loaded
        Equations without and with the loads of the stage; the same object if no load is scaled.
    time
        (t, branch), at which laws are evaluated.
    held
        Indices of coordinates with springs that act on the tangent F_x alone.
    varied
        Equations that depend on a parameter in place of the load factor, or None. The parts U and L
        are then those at its value and a step beside it, and there is no common part C.

    Attributes
    ----------
    pattern
        CSC pattern of the tangent F_x, (n + m, n + m).
    increments
        Finite displacements.
    measure
        Measure of displacements, for the size of corrections.
    """

    def __init__(
        self,
        unloaded: EquationsOfMotion,
        loaded: EquationsOfMotion,
        time: Array,
        held: tuple[int, ...] = (),
        varied: VariedEquations | None = None,
    ) -> None:
        self._time, self._n = time, loaded.n
        self._varied = varied
        self._part_scales = loaded.part_scales
        if varied is None:
            common, only_unloaded, only_loaded = _split_structures(unloaded, loaded)
        else:
            only_unloaded = only_loaded = loaded.structure
            common = _select_terms(loaded.structure, (False,) * len(_term_keys(loaded.structure)))
        self._numbers = (unloaded.p, unloaded.p, loaded.p)
        self._usage = _usage_of(common)
        part_rows = (*(part.rows.start for part in loaded.parts), loaded.n)
        plan = _plan_bordered(common, only_unloaded, only_loaded, held, part_rows)
        self._idle_loops = plan.idle_loops
        self.pattern, self._bordered, self._plans = plan.pattern, plan.bordered, plan.sums
        self._tangent_targets = plan.tangent_targets
        self._tangent_sources = plan.tangent_sources
        self._held_targets, self._row_targets = plan.held_targets, plan.row_targets
        self._part_rows = plan.part_rows
        self._held, size = np.array(held, np.intp), plan.pattern.shape[0]
        self._has_load_stiffness = any(map(_has_entries, (x.tangent for x in plan.sums[1:])))
        self._evaluated_x = np.full(size, np.nan)
        self._follows: bool | None = None
        # Tests compare symmetric elimination with pivots chosen by size.
        self._eliminates = True
        self._initial_q = loaded.q0
        self.increments = StrainIncrements.of(loaded)
        self.measure = replace(DisplacementMeasure.of(loaded), scale=loaded.group_scales)
        loop = self._take_idle_loop() or self._make_loop(compiles=False)
        self._set_loop(loop)
        self._compilation_seconds = np.inf if self.is_native else self._estimate_compilation()

    def _take_idle_loop(self) -> StepLoop[BorderedWorkspace] | None:
        """Return a loop with a workspace of the same layout, if there is one."""
        try:
            loop = self._idle_loops.pop()
        except IndexError:
            return None
        axes = loop.work.axes
        if axes.plan is self.increments.axes.plan and is_native_enabled():
            self.increments = replace(self.increments, axes=axes)
            loop.forget_pivots()
            return loop
        return None

    def _set_loop(self, loop: StepLoop[BorderedWorkspace]) -> None:
        """Use a loop, with the numbers of this system."""
        self._loop, run = loop, loop.work
        for part, plans, p in zip(
            (run.common, run.unloaded, run.loaded), self._plans, self._numbers, strict=True
        ):
            for plan, total in zip(plans, (part.residual, part.tangent), strict=True):
                plan.set_data(total, p)
                set_time(total, *self._time)
        run.points[:], run.distance_weights[:] = self.measure.point, self.measure.scale**-2.0
        run.reference[: self._n], run.needs_scales = self._initial_q, 1
        run.saddle.part_scales[:] = self._part_scales
        run.center, run.scale = 0.0, 1.0
        if self._varied is not None:
            run.scale = 0.0
            self._center(self._varied.begin)
        self._evaluated_x[:] = np.nan
        if loop.is_native:
            weakref.finalize(self, self._idle_loops.append, loop).atexit = False

    def _make_loop(self, compiles: bool) -> StepLoop[BorderedWorkspace]:
        size, nnz = self.pattern.shape[0], self._bordered.nnz
        matrix = FactorizedMatrix.from_pattern(self._bordered)
        rows = min(max(_PATH_COORDINATES // size, 1), _MAX_STEPS)

        def make_part(plans: tuple[SumPlan, SumPlan], p: Array, native: bool) -> LoadPart:
            residual, tangent = (plan.sum(native, p) for plan in plans)
            # The factors of damping and mass are not used.
            set_matrix_factors(tangent, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
            return LoadPart(residual, tangent, np.zeros(size), np.zeros(nnz))

        def make(native: bool) -> BorderedWorkspace:
            common, unloaded, loaded = (
                make_part(plans, p, native)
                for plans, p in zip(self._plans, self._numbers, strict=True)
            )
            return BorderedWorkspace(
                common=common,
                unloaded=unloaded,
                loaded=loaded,
                linear=matrix.make_solver(native, "auto"),
                saddle=SaddlePoint.of(self.pattern, self._tangent_targets, self._part_rows),
                space=KrylovSpace.allocate(self._n),
                nonzeros=matrix.nonzeros,
                inputs=np.zeros(self._n + size),
                forces=np.zeros(size),
                by_factor=np.zeros(size),
                row=np.zeros(size + 1),
                row_targets=self._row_targets,
                row_sources=np.arange(size + 1, dtype=np.uint32),
                column=np.zeros(size),
                right=np.zeros(size + 1),
                solution=np.zeros(size + 1),
                negative=np.zeros(size + 1),
                residual=np.zeros(size + 1),
                change=np.zeros(size + 1),
                response=np.zeros(size),
                reference=np.zeros(self._n + size),
                held_targets=self._held_targets,
                held=np.zeros(len(self._held)),
                held_rows=self._held,
                rows=self._bordered.indices.astype(np.uint32),
                columns=column_indices(self._bordered).astype(np.uint32),
                weights=np.append(1.0 / self.measure.scale, np.zeros(size + 1 - self._n)),
                origin=np.zeros(size),
                axes=self.increments.axes,
                displaced=np.zeros(self._n),
                predicted=np.zeros(self._n),
                begin=np.zeros(self._n),
                squares=np.zeros(self._n),
                distances=np.zeros(self._n),
                points=np.zeros(self._n, np.uint32),
                distance_weights=np.zeros(self._n),
                path=np.zeros((rows + 1, size)),
                path_factors=np.zeros(rows + 1),
                path_iterations=np.zeros(rows + 1, np.intp),
                direction=np.zeros(size + 1),
                tangent=np.zeros(size + 1),
                base=np.zeros(size),
                offset=np.zeros(size + 1),
                column_start=int(self._bordered.indptr[size]),
                has_frames=int(len(self.increments.frame_axes) > 0),
            )

        native = all(plan.load_native(compiles) for plans in self._plans for plan in plans)
        return StepLoop(perform_task, make, lambda run: [(run.linear, matrix)], native, compiles)

    @property
    def is_native(self) -> bool:
        """True if machine code evaluates the equations."""
        return self._loop.is_native

    @property
    def scales(self) -> Array:
        """Natural sizes of the coordinates for the stiffness, (n,), see `scale_by_reference`."""
        run = self._loop.work
        if run.needs_scales:
            zeros = np.zeros(len(run.forces) - self._n)
            self._run(np.append(self._initial_q, zeros), 0.0, EVALUATE_FORCES)
        return run.saddle.scales[: self._n].copy()

    def residual(self, x: Array, mu: float) -> tuple[Array, Array]:
        """Return F and F_mu at x = (q, lam), (n + m,) each."""
        run = self._loop.work
        if not (run.has_forces and mu == run.mu and np.array_equal(x, self._evaluated_x)):
            run = self._run(x, mu, EVALUATE_FORCES)
        return run.forces.copy(), run.by_factor.copy()

    def tangent(self, x: Array, mu: float) -> Array:
        """Return the non-zeros of F_x on `pattern`."""
        return self._run(x, mu, EVALUATE_TANGENT).nonzeros[self._tangent_targets]

    def count_negative_eigenvalues(self, x: Array, mu: float) -> int | None:
        """Return the number of negative eigenvalues of the stiffness in the possible motions.

        The result is None if it is not certain: if an eigenvalue is zero up to rounding errors, or
        the stiffness is not symmetric.
        """
        run = self._loop.work
        self._set_point(x, mu)
        if not run.has_tangent:
            self._run(x, mu, EVALUATE_TANGENT)
        # Loads without stiffness, such as weight, have a potential.
        if run.load_stiffness != 0.0 and self.has_follower_loads(x, mu):
            return None
        if self.is_native:
            signs = (run if run.has_signs else self._run(x, mu, COUNT_SIGNS)).saddle
        else:
            run = self._run(x, mu, EVALUATE_TANGENT)
            signs = run.saddle
            count_signs_by_scipy(signs, run.nonzeros)
        is_symmetric = signs.asymmetry <= ASYMMETRY_TOLERANCE * signs.size
        is_symmetric = is_symmetric or self.has_negligible_asymmetry(x, mu)
        is_certain = signs.below == signs.above >= 0 and signs.size > NEGLIGIBLE_STIFFNESS
        if not (is_symmetric and is_certain):
            return None
        return signs.above - (len(x) - self._n)

    def has_follower_loads(self, x: Array, mu: float) -> bool:
        """Return True if the scaled loads have no potential in slow motions.

        Next to the axial stiffness of a thin beam, the asymmetry of a follower load is lost in
        rounding. Therefore, the terms that the load factor scales are compared with each other, in
        the span of a few motions with little stiffness. The result is that of the first point at
        which these terms are asymmetric.
        """
        if not self._has_load_stiffness:
            return False
        run, n = self._loop.work, self._n
        self._set_point(x, mu)
        if not run.has_tangent:
            self._run(x, mu, EVALUATE_TANGENT)
        saddle = run.saddle
        share = (mu - run.center) * run.scale
        loads = share * run.loaded.nonzeros + (1.0 - share) * run.unloaded.nonzeros
        terms = saddle.weights * loads[saddle.entries]
        size = float(np.max(np.abs(terms), initial=0.0))
        if size == 0.0:
            return False
        if self._follows is None:
            differences = saddle.skew_signs * terms[saddle.skew_sources]
            skew = np.bincount(saddle.skew_rows, differences)
            if np.max(np.abs(skew), initial=0.0) <= _LOAD_ROUNDING * size:
                return False
            rows, columns = (
                indices[self._tangent_sources[saddle.entries]]
                for indices in (self.pattern.indices, column_indices(self.pattern))
            )
            stiffness = sp.csc_array((terms, (rows, columns)), shape=(n, n))
            soft = self._soft_motions(x, mu)
            if not soft.shape[1]:
                return False
            reduced = soft.T @ (stiffness @ soft)
            asymmetry = float(np.max(np.abs(reduced - reduced.T)))
            self._follows = asymmetry > _MIN_LOAD_ASYMMETRY * float(np.max(np.abs(reduced)))
        return self._follows

    def has_negligible_asymmetry(self, x: Array, mu: float) -> bool:
        """Return True if only scaled loads that have a potential make the stiffness asymmetric.

        `has_follower_loads` decides which loads have a potential.
        """
        if self.has_follower_loads(x, mu) or self._follows is None:
            return False
        saddle = self._loop.work.saddle
        entries = saddle.weights * self._loop.work.common.nonzeros[saddle.entries]
        skew = np.bincount(saddle.skew_rows, saddle.skew_signs * entries[saddle.skew_sources])
        size = float(np.max(np.abs(entries), initial=0.0))
        return float(np.max(np.abs(skew), initial=0.0)) <= ASYMMETRY_TOLERANCE * size

    def _soft_motions(self, x: Array, mu: float) -> Array:
        """Return orthonormal motions S^-1 q, (n, k), with little stiffness, by inverse iteration.

        They are not computed accurately: if rounding errors make the stiffness of thin beams
        singular, it is shifted. The result has no columns if it is singular nevertheless.
        """
        n, size = self._n, len(x)
        count = min(_SOFT_MOTION_COUNT, 2 * n - size)
        start = np.cos(np.outer(np.arange(n) ** 2.0, np.arange(1.0, count + 1.0)))
        load_control, column = (np.zeros(size), 1.0), np.zeros(size)

        def respond(forces: Array) -> Array:
            motions = np.zeros((n, count))
            for k in range(count):
                right = np.concatenate([forces[:, k] / self.scales, np.zeros(size + 1 - n)])
                solution = self.solve(x, mu, load_control, column, right)
                motions[:, k] = solution[:n] / self.scales
            return motions

        try:
            return _iterate_inversely(respond, start)
        except SingularMatrixError:
            pass
        try:
            return _iterate_inversely(self._shifted_inverse(x, mu), start)
        except RuntimeError:
            return start[:, :0]

    def _shifted_inverse(self, x: Array, mu: float) -> Callable[[Array], Array]:
        """Return a function that maps forces S f to motions S^-1 q, with a shifted stiffness.

        Raises
        ------
        RuntimeError
            If the shifted stiffness is singular.
        """
        n, size = self._n, len(x)
        run = self._run(x, mu, EVALUATE_TANGENT)
        values, pattern = run.nonzeros[self._tangent_targets], self.pattern
        tangent = sp.csc_array((values, pattern.indices, pattern.indptr), shape=pattern.shape)
        scales = run.saddle.scales
        shift = np.where(np.arange(size) < n, _SOFT_SHIFT * run.saddle.size, 0.0)
        scaled = tangent * scales * scales[:, None] + sp.diags_array(shift)
        solver = splu(sp.csc_matrix(scaled))
        return lambda forces: solver.solve(
            np.vstack([forces, np.zeros((size - n, forces.shape[1]))])
        )[:n]

    def nearest_modes(
        self, x: Array, mu: float, count: int, tolerance: float, with_vectors: bool = True
    ) -> NearestModes | None:
        """Return the eigenvalues of the stiffness nearest to zero, or None.

        The result is None without machine code, if `count_negative_eigenvalues` is None, or if the
        eigenvalues do not converge.

        Parameters
        ----------
        x, mu
            Equilibrium.
        count
            Number of eigenvalues; all of them if there are fewer.
        tolerance, with_vectors
            See `krylov_eigenvalues.largest_eigenvalues`.
        """
        if not self.is_native:
            return None
        negative_count = self.count_negative_eigenvalues(x, mu)
        if negative_count is None:
            return None
        run, n, m = self._loop.work, self._n, len(x) - self._n
        saddle = run.saddle

        def extend(blocks: int) -> None:
            run.task, run.space.blocks_to_add = EXTEND_SPACE, blocks
            self._loop()

        try:
            inverse, vectors = largest_eigenvalues(
                run.space, extend, min(count, n - m), tolerance, with_vectors
            )
        except ArithmeticError:
            return None
        eigenvalues = 1.0 / inverse - saddle.last_shift
        order = eigenvalues.argsort()
        if with_vectors:
            vectors = vectors[:, order]
        return NearestModes(eigenvalues[order], vectors, negative_count, saddle.size)

    def correct(
        self,
        control: Control,
        target: float,
        x: Array,
        mu: float,
        step: PathDirection | None = None,
        continues: bool = False,
    ) -> Correction:
        """Find the equilibrium at which the control equals `target`, by Newton's method.

        Parameters
        ----------
        control, target
            Control and its value.
        x, mu
            Start of the iteration, or start of `step`.
        step
            Displacement with which the iteration begins, or None.
        continues
            True to compute also signs of pivots and the direction of the path, if the machine code
            can.
        """
        self._compile_if_used(1)
        run, n = self._loop.work, self._n
        self._set_point(x, mu)
        run.begin[:] = run.predicted[:] = x[:n]
        run.task, run.phase, run.iterations, run.last_size = CORRECT, ITERATE, 0, np.inf
        run.is_nonlinear = int(not control.is_linear)
        can_continue = self.is_native and control.is_linear and continues
        run.continues, run.has_direction = int(can_continue), 0
        if step is not None:
            run.solution[:-1], run.solution[-1] = step.x, step.mu
            run.phase = PREDICT
        is_at_value = isinstance(control, LoadControl)
        if self._varied is not None:
            self._center(target if is_at_value else mu + (0.0 if step is None else step.mu))
        self._set_control(control.linearize(x, mu), target)
        # The point changes within the loop.
        self._evaluated_x[:] = np.nan
        while (code := self._call()) in (DISPLACE, LINEARIZE) or self._is_off_center(code):
            if code == DISPLACE:
                self.increments.displace_frames(run.inputs, run.solution, run.displaced)
            elif code == LINEARIZE:
                self._set_control(control.linearize(self._point(), run.mu), target)
            else:
                self._center(run.mu)
                run.phase, run.last_size = ITERATE, np.inf
        self._evaluated_x[:] = end = self._point()
        self._compile_if_used(run.iterations - 1)
        failure = None
        if run.phase != CONVERGED:
            run.linear.singular = 0
            failure = _FAILURES.get(code, SINGULAR)
            if code != DIVERGED and not np.isfinite(np.append(run.forces, run.deviation)).all():
                failure = "the forces are not finite at the next point"
        direction = None
        if run.has_direction and np.isfinite(run.solution).all():
            direction = PathDirection(run.solution[:-1].copy(), float(run.solution[-1]))
        sizes = float(run.motion), float(run.correction)
        return Correction(end, float(run.mu), run.iterations, failure, *sizes, direction)

    def follow_load(
        self,
        point: tuple[Array, float],
        direction: PathDirection,
        target: float,
        steps: tuple[float, float],
        negative_count: int,
        max_steps: int,
    ) -> LoadSteps | None:
        """Take steps of load control on which the number of negative eigenvalues does not change.

        They end before a step that fails or at which this number is another one or not certain.
        The result is None without machine code and with beams in a floating frame.

        Parameters
        ----------
        point
            Equilibrium (x, mu) at which the path begins.
        direction
            Derivative of the path with respect to the load factor there.
        target
            Load factor at the end.
        steps
            Proposed and largest step.
        negative_count
            Number of negative eigenvalues of the stiffness there.
        max_steps
            Maximum number of steps.
        """
        run, (x, mu) = self._loop.work, point
        if not self.is_native or run.has_frames or self._varied is not None:
            return None
        self._set_point(x, mu)
        self._set_control(LoadControl().linearize(x, mu), target)
        self._evaluated_x[:] = np.nan
        run.task, run.is_nonlinear, run.continues = FOLLOW_LOAD, 0, 1
        run.direction[:-1], run.direction[-1] = direction.x, direction.mu
        (run.step, run.max_step), run.load_target = steps, target
        run.negative_pivots = negative_count + len(x) - self._n
        run.max_steps = min(max_steps, len(run.path) - 1)
        code = self._call()
        taken = slice(1, run.step_count + 1)
        if code != HALTED:
            self._evaluated_x[:] = self._point()
        return LoadSteps(
            run.path[taken].copy(),
            run.path_factors[taken].copy(),
            run.path_iterations[taken].copy(),
            run.all_iterations,
            PathDirection(run.direction[:-1].copy(), float(run.direction[-1])),
            run.step,
            code == DONE,
            code == HALTED,
        )

    def _set_control(self, control: LinearControl, target: float) -> None:
        run = self._loop.work
        run.origin[:], run.origin_mu = control.x, control.mu
        run.excess = control.at_origin - target
        self._set_row((control.along, control.along_mu))

    def _point(self) -> Array:
        """Return x = (q, lam) of the last evaluation."""
        inputs, n = self._loop.work.inputs, self._n
        return np.concatenate([inputs[:n], inputs[2 * n :]])

    def solve(
        self, x: Array, mu: float, gradient: tuple[Array, float], column: Array, right: Array
    ) -> Array:
        """Return the solution of the bordered system with another last column.

        Raises
        ------
        SingularMatrixError
            If the bordered matrix is singular or not finite.
        """
        run = self._loop.work
        self._set_row(gradient)
        run.column[:], run.right[:] = column, right
        return self._run(x, mu, SOLVE).solution.copy()

    def _compile_if_used(self, iterations: int) -> None:
        """Count iterations; compile kernels, then the loop, when this takes less time."""
        if self.is_native:
            return
        usage = self._usage
        usage.seconds += iterations * _COORDINATE_SECONDS * (_OTHER_COORDINATES + self._n)
        while not self.is_native and usage.seconds > self._compilation_seconds:
            usage.seconds -= self._compilation_seconds
            missing = self._missing_kernels()
            for kernel in missing:
                kernel.load_native()
            self._set_loop(self._make_loop(compiles=not missing))
            was_compiled = not self._missing_kernels() if missing else self.is_native
            self._compilation_seconds = self._estimate_compilation() if was_compiled else np.inf

    def _missing_kernels(self) -> list[Kernel]:
        """Return the kernels whose machine code is not in the cache."""
        kernels = {
            id(batch.kernel): batch.kernel
            for plans in self._plans
            for plan in plans
            for batch in plan.batches
        }
        return [x for x in kernels.values() if x.load_native(compiles=False) is None]

    def _estimate_compilation(self) -> float:
        """Return the time of compiling the missing kernels or, if there are none, the loop [s]."""
        if not is_native_enabled():
            return np.inf
        missing = self._missing_kernels()
        seconds = [
            _KERNEL_SECONDS + _INSTRUCTION_SECONDS * kernel.function.n_instructions()
            for kernel in missing
        ]
        return sum(seconds) if missing else _LOOP_SECONDS

    def _set_row(self, gradient: tuple[Array, float]) -> None:
        row = self._loop.work.row
        row[:-1], row[-1] = gradient

    def _run(self, x: Array, mu: float, task: int) -> BorderedWorkspace:
        run = self._loop.work
        self._set_point(x, mu)
        run.task = task
        if self._call() != DONE:
            run.linear.singular = 0
            raise SingularMatrixError("the matrix is singular")
        return run

    def _set_point(self, x: Array, mu: float) -> None:
        run, n = self._loop.work, self._n
        if not np.array_equal(x, self._evaluated_x):
            self._evaluated_x[:] = x
            run.inputs[:n], run.inputs[2 * n :] = x[:n], x[n:]
            run.has_forces = run.has_tangent = run.has_signs = run.has_factors = 0
        if mu != run.mu:
            run.has_forces = run.has_signs = run.has_factors = 0
        run.mu = mu
        if self._is_off_center(DONE):
            self._center(mu)

    def _is_off_center(self, code: int) -> bool:
        """Return True if a result is that of the linearization about another parameter value."""
        run = self._loop.work
        distance = abs(run.mu - run.center) * run.scale
        return self._varied is not None and code == DONE and distance > _CENTER_TOLERANCE

    def _center(self, value: float) -> None:
        """Evaluate the equations, and their derivative by the parameter, about a value of it."""
        assert self._varied is not None
        run, step = self._loop.work, self._varied.step
        pair = self._varied.at(value), self._varied.at(value + step)
        # The step must not lead into the next piece of a law.
        branch = float(pair[0].time[1])
        parts = (run.unloaded, run.loaded)
        for part, plans, static in zip(parts, self._plans[1:], pair, strict=True):
            for plan, total in zip(plans, (part.residual, part.tangent), strict=True):
                plan.set_data(total, static.equations.p)
                set_time(total, float(static.time[0]), branch)
        run.center, run.scale = value, 1.0 / step
        run.has_forces = run.has_tangent = run.has_signs = run.has_factors = 0

    def _call(self) -> int:
        """Run the loop; return its code."""
        run = self._loop.work
        run.renews = run.may_renew = int(self.is_native)
        run.eliminates = run.may_eliminate = int(self.is_native and self._eliminates)
        if self.is_native:
            return self._loop()
        with np.errstate(over="ignore", invalid="ignore"):
            return self._loop()
