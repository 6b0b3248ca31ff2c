"""Static equations of a load stage with one control equation: evaluation and linear solution.

    [[F_x, F_mu], [c_x, c_mu]] (dx, dmu) = right

with F(x; mu) = C + U + mu (L - U): C are the forces and joints that the load factor does not
change, U and L those that are particular to the unloaded and to the loaded mechanism. The loop is
plain Python over arrays; `native.loops` compiles it if possible.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from beamdae.analysis.statics.krylov_eigenvalues import largest_eigenvalues
from beamdae.analysis.statics.saddle_elimination import (
    NEGLIGIBLE_STIFFNESS,
    SaddlePoint,
    count_signs,
    count_signs_by_scipy,
    factorize_saddle_point,
    serve_solutions,
    solve_saddle_point,
)
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.static_equations import StaticSums, plan_static_sums
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
from beamdae.linear.fixed_order import substitute
from beamdae.native.loop_functions import (
    add,
    add_weighted,
    combine,
    euclidean_norm,
    factorize,
    fill,
    pick,
    solve,
)
from beamdae.native.object_code import is_native_enabled
from beamdae.native.return_codes import DONE, NEW_PIVOTS
from beamdae.symbolic.kernel_sums import (
    Kernel,
    Sum,
    SumPlan,
    evaluate_sum,
    set_matrix_factors,
    set_time,
)
from beamdae.symbolic.sparse_operators import column_indices

Array = np.ndarray

# Machine code that is not in the cache is compiled when interpreted iterations have taken longer
# than compiling would. Times [s]: of an interpreted iteration, as 100 + n coordinates; of compiling
# a kernel, and more for each of its instructions; and of compiling the loop.
_COORDINATE_SECONDS = 4e-6
_OTHER_COORDINATES = 100
_KERNEL_SECONDS = 0.01
_INSTRUCTION_SECONDS = 6e-5
_LOOP_SECONDS = 3.0

# New pivots are chosen if the refinement of a solution exceeds this fraction of it. With good
# pivots, it reaches 5e-3 for thin beams (L/h = 1e5), whose matrix has the condition number 1e13.
_MAX_REFINEMENT = 2e-2
# Above this fraction, symmetric elimination is replaced by elimination with pivots chosen by size.
_MAX_ELIMINATION_REFINEMENT = 1e-3
# Refinement ends if the last one is below this fraction of the solution; maximum number.
_FINAL_REFINEMENT = 1e-5
_MAX_REFINEMENTS = 3
# Prevents division by zero if a solution is zero.
_TINY = 1e-300

# Tasks of `solve_bordered`.
_EVALUATE_FORCES = 0
_EVALUATE_TANGENT = 1
_COUNT_SIGNS = 2
_SOLVE = 3
_SOLVE_NEWTON = 4
_SOLVE_SHIFTED = 5
# Asymmetry up to which the stiffness is treated as symmetric, relative to its largest entry. It is
# small because a follower load is small compared with the axial stiffness of a thin beam.
ASYMMETRY_TOLERANCE = 1e-13
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


@dataclass(slots=True)
class LoadPart:
    """One of the parts C, U and L of the static equations.

    Attributes
    ----------
    residual, tangent
        Sums of kernels; `tangent` evaluates non-zeros of the bordered matrix.
    forces, nonzeros
        Their last values.
    """

    residual: Sum
    tangent: Sum
    forces: Array
    nonzeros: Array


@dataclass(slots=True)
class BorderedWorkspace:
    """Work arrays of `solve_bordered`.

    Attributes
    ----------
    common, unloaded, loaded
        Parts C, U and L.
    linear
        Linear solver of the bordered matrix.
    saddle
        Symmetric elimination of the tangent.
    nonzeros
        Non-zeros of the bordered matrix.
    inputs
        (q, 0, lam), with the zeros of velocities and accelerations.
    forces, by_factor
        F and F_mu, (n + m,).
    row, row_targets, row_sources
        Gradient (c_x, c_mu) of the control: nonzeros[row_targets] = row[row_sources].
    column, column_start
        Last column, (n + m,), and its start in `nonzeros`.
    right
        Right-hand side, (n + m + 1,).
    solution, negative, residual, change
        Solution, its negative, its residual, and its last change by refinement.
    response, denominator
        Solution of the tangent for `column`, (n + m,), and the pivot of the control equation.
    zeros, total
        Indices and result of inner products.
    held_targets, held
        Springs in the tangent: nonzeros[held_targets] += held.
    rows, columns
        Rows and columns of `nonzeros`.
    weights
        Weights of the entries of the solution in the norm of its changes.
    mu
        Load factor.
    deviation
        Value of the control equation, for Newton's method.
    task
        0 to evaluate forces, 1 to evaluate also the tangent, 2 to count also the negative pivots of
        `saddle`, 3 to solve with the given `column` and `right`, 4 to solve for the change of
        Newton's method, 5 to solve with the last factors of `saddle` and its `work` array.
    has_forces, has_tangent
        1 if forces or tangent have been evaluated at `inputs`, else 0.
    has_factors
        1 if the factors of `saddle` are those at `inputs` and `mu`, up to a shift of the size of
        rounding errors, else 0.
    may_eliminate, by_blocks
        1 if symmetric elimination may be used, and 1 if it is used, else 0.
    may_renew
        1 if new pivots may be requested for the accuracy of the solution, else 0.
    """

    common: LoadPart
    unloaded: LoadPart
    loaded: LoadPart
    linear: Any
    saddle: SaddlePoint
    nonzeros: Array
    inputs: Array
    forces: Array
    by_factor: Array
    row: Array
    row_targets: Array
    row_sources: Array
    column: Array
    right: Array
    solution: Array
    negative: Array
    residual: Array
    change: Array
    response: Array
    zeros: Array
    held_targets: Array
    held: Array
    total: Array
    rows: Array
    columns: Array
    weights: Array
    column_start: int
    mu: float = 0.0
    deviation: float = 0.0
    denominator: float = 1.0
    task: int = _EVALUATE_FORCES
    has_forces: int = 0
    has_tangent: int = 0
    has_factors: int = 0
    may_eliminate: int = 0
    by_blocks: int = 0
    may_renew: int = 0


def solve_bordered(run: BorderedWorkspace) -> int:
    """Evaluate the equations and perform the task; return DONE or the code of the linear solver."""
    if run.task == _SOLVE_SHIFTED:
        substitute(run.saddle.factors, run.saddle.work)
        return DONE
    common, unloaded, loaded, mu = run.common, run.unloaded, run.loaded, run.mu
    if run.has_forces == 0:
        evaluate_sum(common.residual, run.inputs, common.forces)
        evaluate_sum(unloaded.residual, run.inputs, unloaded.forces)
        evaluate_sum(loaded.residual, run.inputs, loaded.forces)
        run.has_forces = 1
    # Increments, so that entries without loads are independent of mu to the last digit.
    combine(run.by_factor, (1.0, -1.0), (loaded.forces, unloaded.forces))
    combine(run.forces, (1.0, 1.0, mu), (common.forces, unloaded.forces, run.by_factor))
    if run.task == _EVALUATE_FORCES:
        return DONE
    if run.has_tangent == 0:
        evaluate_sum(common.tangent, run.inputs, common.nonzeros)
        evaluate_sum(unloaded.tangent, run.inputs, unloaded.nonzeros)
        evaluate_sum(loaded.tangent, run.inputs, loaded.nonzeros)
        run.has_tangent = 1
    parts = (common.nonzeros, unloaded.nonzeros, loaded.nonzeros)
    combine(run.nonzeros, (1.0, 1.0 - mu, mu), parts)
    add(run.nonzeros, run.held_targets, run.held, run.row_sources, 0, run.held.size)
    if run.task == _EVALUATE_TANGENT:
        return DONE
    if run.task == _COUNT_SIGNS:
        count_signs(run.saddle, run.nonzeros)
        # With an eigenvalue between the shifts, the shift would determine the solution.
        run.has_factors = 0
        if run.saddle.below == run.saddle.above and run.saddle.below >= 0:
            run.has_factors = serve_solutions(run.saddle)
        return DONE
    size, column_start = run.forces.size, run.column_start
    if run.task == _SOLVE_NEWTON:
        combine(run.column, (1.0,), (run.by_factor,))
        combine(run.right[:size], (-1.0,), (run.forces,))
        run.right[size] = -run.deviation
    pick(run.nonzeros, run.row_targets, run.row, run.row_sources, 0, size + 1)
    combine(run.nonzeros[column_start : column_start + size], (1.0,), (run.column,))
    run.by_blocks = run.may_eliminate
    if run.by_blocks == 1 and run.has_factors == 0:
        run.by_blocks = factorize_saddle_point(run.saddle, run.nonzeros)
    if run.by_blocks == 1:
        solve_saddle_point(run.saddle, run.column, run.response)
        run.denominator = run.row[size] - _dot(run, run.row, run.response)
        if _refine(run) <= _MAX_ELIMINATION_REFINEMENT:
            return DONE
        # Elimination is inaccurate, for example near limit points.
        run.by_blocks, run.may_eliminate = 0, 0
    code = factorize(run.linear, run.nonzeros)
    if code != DONE:
        return code
    # Pivots chosen for an earlier matrix lose accuracy, which iterative refinement restores unless
    # nearly all digits are lost. New pivots require the right-hand side again. The comparison is
    # False for NaN.
    if not _refine(run) <= _MAX_REFINEMENT and run.may_renew == 1:
        run.may_renew = 0
        run.linear.needs_pivots = 1
        return NEW_PIVOTS
    return DONE


def _refine(run: BorderedWorkspace) -> float:
    """Compute `solution` by iterative refinement; return the last relative change."""
    rows, columns, ratio = run.rows, run.columns, 1.0
    fill(run.solution, 0.0)
    combine(run.residual, (1.0,), (run.right,))
    for k in range(_MAX_REFINEMENTS + 1):
        _apply_inverse(run)
        combine(run.solution, (1.0, 1.0), (run.solution, run.change))
        size = euclidean_norm(run.solution, run.weights)
        ratio = euclidean_norm(run.change, run.weights) / max(size, _TINY)
        if k > 0 and ratio <= _FINAL_REFINEMENT:
            break
        combine(run.negative, (-1.0,), (run.solution,))
        combine(run.residual, (1.0,), (run.right,))
        add_weighted(run.residual, rows, run.nonzeros, run.negative, columns, 0, rows.size)
    return ratio


def _apply_inverse(run: BorderedWorkspace) -> None:
    """Set `change` to the solution for `residual`, without refinement."""
    size, change, residual = run.forces.size, run.change, run.residual
    if run.by_blocks == 0:
        combine(change, (1.0,), (residual,))
        solve(run.linear, change)
        return
    change[size] = 0.0
    solve_saddle_point(run.saddle, residual[:size], change[:size])
    factor = (residual[size] - _dot(run, run.row, change)) / run.denominator
    combine(change[:size], (1.0, -factor), (change[:size], run.response))
    change[size] = factor


def _dot(run: BorderedWorkspace, one: Array, other: Array) -> float:
    """Return the inner product of the first n + m entries."""
    fill(run.total, 0.0)
    size = run.forces.size
    add_weighted(run.total, run.zeros, one, other, run.row_sources, 0, size)
    return run.total[0]


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
    """

    sums: tuple[PartPlan, ...]
    pattern: sp.csc_array
    bordered: sp.csc_array
    tangent_targets: Array
    tangent_sources: Array
    held_targets: Array
    row_targets: Array


