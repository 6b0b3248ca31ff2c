"""Evaluation of the static equations of a load stage: plans, loop and solutions.

The equations have one control equation,

    [[F_x, column], [row, corner]] solution = right

with F(x; mu) = C + U + mu (L - U): C are the forces and joints that the load factor does not
change, U and L those that are particular to the unloaded and to the loaded mechanism. The core
solves them: `statics.c`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial, reduce
from itertools import compress
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import SuperLU, splu

from beamdae.analysis.continuation.critical import Count, Determinant
from beamdae.analysis.continuation.engine import (
    FAILURES,
    Control,
    Corrections,
    CurveError,
    Linearization,
    Point,
    Problem,
)
from beamdae.analysis.continuation.spectrum import count_growing, has_potential
from beamdae.analysis.statics.load_scaling import FactorEquations, LoadedEquations
from beamdae.analysis.statics.pivot_signs import (
    NEGLIGIBLE_STIFFNESS,
    PivotSigns,
    SaddlePattern,
    plan_saddle_point,
    scale_by_reference,
)
from beamdae.core.return_codes import (
    CORRECT,
    CORRECTED,
    DONE,
    EVALUATE_FORCES,
    EVALUATE_TANGENT,
    SINGULAR,
)
from beamdae.core.tables import Workspace
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.formulations.compliant_equations import introduce_resultants
from beamdae.equations.formulations.static_equations import (
    StaticSums,
    find_idle_forces,
    plan_static_sums,
)
from beamdae.equations.structure import (
    ConstraintTerm,
    ForceTerm,
    Structure,
    cache_on_owner,
    comparison_key,
)
from beamdae.errors import BeamdaeError
from beamdae.integrators.compiled_run import FactorizedMatrix, StepLoop
from beamdae.native.object_code import is_native_enabled
from beamdae.symbolic.sparse_operators import column_indices
from beamdae.symbolic.sums.kernel_sums import SumPlan, set_matrix_factors, set_time

Array = np.ndarray

# Machine code that is not in the cache is compiled after so many evaluations of a structure: one
# takes about a millisecond, compiling the loop a few seconds.
_INTERPRETED_EVALUATIONS = 1000

_SINGULAR = "the tangent stiffness is singular at the next point"

# Distance of a parameter from the value about which equations are linearized, in steps.
_CENTER_TOLERANCE = 1e-6


class SystemPlan(NamedTuple):
    """Patterns and plans of the static equations of a load stage, without numbers of the model.

    Attributes
    ----------
    sums
        Plans of the residual and the tangent of the parts C, U and L; the tangents add to the
        bordered matrix.
    pattern, bordered
        Patterns of the tangent, (n + m, n + m), and of the bordered matrix.
    tangent_targets, added_targets, row_targets
        Indices of the non-zeros of `pattern`, of added constants and of the last row in the
        non-zeros of `bordered`.
    saddle
        Matrix for the signs of pivots.
    evaluations
        Number of interpreted evaluations in this process, (1,).
    """

    sums: tuple[tuple[SumPlan, SumPlan], ...]
    pattern: sp.csc_array
    bordered: sp.csc_array
    tangent_targets: Array
    added_targets: Array
    row_targets: Array
    saddle: SaddlePattern
    evaluations: Array


@cache_on_owner
def _plan_system(
    common: Structure,
    unloaded: Structure,
    loaded: Structure,
    part_starts: tuple[int, ...],
    added: tuple[int, ...],
    is_shared: bytes,
) -> SystemPlan:
    sums = [plan_static_sums(structure) for structure in (common, unloaded, loaded)]
    size, starts = sums[0].pattern.shape[0], np.array(part_starts, np.intp)
    parts = starts[np.searchsorted(starts, np.arange(common.n), "right") - 1]
    diagonal = sp.csc_array((np.ones(len(added)), (added, added)), (size, size))
    pattern = sp.csc_array(reduce(lambda one, other: one + other, (x.pattern for x in sums)))
    pattern = sp.csc_array(pattern + diagonal)
    pattern.sort_indices()
    border = np.ones((size, 1))
    bordered = sp.csc_array(sp.block_array([[pattern, border], [border.T, np.ones((1, 1))]]))
    bordered.sort_indices()
    rows, columns = bordered.indices, column_indices(bordered).astype(np.intp)
    keys = columns * (size + 1) + rows

    def plan(sums: StaticSums) -> tuple[SumPlan, SumPlan]:
        own = column_indices(sums.pattern).astype(np.intp) * (size + 1) + sums.pattern.indices
        targets = np.searchsorted(keys, own).astype(np.uint32)
        tangent = replace(
            sums.tangent,
            add_targets=targets[sums.tangent.add_targets],
            weighted_targets=targets[sums.tangent.weighted_targets],
        )
        return sums.residual, tangent

    return SystemPlan(
        sums=tuple(map(plan, sums)),
        pattern=pattern,
        bordered=bordered,
        tangent_targets=np.flatnonzero((rows < size) & (columns < size)),
        added_targets=np.searchsorted(keys, np.array(added) * (size + 2)).astype(np.uint32),
        row_targets=np.flatnonzero(rows == size).astype(np.uint32),
        saddle=plan_saddle_point(pattern, parts, np.frombuffer(is_shared, bool)),
        evaluations=np.zeros(1, int),
    )


@cache_on_owner
def _term_keys(structure: Structure) -> tuple[tuple[tuple[Any, ...], slice], ...]:
    """Return keys of kernels and operators, and the data, of all terms: forces, then joints."""
    # Forces and joints have different kernels, so that their keys differ.
    terms: tuple[ForceTerm | ConstraintTerm, ...] = (*structure.forces, *structure.joints)
    return tuple(
        (tuple(comparison_key(x) for name, x in vars(term).items() if name != "data"), term.data)
        for term in terms
    )


def _split_structures(
    unloaded: EquationsOfMotion, loaded: EquationsOfMotion
) -> tuple[Structure, Structure, Structure]:
    """Return the common terms of two equations, and those of only one of them.

    Common terms have equal kernels, operators and numbers.
    """
    pair = unloaded, loaded
    keys = [[(key, e.p[x].tobytes()) for key, x in _term_keys(e.structure)] for e in pair]
    first, last = map(Counter, keys)
    is_common = [tuple(first[key] == last[key] for key in own) for own in keys]
    only_unloaded, only_loaded = (
        _select_terms(e.structure, tuple(not x for x in flags))
        for e, flags in zip(pair, is_common, strict=True)
    )
    return _select_terms(unloaded.structure, is_common[0]), only_unloaded, only_loaded


@cache_on_owner
def _select_terms(structure: Structure, is_selected: tuple[bool, ...]) -> Structure:
    if all(is_selected):
        # Structures too large to be shared keep the plans of `StaticEquations`.
        return structure
    count = len(structure.forces)
    forces = tuple(compress(structure.forces, is_selected[:count]))
    joints = tuple(compress(structure.joints, is_selected[count:]))
    return replace(structure, forces=forces, joints=joints, states=())


@dataclass(frozen=True, eq=False)
class StaticLinearization:
    """Static equations, linearized about a point (x, p), evaluated when they are needed."""

    problem: StaticProblem
    x: Array
    p: float
    bordered = Linearization.bordered

    @property
    def sizes(self) -> Array:
        """Units of the unknowns, (n + m,)."""
        return self.problem.scales

    @cached_property
    def _forces(self) -> tuple[Array, Array]:
        return self.problem.residual(self.x, self.p)

    @property
    def residual(self) -> Array:
        """Residual F, (n + m,)."""
        return self._forces[0]

    @property
    def by_parameter(self) -> Array:
        """Derivative of F by the parameter, (n + m,)."""
        return self._forces[1]

    @cached_property
    def jacobian(self) -> sp.csc_array:
        """Tangent F_x in natural sizes, (n + m, n + m)."""
        return self.problem.matrix(self.x, self.p)


class StaticProblem(Problem):
    """Static equations of one load stage for the curve engine, in machine code if available.

    The unknowns are (q, lam) with the axial and shear forces of beams and the forces of springs
    among the multipliers. If the equations depend on another parameter than a load factor, the
    parts U and L are those at its value and a step beside it, and there is no common part C. Do not
    share an instance between threads.

    Parameters
    ----------
    system
        The load stage.
    held
        Positions of the coordinates that springs in the tangent hold, by index, see
        `neutral_motions`.
    idle
        Mask of the forces of springs without stiffness, see `introduce_resultants`. Defaults to
        those of both ends if the equations depend on another parameter than a load factor, and
        otherwise to none.

    Attributes
    ----------
    system, held, idle
        See above.
    mixed
        Equations with the forces of beams and springs as unknowns, linear about the begin.
    pattern
        CSC pattern of the tangent F_x, (n + m, n + m).
    n, rigid_size
        Numbers of coordinates, and of unknowns before the forces of beams and springs.
    """

    def __init__(
        self,
        system: LoadedEquations,
        held: Mapping[int, float] | None = None,
        idle: Array | None = None,
    ) -> None:
        if idle is None and not system.is_linear:
            # The stiffness of a spring may begin or end at zero.
            idle = find_idle_forces(system.unloaded) | find_idle_forces(system.loaded)
        self.system, self.held, self.idle = system, held or {}, idle
        self.mixed = self._linearize_by_parameter(system.ends[0])
        first, last = self.mixed.first.equations, self.mixed.last.equations
        self.n, self.rigid_size = last.n, last.n + system.equations.m
        if system.is_linear:
            structures = _split_structures(first, last)
        else:
            none = _select_terms(last.structure, (False,) * len(_term_keys(last.structure)))
            structures = none, last.structure, last.structure
        added = (*self.held, *range(self.rigid_size, last.n + last.m))
        remainder = introduce_resultants(self.system.equations, self.idle).remainder
        starts = tuple(part.rows.start for part in self.mixed.equations.parts)
        self._plan = _plan_system(*structures, starts, added, (remainder == 0.0).tobytes())
        self._remainder = remainder
        self.pattern = self._plan.pattern
        self._weights = np.append(1.0 / last.group_scales, np.zeros(last.m))
        self._prepare_loop(compiles=False)

    def _prepare_loop(self, compiles: bool) -> None:
        """Build the loop, for kernels in machine code if it is known, or if the loop compiles them.

        Natural sizes are set by the tangent in the reference configuration, without loads.
        """
        plan, size, nnz = self._plan, self.pattern.shape[0], self._plan.bordered.nnz
        held, begin, ends = len(self.held), self.system.ends[0], self.mixed[:2]
        reference = self.mixed.equations
        matrix = FactorizedMatrix.from_pattern(plan.bordered)

        def make_part(plans: tuple[SumPlan, SumPlan], k: int, native: bool) -> Workspace:
            p = ends[k].equations.p
            residual, tangent = (plan.sum(native, p) for plan in plans)
            # The factors of damping and mass are not used.
            set_matrix_factors(tangent, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
            return Workspace(
                "LoadPart",
                residual=residual,
                tangent=tangent,
                forces=np.zeros(size),
                nonzeros=np.zeros(nnz),
            )

        def make(native: bool) -> Workspace:
            common, unloaded, loaded = (
                make_part(plans, k, native) for plans, k in zip(plan.sums, (0, 0, 1), strict=True)
            )
            return Workspace(
                "StaticWorkspace",
                common=common,
                unloaded=unloaded,
                loaded=loaded,
                linear=matrix.make_solver(),
                nonzeros=np.zeros(nnz),
                scaled=matrix.nonzeros,
                products=np.ones(nnz),
                sizes=np.ones(size + 1),
                inputs=np.zeros(self.n + size),
                forces=np.zeros(size),
                by_factor=np.zeros(size),
                row=np.zeros(size + 1),
                row_targets=plan.row_targets,
                counting=np.arange(size + 1, dtype=np.uint32),
                right=np.zeros(size + 1),
                remainder=self._remainder,
                added_targets=plan.added_targets,
                added=np.append(np.zeros(held), -np.ones(size - self.rigid_size)),
                weights=self._weights,
                corrections=Corrections(),
                column_start=int(plan.bordered.indptr[size]),
                joint_count=self.rigid_size - self.n,
            )

        self._is_native = all(x.load_native(compiles) for plans in plan.sums for x in plans)
        run = make(self._is_native)
        self._loop = StepLoop("perform_task", run, (run.linear, matrix))
        self._point, bordered = (np.nan, b""), plan.bordered
        self._center(begin)
        self._run(self.start(reference.q0), begin, EVALUATE_TANGENT)
        tangent = run.nonzeros[plan.tangent_targets]
        run.sizes[:-1] = scale_by_reference(
            plan.saddle, tangent, reference.part_scales, self.rigid_size
        )
        run.added[:held] = run.sizes[bordered.indices[plan.added_targets[:held]]] ** -2.0
        self._forget_point()
        run.products[:] = run.sizes[bordered.indices] * run.sizes[column_indices(bordered)]
        tangent *= run.products[plan.tangent_targets]
        self._reference = plan.saddle.largest_stiffness(tangent)

    @property
    def scales(self) -> Array:
        """Natural sizes of the unknowns for the stiffness, (n + m,), see `scale_by_reference`."""
        return self._loop.work.sizes[:-1].copy()

    @property
    def weights(self) -> Array:
        """Inverse natural sizes of the coordinates, and 0 for multipliers."""
        return self._weights

    @property
    def mode_weights(self) -> Array:
        """Inverse sizes of the coordinates that make all parts equally stiff as drawn."""
        return np.where(self._weights > 0.0, 1.0 / self.scales, 0.0)

    def start(self, x: Array) -> Array:
        """Return the unknowns that begin with (q, ...), with zeros for the others."""
        return np.append(x, np.zeros(len(self.weights) - len(x)))

    def linearize(self, x: Array, p: float, last: Any = None) -> StaticLinearization:
        """Return the equations, linearized about (x, p)."""
        return StaticLinearization(self, x, p)

    def point(self, x: Array, p: float, iterations: int = 0) -> Point:
        """Return a solution that is known."""
        return Point(self, x, p, self.linearize(x, p), iterations)

    def point_at(self, q: Array, mu: float) -> Point:
        """Return the point with positions (n,) near an equilibrium, which determine multipliers."""
        x, n, first = self.start(q), self.n, self.rigid_size
        x[first:] = self.residual(x, mu)[0][first:]
        gradients = self.matrix(x, mu)[:n, n:first].toarray()
        rest = -self.scales[:n] * self.residual(x, mu)[0][:n]
        x[n:first] = self.scales[n:first] * np.linalg.lstsq(gradients, rest)[0]
        return self.point(x, mu)

    def monitor(self, point: Point) -> Count:
        """Return the stability under constant loads.

        If forces have a potential, growing motions are the negative eigenvalues of the stiffness in
        the motions that the joints allow, whatever the inertia and the damping (theorem of Kelvin,
        Tait and Chetaev). Otherwise, they are the growing modes of the linearized equations of
        motion.
        """
        x, p = point.x, point.p
        signs = self.signs(x, p)
        if signs.size <= NEGLIGIBLE_STIFFNESS:
            return Count(0, 0, free=2 * self.n - self.rigid_size)
        m = len(x) - self.n
        (below, determinant), (above, _) = map(signs.count_negative, (1.0, -1.0))
        free = above - below
        by_signs = Count(below - m, 0, free=free)
        if free == 0:
            by_signs = by_signs._replace(determinant=determinant)
        if signs.is_symmetric or self.rigid_size >= 2 * self.n:
            return by_signs
        try:
            factors = splu(sp.csc_matrix(self.matrix(x, p)))
        except RuntimeError:
            return by_signs

        def respond(right: Array, factors: SuperLU = factors) -> Array:
            return factors.solve(right)[: self.n]

        # Close to a critical point, the symmetric part has another sign in the softest motion.
        is_sign_right = free > 0 or _has_negative_determinant(factors) == (below % 2 == 1)
        if is_sign_right and has_potential(respond, self.n, m):
            return by_signs
        motion, scales = self.system.linearize_motion(x, p, self.idle), self.scales
        _, damping, mass = (
            sp.csc_array(y * scales * scales[:, None]) for y in motion.pencil.matrices
        )
        shift, flexibility = 0.0, respond
        if self.held:
            # The springs that hold motions, of stiffness 1, would take part in others: inertia
            # replaces them, about the rate of stiffness 1 and all inertia.
            shift, matrix = float(mass.diagonal().sum()) ** -0.5, self.matrix(x, p)
            for k in self.held:
                matrix[k, k] -= 1.0
            about = splu(sp.csc_matrix(matrix + shift * damping + shift**2 * mass))
            flexibility = partial(respond, factors=about)
        count = count_growing(flexibility, damping[:, : self.n], mass[:, : self.n], shift)
        return count._replace(free=free)

    def residual(self, x: Array, mu: float) -> tuple[Array, Array]:
        """Return F and F_mu at x = (q, lam), (n + m,) each."""
        run = self._run(x, mu, EVALUATE_FORCES)
        return run.forces.copy(), run.by_factor.copy()

    def matrix(self, x: Array, mu: float) -> sp.csc_array:
        """Return F_x in natural sizes of the unknowns, see `scales`."""
        pattern, targets = self.pattern, self._plan.tangent_targets
        run = self._run(x, mu, EVALUATE_TANGENT)
        entries = run.nonzeros[targets] * run.products[targets]
        return sp.csc_array((entries, pattern.indices, pattern.indptr), pattern.shape)

    def product(self, x: Array, mu: float, along: Array) -> Array:
        """Return the derivative of F along a change (n + m + 1,) of (x, mu)."""
        sizes = self.scales
        by_x = self.matrix(x, mu) @ (along[:-1] / sizes) / sizes
        return np.asarray(by_x + along[-1] * self.residual(x, mu)[1])

    def determinant(self, x: Array, mu: float) -> Determinant:
        """Return the determinant of the saddle-point matrix; its sign is 0 if a pivot vanishes."""
        return self.signs(x, mu).count_negative(1.0)[1]

    def signs(self, x: Array, mu: float) -> PivotSigns:
        """Return the signs of pivots at a point."""
        return PivotSigns(self._plan.saddle, self.matrix(x, mu).data, self._reference)

    def correct(self, control: Control, target: float, x: Array, p: float) -> Point:
        """Return the solution at which the control has the value `target`, by Newton's method."""
        run, n, code = self._loop.work, self.n, CORRECTED
        run.corrections.restart()
        x = x.copy()
        x[list(self.held)] = list(self.held.values())
        while code == CORRECTED:
            row = control(x, p)
            if not np.array_equal(run.row, row.gradient):
                run.row[:], run.has_factors = row.gradient, 0
            self._set_point(x, p)
            run.deviation = row.value - target
            run.is_linear = int(row.is_linear and self.system.is_linear)
            code = self._perform(CORRECT)
            x, p = np.append(run.inputs[:n], run.inputs[2 * n :]), run.mu
            self._point = p, x.tobytes()
        count = run.corrections.count
        tangent = (row.gradient, run.right.copy()) if row.is_linear else None
        evaluations, is_interpreted = self._plan.evaluations, not self._is_native
        evaluations += count
        if is_interpreted and is_native_enabled() and evaluations[0] > _INTERPRETED_EVALUATIONS:
            evaluations[:] = 0
            self._prepare_loop(compiles=True)
        if code != DONE:
            raise CurveError(FAILURES[code])
        return Point(self, x, p, self.linearize(x, p), count, known_tangent=tangent)

    def _run(self, x: Array, mu: float, task: int) -> Workspace:
        """Perform a task at (x, mu)."""
        self._set_point(x, mu)
        self._perform(task)
        return self._loop.work

    def _perform(self, task: int) -> int:
        """Run the loop; return its code."""
        run = self._loop.work
        run.task = task
        code = self._loop()
        if code == SINGULAR:
            run.linear.singular = 0
            raise CurveError(_SINGULAR)
        return code

    def _set_point(self, x: Array, mu: float) -> None:
        run, n, point = self._loop.work, self.n, (mu, x.tobytes())
        if point != self._point:
            run.inputs[:n], run.inputs[2 * n :], run.mu = x[:n], x[n:], mu
            self._point = point
            self._forget_point()
        is_off = abs(mu - run.center) * run.scale > _CENTER_TOLERANCE
        if is_off and not self.system.is_linear:
            self._center(mu)

    def _forget_point(self) -> None:
        """Mark all values of the loop as those of another point."""
        run = self._loop.work
        run.has_forces = run.has_tangent = run.has_factors = 0

    def _linearize_by_parameter(self, value: float) -> FactorEquations:
        """Return the equations in mixed form, linear about a value of the parameter."""
        return self.system.at_factor(value).convert(
            lambda e: introduce_resultants(e, self.idle).equations
        )

    def _center(self, value: float) -> None:
        """Evaluate the equations, and their derivative by the parameter, about a value of it."""
        run = self._loop.work
        try:
            here = self._linearize_by_parameter(value)
        except BeamdaeError as error:
            raise CurveError(f"the model cannot be built ({str(error).rstrip('.')})") from None
        ends = (run.common, here.first), (run.unloaded, here.first), (run.loaded, here.last)
        for (part, static), plans in zip(ends, self._plan.sums, strict=True):
            for plan, total in zip(plans, (part.residual, part.tangent), strict=True):
                plan.set_data(total, static.equations.p)
                set_time(total, *static.time)
        run.center, run.scale = value - here.share / here.rate, here.rate
        self._forget_point()


def _has_negative_determinant(factors: SuperLU) -> bool:
    size, negative = factors.shape[0], int(np.sum(factors.U.diagonal() < 0.0))
    for order in (factors.perm_r, factors.perm_c):
        links = sp.csr_array((np.ones(size), (np.arange(size), order)), (size, size))
        cycles, _ = connected_components(links, directed=False)
        negative += size - cycles
    return negative % 2 == 1