@cache_on_owner
def _plan_bordered(
    common: Structure, unloaded: Structure, loaded: Structure, held: tuple[int, ...]
) -> BorderedPlan:
    parts = [plan_static_sums(structure) for structure in (common, unloaded, loaded)]
    patterns = [x.pattern for x in parts]
    ones, shape = np.ones(len(held)), patterns[0].shape
    patterns.append(sp.csc_array((ones, (held, held)), shape=shape))
    union = sp.csc_array(reduce(lambda one, other: one + other, patterns))
    union.sort_indices()
    size = union.shape[0]
    tangent_targets = np.arange(union.nnz) + column_indices(union)
    keys = column_indices(union).astype(np.int64) * size + union.indices
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
        own = column_indices(sums.pattern).astype(np.int64) * size + sums.pattern.indices
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


def _split_terms(
    unloaded: EquationsOfMotion, loaded: EquationsOfMotion, kind: str
) -> tuple[tuple[Any, ...], tuple[Any, ...], tuple[Any, ...]]:
    """Return the common terms of both equations, and those of only one of them.

    `kind` is "forces" or "joints". Common terms have equal kernels, operators and numbers.
    """

    def identify(e: EquationsOfMotion, term: ForceTerm | ConstraintTerm) -> tuple[Any, ...]:
        values = (value for name, value in vars(term).items() if name != "data")
        return (*map(comparison_key, values), e.p[term.data].tobytes())

    def split(e: EquationsOfMotion, other: Counter[Any]) -> tuple[tuple[Any, ...], ...]:
        common: list[Any] = []
        only: list[Any] = []
        for term in getattr(e.structure, kind):
            key = identify(e, term)
            (common if other[key] > 0 else only).append(term)
            other[key] -= 1
        return tuple(common), tuple(only)

    keys = [Counter(identify(e, x) for x in getattr(e.structure, kind)) for e in (unloaded, loaded)]
    _, only_unloaded = split(unloaded, keys[1])
    common, only_loaded = split(loaded, keys[0])
    return common, only_unloaded, only_loaded


def _iterate_inversely(inverse: Callable[[Array], Array], vectors: Array) -> Array:
    """Return an orthonormal basis after two inverse iterations of `vectors`, (n, k)."""
    for _ in range(2):
        vectors = np.linalg.qr(inverse(vectors))[0]
    return vectors


class BorderedSystem:
    """Static equations of one load stage, evaluated and solved by machine code if it is available.

    Do not share an instance between threads.

    Parameters
    ----------
    unloaded, loaded
        Equations without and with the loads of the stage; the same object if no load is scaled.
    time
        (t, branch), at which laws are evaluated.
    held
        Indices of coordinates with springs that act on the tangent F_x alone.

    Attributes
    ----------
    pattern
        CSC pattern of the tangent F_x, (n + m, n + m).
    """

    def __init__(
        self,
        unloaded: EquationsOfMotion,
        loaded: EquationsOfMotion,
        time: Array,
        held: tuple[int, ...] = (),
    ) -> None:
        self._time, self._n, self._scales = time, loaded.n, loaded.position_scales
        splits = [_split_terms(unloaded, loaded, kind) for kind in ("forces", "joints")]
        common, only_unloaded, only_loaded = (
            intern_structure(Structure(loaded.n, loaded.m, *terms))
            for terms in zip(*splits, strict=True)
        )
        self._numbers = (loaded.p, unloaded.p, loaded.p)
        self._usage = _usage_of(common)
        plan = _plan_bordered(common, only_unloaded, only_loaded, held)
        self.pattern, self._bordered, self._plans = plan.pattern, plan.bordered, plan.sums
        self._tangent_targets = plan.tangent_targets
        self._tangent_sources = plan.tangent_sources
        self._held_targets, self._row_targets = plan.held_targets, plan.row_targets
        self._held, size = np.array(held, int), plan.pattern.shape[0]
        self._has_load_stiffness = any(map(_has_entries, (x.tangent for x in plan.sums[1:])))
        self._evaluated_x = np.full(size, np.nan)
        self._follows: bool | None = None
        # Tests compare symmetric elimination with pivots chosen by size.
        self._eliminates = True
        self._initial_x = np.append(loaded.q0, np.zeros(loaded.m))
        self._set_loop(compiles=False)
        self._compilation_seconds = np.inf if self.is_native else self._estimate_compilation()

    def _set_loop(self, compiles: bool) -> None:
        self._loop = self._make_loop(compiles)
        self._evaluated_x[:] = np.nan
        reference = self._run(self._initial_x, 0.0, _EVALUATE_TANGENT)
        reference.saddle.scale_by_reference(reference.nonzeros)
        reference.held[:] = (reference.saddle.size or 1.0) / self._scales[self._held] ** 2

    def _make_loop(self, compiles: bool) -> StepLoop[BorderedWorkspace]:
        size, nnz = self.pattern.shape[0], self._bordered.nnz
        matrix = FactorizedMatrix.from_pattern(self._bordered)

        def make_part(plans: tuple[SumPlan, SumPlan], p: Array, native: bool) -> LoadPart:
            residual, tangent = (plan.sum(native, p) for plan in plans)
            for total in (residual, tangent):
                set_time(total, *self._time)
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
                saddle=SaddlePoint.of(self.pattern, self._tangent_targets, self._scales),
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
                zeros=np.zeros(size, np.uint32),
                held_targets=self._held_targets,
                held=np.zeros(len(self._held)),
                total=np.zeros(1),
                rows=self._bordered.indices.astype(np.uint32),
                columns=column_indices(self._bordered).astype(np.uint32),
                weights=np.append(1.0 / self._scales, np.zeros(size + 1 - self._n)),
                column_start=int(self._bordered.indptr[size]),
            )

        native = all(plan.load_native(compiles) for plans in self._plans for plan in plans)
        return StepLoop(solve_bordered, make, lambda run: [(run.linear, matrix)], native, compiles)

    @property
    def is_native(self) -> bool:
        """True if machine code evaluates the equations."""
        return self._loop.is_native

    def residual(self, x: Array, mu: float) -> tuple[Array, Array]:
        """Return F and F_mu at x = (q, lam), (n + m,) each."""
        run = self._loop.work
        if not (run.has_forces and mu == run.mu and np.array_equal(x, self._evaluated_x)):
            run = self._run(x, mu, _EVALUATE_FORCES)
        return run.forces.copy(), run.by_factor.copy()

    def tangent(self, x: Array, mu: float) -> Array:
        """Return the non-zeros of F_x on `pattern`."""
        return self._run(x, mu, _EVALUATE_TANGENT).nonzeros[self._tangent_targets]

    def count_negative_eigenvalues(self, x: Array, mu: float) -> int | None:
        """Return the number of negative eigenvalues of the stiffness in the possible motions.

        The result is None if it is not certain: if an eigenvalue is zero up to rounding errors, or
        the stiffness is not symmetric.
        """
        if self.has_follower_loads(x, mu):
            return None
        if self.is_native:
            signs = self._run(x, mu, _COUNT_SIGNS).saddle
        else:
            run = self._run(x, mu, _EVALUATE_TANGENT)
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
        run, n = self._run(x, mu, _EVALUATE_TANGENT), self._n
        saddle = run.saddle
        loads = mu * run.loaded.nonzeros + (1.0 - mu) * run.unloaded.nonzeros
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
                right = np.concatenate([forces[:, k] / self._scales, np.zeros(size + 1 - n)])
                solution = self.solve(x, mu, load_control, column, right)
                motions[:, k] = solution[:n] / self._scales
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
        run = self._run(x, mu, _EVALUATE_TANGENT)
        values, pattern = run.nonzeros[self._tangent_targets], self.pattern
        tangent = sp.csc_array((values, pattern.indices, pattern.indptr), shape=pattern.shape)
        scales = np.append(self._scales, np.ones(size - n))
        shift = np.where(np.arange(size) < n, _SOFT_SHIFT * run.saddle.size, 0.0)
        scaled = tangent * scales * scales[:, None] + sp.diags_array(shift)
        solver = splu(sp.csc_matrix(scaled))
        return lambda forces: solver.solve(
            np.vstack([forces, np.zeros((size - n, forces.shape[1]))])
        )[:n]

    def nearest_modes(
        self, x: Array, mu: float, count: int, tolerance: float
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
        tolerance
            See `krylov_eigenvalues.largest_eigenvalues`.
        """
        if not self.is_native:
            return None
        negative_count = self.count_negative_eigenvalues(x, mu)
        if negative_count is None:
            return None
        run, n, m = self._loop.work, self._n, len(x) - self._n
        saddle = run.saddle

        def apply_inverse(vector: Array) -> Array:
            saddle.work[:n], saddle.work[n:] = vector, 0.0
            run.task = _SOLVE_SHIFTED
            self._loop()
            return saddle.work[:n].copy()

        try:
            inverse, vectors = largest_eigenvalues(apply_inverse, n, min(count, n - m), tolerance)
        except ArithmeticError:
            return None
        eigenvalues = 1.0 / inverse - saddle.shift_size
        order = np.argsort(eigenvalues)
        return NearestModes(eigenvalues[order], vectors[:, order], negative_count, saddle.size)

    def newton_change(
        self, x: Array, mu: float, gradient: tuple[Array, float], deviation: float
    ) -> Array:
        """Return the change (dx, dmu) of Newton's method, (n + m + 1,).

        `gradient` and `deviation` are the gradient and the value of the control equation. The
        result is not finite if the forces are not.

        Raises
        ------
        SingularMatrixError
            If the bordered matrix is singular or not finite.
        """
        self._compile_if_used()
        self._loop.work.deviation = deviation
        self._set_row(gradient)
        return self._run(x, mu, _SOLVE_NEWTON).solution.copy()

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
        return self._run(x, mu, _SOLVE).solution.copy()

    def _compile_if_used(self) -> None:
        """Count an iteration; compile kernels, then the loop, when this takes less time."""
        if self.is_native:
            return
        usage = self._usage
        usage.seconds += _COORDINATE_SECONDS * (_OTHER_COORDINATES + self._n)
        while not self.is_native and usage.seconds > self._compilation_seconds:
            usage.seconds -= self._compilation_seconds
            missing = self._missing_kernels()
            for kernel in missing:
                kernel.load_native()
            self._set_loop(compiles=not missing)
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
        run, n = self._loop.work, self._n
        if not np.array_equal(x, self._evaluated_x):
            self._evaluated_x[:] = x
            run.inputs[:n], run.inputs[2 * n :] = x[:n], x[n:]
            run.has_forces = run.has_tangent = run.has_factors = 0
        if mu != run.mu:
            run.has_factors = 0
        run.mu, run.task = mu, task
        run.may_renew = int(self.is_native)
        run.may_eliminate = int(self.is_native and self._eliminates)
        if self.is_native:
            code = self._loop()
        else:
            with np.errstate(over="ignore", invalid="ignore"):
                code = self._loop()
        if code != DONE:
            run.linear.singular = 0
            raise SingularMatrixError("the matrix is singular")
        return run
