"""Newton's method for the static equations of a load stage with one control equation.

    [[F_x, F_mu], [c_x, c_mu]] (dx, dmu) = -(F, c)

with F(x; mu) = C + U + mu (L - U): C are the forces and joints that the load factor does not
change, U and L those that are particular to the unloaded and to the loaded mechanism. Machine code
also takes steps of load control, as `continuation` does, up to a step that may cross a critical
point. The loop is plain Python over arrays; `native.loops` compiles it if possible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from beamdae.analysis.statics.krylov_eigenvalues import KrylovSpace, begin_block, end_block
from beamdae.analysis.statics.saddle_elimination import (
    ASYMMETRY_TOLERANCE,
    NEGLIGIBLE_STIFFNESS,
    SPARSE_ZERO_TOLERANCE,
    SaddlePoint,
    count_signs,
    factorize_saddle_point,
    scale_by_reference,
    serve_solutions,
    solve_saddle_point,
)
from beamdae.analysis.statics.strain_increments import (
    AxisElements,
    displace_axes,
    restore_axes,
)
from beamdae.linear.fixed_order import substitute
from beamdae.native.loop_functions import (
    add,
    add_weighted,
    combine,
    euclidean_norm,
    factorize,
    fill,
    inner_product,
    max_norm,
    multiply,
    pick,
    solve,
)
from beamdae.native.return_codes import DONE, FULL, NEW_PIVOTS, NOT_CONVERGED, NOT_FINITE
from beamdae.symbolic.sums.kernel_sums import Sum, evaluate_sum

Array = np.ndarray

_MAX_ITERATIONS = 15
# Newton corrections are relative to the size of the mechanism, angles in rad.
_DIVERGENCE_LIMIT = 0.5
_CONVERGENCE_TOLERANCE = 1e-10
# The next correction is predicted by quadratic convergence if the last but one is below the first
# bound; a point is accepted if the prediction is below the second bound. A correction of this size
# changes the axial force of a thin beam (L/h = 1e5) by 1e-4 of its Euler load.
_QUADRATIC_LIMIT = 1e-3
_PREDICTED_TOLERANCE = 1e-15
# A correction below this size is also accepted if it exceeds this fraction of the previous one,
# because rounding errors of stiff beams may prevent smaller corrections.
_STAGNATION_TOLERANCE = 1e-6
_STAGNATION_RATIO = 0.1

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

# If the corrector moves a point by more than this fraction of the step, the point lies on another
# path. The allowance for rounding is in natural sizes.
MAX_CORRECTION_RATIO = 0.5
CORRECTION_ROUNDING = 1e-7
# A failed step is multiplied by this factor, down to this fraction of the largest step.
CUT_FACTOR = 0.25
MIN_STEP_RATIO = 1e-6
# The step grows by this factor if the corrector takes at most the first number of Newton
# iterations; or at most the second one, if it moves the point by less than this fraction of the
# step. The iterations of thin beams in a floating frame depend on their axial stiffness more than
# on the curvature of the path.
_GROWTH_FACTOR = 1.5
_MAX_ITERATIONS_TO_GROW = 4
_MAX_STIFF_ITERATIONS_TO_GROW = 8
_MAX_CORRECTION_TO_GROW = 0.1
# The curvature of the path is extrapolated from up to this number of previous points, unless it
# moves the prediction by more than this fraction of the step.
_MAX_PREVIOUS_POINTS = 2
_MAX_CURVED_RATIO = 0.25
# Within a path, signs of pivots and the direction are computed before the last correction, if the
# previous one is below the first bound, the last one is below the second bound, and unbalanced
# forces change the stiffness by no more than rounding errors.
_MAX_EARLY_CORRECTION = 1e-4
_MAX_LAST_CORRECTION = 1e-7
# A remaining distance of up to this multiple of the step is split in two, so that the last step is
# not tiny. Up to the second multiple, which allows for rounding, one step covers the distance.
_SPLIT_RATIO = 1.2
_ROUNDING_RATIO = 1.001

# Tasks of `perform_task`.
EVALUATE_FORCES = 0
EVALUATE_TANGENT = 1
COUNT_SIGNS = 2
SOLVE = 3
EXTEND_SPACE = 4
CORRECT = 5
FOLLOW_LOAD = 6
_SOLVE_NEWTON = 7

# Phases of `_correct`.
PREDICT = 0
_PREDICTED = 1
ITERATE = 2
_ITERATED = 3
CONVERGED = 4

# Codes of `perform_task` besides those of the linear solver: beams in a floating frame must be
# displaced, the control must be linearized again, the next load step needs further decisions, or
# Newton's method diverges.
DISPLACE = 3
LINEARIZE = 4
HALTED = 5
DIVERGED = -5


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
    """Work arrays of `perform_task`.

    Attributes
    ----------
    common, unloaded, loaded
        Parts C, U and L.
    linear
        Linear solver of the bordered matrix.
    saddle
        Symmetric elimination of the tangent.
    space
        Krylov subspace of the inverse of the stiffness.
    nonzeros
        Non-zeros of the bordered matrix.
    inputs
        (q, 0, lam), with the zeros of velocities and accelerations.
    forces, by_factor
        F and F_mu, (n + m,).
    row, row_targets, row_sources
        Gradient (c_x, c_mu) of the control: nonzeros[row_targets] = row[row_sources].
    origin, origin_mu, excess
        Point (n + m,) and load factor at which the control is linearized, and its deviation from
        the target there.
    column, column_start
        Last column, (n + m,), and its start in `nonzeros`.
    right
        Right-hand side, (n + m + 1,).
    solution, negative, residual, change
        Solution, its negative, its residual, and its last change by refinement.
    response, denominator, has_response
        Solution of the tangent for `column`, (n + m,), and the pivot of the control equation; and 1
        if the solution depends on them, else 0.
    reference
        (q, 0, lam) in the reference configuration, whose tangent scales `saddle` and `held`.
    held_targets, held, held_rows
        Springs in the tangent: nonzeros[held_targets] += held; their coordinates.
    rows, columns
        Rows and columns of `nonzeros`.
    weights
        Weights of the entries of the solution in the norm of its changes.
    axes
        Beams that are displaced nonlinearly.
    displaced, predicted, begin
        Coordinates (n,) after a change, after the prediction along the tangent, and before it.
    squares, distances, points, distance_weights
        Squares of changes (n,), their sums over the coordinates of each point, the index of the
        point of each coordinate, and the reciprocals of the squares of natural sizes.
    mu
        Load factor.
    deviation
        Value of the control equation, for Newton's method.
    center, scale
        The load factor mu of the parts U and L is (load factor - center) * scale.
    task
        `EVALUATE_FORCES`; `EVALUATE_TANGENT` to evaluate also the tangent; `COUNT_SIGNS` to count
        also the negative pivots of `saddle`; `SOLVE` with the given `column` and `right`;
        `EXTEND_SPACE` to add blocks to `space` with the last factors of `saddle`; `CORRECT` to
        find the equilibrium at which the control has its target value; `FOLLOW_LOAD` to take load
        steps.
    needs_scales
        1 if the numbers of the model have changed since the scales were set, else 0.
    has_forces, has_tangent, has_signs
        1 if forces, tangent or signs of pivots have been evaluated at `inputs` and `mu`, else 0.
    has_factors
        1 if the factors of `saddle` are those at `inputs` and `mu`, else 0. With `has_signs`, they
        have a shift of the size of rounding errors.
    may_eliminate, by_blocks
        1 if symmetric elimination may be used, and 1 if it is used, else 0.
    may_renew
        1 if new pivots may be requested for the accuracy of the solution, else 0.
    eliminates, renews
        `may_eliminate` and `may_renew` at the beginning of each iteration.
    phase
        `PREDICT` to begin `CORRECT` with a displacement by `solution`, `ITERATE` to begin without,
        and `CONVERGED` at its end.
    has_frames, is_nonlinear
        1 if beams in a floating frame must be displaced, and 1 if the control is not linear.
    iterations, size, last_size
        Number of iterations, and sizes of the last two corrections.
    continues, has_direction
        1 to compute also the signs of pivots and the direction of the path, `solution`, at the
        equilibrium; and 1 if this succeeds.
    load_stiffness
        Largest square of the derivatives of the tangent with respect to the load factor.
    motion, correction
        Largest displacements, in natural sizes, from `begin` and `predicted` to the equilibrium.
    counts_early, has_counted_early
        1 to compute them before the last correction if possible, and 1 if this is done.
    base, offset
        Last point of `FOLLOW_LOAD` before its last correction, (n + m,), and this correction,
        (n + m + 1,); the displacements of the next step begin there.
    tangent
        Derivative with respect to the load factor at `base`, (n + m + 1,).
    path, path_factors, path_iterations
        Start and equilibria of `FOLLOW_LOAD`, (k, n + m), their load factors and numbers of
        iterations, (k,).
    direction
        Derivative of (x, mu) with respect to the load factor at the last one, (n + m + 1,), up to
        relative errors of the size of `offset`.
    step_count, max_steps
        Number of load steps taken, and its limit.
    all_iterations
        Number of iterations of these steps, with those before a step was shortened.
    step, max_step, load_target
        Proposed and largest change of the load factor in a step, and the load factor at the end.
    negative_pivots
        Number of negative pivots at all equilibria.
    """

    common: LoadPart
    unloaded: LoadPart
    loaded: LoadPart
    linear: Any
    saddle: SaddlePoint
    space: KrylovSpace
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
    reference: Array
    held_targets: Array
    held: Array
    held_rows: Array
    rows: Array
    columns: Array
    weights: Array
    origin: Array
    axes: AxisElements
    displaced: Array
    predicted: Array
    begin: Array
    squares: Array
    distances: Array
    points: Array
    distance_weights: Array
    path: Array
    path_factors: Array
    path_iterations: Array
    direction: Array
    tangent: Array
    base: Array
    offset: Array
    column_start: int
    has_frames: int
    mu: float = 0.0
    center: float = 0.0
    scale: float = 1.0
    deviation: float = 0.0
    denominator: float = 1.0
    origin_mu: float = 0.0
    excess: float = 0.0
    size: float = 0.0
    last_size: float = 0.0
    load_stiffness: float = 0.0
    motion: float = 0.0
    correction: float = 0.0
    step: float = 0.0
    max_step: float = 0.0
    load_target: float = 0.0
    task: int = EVALUATE_FORCES
    needs_scales: int = 1
    has_forces: int = 0
    has_tangent: int = 0
    has_signs: int = 0
    has_factors: int = 0
    may_eliminate: int = 0
    by_blocks: int = 0
    has_response: int = 0
    may_renew: int = 0
    eliminates: int = 0
    renews: int = 0
    phase: int = 0
    is_nonlinear: int = 0
    iterations: int = 0
    continues: int = 0
    counts_early: int = 0
    has_counted_early: int = 0
    has_direction: int = 0
    step_count: int = 0
    max_steps: int = 0
    all_iterations: int = 0
    negative_pivots: int = 0


def perform_task(run: BorderedWorkspace) -> int:
    """Perform the task; return DONE, another code of this module or that of the linear solver."""
    if run.needs_scales == 1:
        _set_scales(run)
    if run.task == EXTEND_SPACE:
        _extend_space(run)
        return DONE
    if run.task == CORRECT:
        return _correct(run)
    if run.task == FOLLOW_LOAD:
        return _follow_load(run)
    return _solve_bordered(run, run.task)


def _set_scales(run: BorderedWorkspace) -> None:
    """Set the scales of `saddle` and `held` by the tangent in the reference configuration."""
    _evaluate_tangent(run, run.reference)
    combine(run.nonzeros, (1.0, 1.0), (run.common.nonzeros, run.unloaded.nonzeros))
    scale_by_reference(run.saddle, run.nonzeros)
    for k in range(run.held.size):
        run.held[k] = run.saddle.joint_size / run.saddle.scales[run.held_rows[k]] ** 2
    run.needs_scales, run.has_tangent = 0, 1
    for k in range(run.inputs.size):
        if run.inputs[k] != run.reference[k]:
            run.has_tangent = 0


def _evaluate_tangent(run: BorderedWorkspace, inputs: Array) -> None:
    common, unloaded, loaded = run.common, run.unloaded, run.loaded
    evaluate_sum(common.tangent, inputs, common.nonzeros)
    evaluate_sum(unloaded.tangent, inputs, unloaded.nonzeros)
    evaluate_sum(loaded.tangent, inputs, loaded.nonzeros)
    combine(run.nonzeros, (1.0, -1.0), (loaded.nonzeros, unloaded.nonzeros))
    run.load_stiffness = max_norm(run.nonzeros, run.nonzeros)


def _extend_space(run: BorderedWorkspace) -> None:
    """Add blocks to the Krylov subspace of the inverse of the shifted stiffness."""
    space = run.space
    if space.blocks == 0:
        for k in range(space.width):
            _apply_shifted_inverse(run, space.candidates[k], space.candidates[k])
    for _ in range(space.blocks_to_add):
        begin_block(space)
        for k in range(space.first, space.vectors):
            _apply_shifted_inverse(run, space.basis[k], space.images[k])
        end_block(space)


def _apply_shifted_inverse(run: BorderedWorkspace, vector: Array, image: Array) -> None:
    work, n = run.saddle.work, run.displaced.size
    fill(work, 0.0)
    combine(work[:n], (1.0,), (vector,))
    substitute(run.saddle.factors, work)
    combine(image, (1.0,), (work[:n],))


def choose_step(proposed: float, reach: float, largest: float) -> float:
    """Return the size of the next step; `reach` is the distance to the target."""
    size = min(proposed, reach, largest)
    if size < reach < _SPLIT_RATIO * size:
        size = reach if reach < _ROUNDING_RATIO * size else 0.5 * reach
    return size


def propose_step(size: float, iterations: int, correction: float, motion: float) -> float:
    """Return the size of the step after one that took `iterations` for a `correction`.

    `motion` and `correction` are the distances from the begin and from the prediction.
    """
    ratio = max(correction - CORRECTION_ROUNDING, 0.0) / (motion + CORRECTION_ROUNDING)
    is_close = ratio < _MAX_CORRECTION_TO_GROW and iterations <= _MAX_STIFF_ITERATIONS_TO_GROW
    return size * _GROWTH_FACTOR if is_close or iterations <= _MAX_ITERATIONS_TO_GROW else size


def _follow_load(run: BorderedWorkspace) -> int:
    """Take load steps from an equilibrium at which `direction` is known.

    Return DONE at the target, FULL after `max_steps`, or HALTED before a step that fails although
    it has been shortened, or after which the number of negative eigenvalues changes or is not
    certain.
    """
    run.step_count = run.all_iterations = 0
    _store_point(run)
    _place_base(run)
    while run.step_count < run.max_steps:
        reach, iterations = abs(run.load_target - run.path_factors[run.step_count]), 0
        step = choose_step(run.step, reach, run.max_step)
        min_step = min(MIN_STEP_RATIO * run.max_step, step)
        succeeded = False
        while not succeeded:
            value = _predict_at_load(run, step, step == reach)
            # At the target, modes are computed with the last factors.
            run.counts_early = 0 if value == run.load_target else 1
            code = _correct(run)
            run.counts_early = 0
            iterations += run.iterations
            succeeded = code == DONE and not leaves_path(run.correction, run.motion)
            run.linear.singular = 0
            if not succeeded:
                step *= CUT_FACTOR
                _place_base(run)
            if code == NEW_PIVOTS or step < min_step:
                run.linear.needs_pivots = 0
                return HALTED
        if not _is_regular(run):
            return HALTED
        combine(run.direction, (1.0,), (run.solution,))
        run.step_count += 1
        run.all_iterations += iterations
        _store_point(run)
        if run.has_counted_early == 0:
            _place_base(run)
        proposed = propose_step(step, run.iterations, run.correction, run.motion)
        if value == run.load_target:
            # A step that is shortened to meet a target does not shorten the next step.
            run.step = max(proposed, run.step)
            return DONE
        run.step = proposed
    return FULL


def _store_point(run: BorderedWorkspace) -> None:
    n, k = run.displaced.size, run.step_count
    point = run.path[k]
    combine(point[:n], (1.0,), (run.inputs[:n],))
    combine(point[n:], (1.0,), (run.inputs[2 * n :],))
    run.path_factors[k], run.path_iterations[k] = run.mu, run.iterations


def _place_base(run: BorderedWorkspace) -> None:
    combine(run.base, (1.0,), (run.path[run.step_count],))
    fill(run.offset, 0.0)


def _predict_at_load(run: BorderedWorkspace, step: float, is_last: bool) -> float:
    """Prepare `CORRECT` for a load step from the last point of `path`; return its load factor."""
    n, k = run.displaced.size, run.step_count
    run.mu = run.path_factors[k]
    combine(run.inputs[:n], (1.0,), (run.base[:n],))
    combine(run.inputs[2 * n :], (1.0,), (run.base[n:],))
    combine(run.begin, (1.0,), (run.path[k, :n],))
    change = step if run.load_target > run.mu else -step
    combine(run.solution, (1.0, change), (run.offset, run.direction))
    # The curvature of the path limits the step, although it is extrapolated.
    combine(run.predicted, (1.0,), (run.solution[:n],))
    displace_axes(run.axes, run.inputs, run.solution, run.predicted)
    combine(run.predicted, (1.0, 1.0), (run.inputs[:n], run.predicted))
    _extrapolate_curvature(run, change)
    value = run.load_target if is_last else run.mu + change
    run.excess, run.last_size, run.iterations = -value, np.inf, 0
    run.phase, run.has_direction = PREDICT, 0
    return value


def _extrapolate_curvature(run: BorderedWorkspace, change: float) -> None:
    """Add terms of second and third order in `change` of the load factor to `solution`.

    With them, the displacement dx from `base` has the last `direction` d and passes through
    previous points:

        dx(c) = dx(0) + c d + c^2 sum_j w_j (dx(c_j) - dx(0) - c_j d) / c_j^2

    for changes c, c_1 and c_2 of the load factor from the last point, w_2 = (c - c_1) / (c_2 - c_1)
    and w_1 = 1 - w_2. With one previous point, w_1 = 1.
    """
    last, size, curved, difference = run.step_count, run.forces.size, run.residual, run.change
    count, second = min(last, _MAX_PREVIOUS_POINTS), 0.0
    if count > 1:
        first = run.path_factors[last - 1] - run.mu
        second = (change - first) / (run.path_factors[last - 2] - run.mu - first)
    fill(curved, 0.0)
    for k in range(count):
        other, distance = run.path[last - 1 - k], run.path_factors[last - 1 - k] - run.mu
        weight = (second if k == 1 else 1.0 - second) * (change / distance) ** 2
        combine(difference[:size], (1.0, -1.0), (other, run.base))
        restore_axes(run.axes, run.base, other, difference)
        parts = (curved[:size], difference[:size], run.offset[:size], run.direction[:size])
        combine(curved[:size], (1.0, weight, -weight, -weight * distance), parts)
    if max_norm(curved, run.weights) <= _MAX_CURVED_RATIO * max_norm(run.solution, run.weights):
        combine(run.solution, (1.0, 1.0), (run.solution, curved))


def leaves_path(correction: float, motion: float) -> bool:
    """Return True if a correction is so large that the point probably lies on another path."""
    return correction > MAX_CORRECTION_RATIO * motion + CORRECTION_ROUNDING


def _is_regular(run: BorderedWorkspace) -> bool:
    """Return True if the last step certainly crosses no critical point."""
    saddle = run.saddle
    if run.has_direction == 0 or not max_norm(run.solution, run.weights) < np.inf:
        return False
    if saddle.below != run.negative_pivots or saddle.above != run.negative_pivots:
        return False
    return saddle.size > NEGLIGIBLE_STIFFNESS and (
        saddle.asymmetry <= ASYMMETRY_TOLERANCE * saddle.size
    )


def _correct(run: BorderedWorkspace) -> int:
    """Find the equilibrium at which the control has its target value.

    After the codes `DISPLACE`, `LINEARIZE` and `NEW_PIVOTS`, another call continues.
    """
    n, size = run.displaced.size, run.forces.size
    while run.phase != CONVERGED:
        if run.phase == ITERATE:
            code = _find_correction(run)
            if code != DONE:
                return code
        if run.phase == PREDICT or run.phase == ITERATE:
            combine(run.displaced, (1.0,), (run.solution[:n],))
            displace_axes(run.axes, run.inputs, run.solution, run.displaced)
            combine(run.displaced, (1.0, 1.0), (run.inputs[:n], run.displaced))
            run.phase = _PREDICTED if run.phase == PREDICT else _ITERATED
            if run.has_frames == 1:
                return DISPLACE
        combine(run.inputs[:n], (1.0,), (run.displaced,))
        multipliers = run.inputs[2 * n :]
        combine(multipliers, (1.0, 1.0), (multipliers, run.solution[n:size]))
        run.mu += run.solution[size]
        run.has_forces, run.has_tangent, run.has_signs, run.has_factors = 0, 0, 0, 0
        run.may_eliminate, run.may_renew = run.eliminates, run.renews
        if run.phase == _PREDICTED:
            if run.task == CORRECT:
                combine(run.predicted, (1.0,), (run.displaced,))
            run.phase = ITERATE
        elif _has_converged(run):
            run.phase = CONVERGED
        elif run.iterations == _MAX_ITERATIONS:
            return NOT_CONVERGED
        else:
            run.phase = ITERATE
        if run.phase == ITERATE and run.is_nonlinear == 1:
            return LINEARIZE
    combine(run.squares, (1.0, -1.0), (run.inputs[:n], run.begin))
    run.motion = max_norm(run.squares, run.weights[:n])
    combine(run.squares, (1.0, -1.0), (run.inputs[:n], run.predicted))
    run.correction = max_norm(run.squares, run.weights[:n])
    run.has_counted_early = 0
    if run.has_direction == 1 and run.size <= _MAX_LAST_CORRECTION:
        run.has_counted_early = 1
        combine(run.offset, (1.0,), (run.solution,))
        run.offset[size] = 0.0
        combine(run.solution, (1.0,), (run.tangent,))
        return DONE
    return _continue_path(run) if run.continues == 1 else DONE


def _find_correction(run: BorderedWorkspace) -> int:
    """Set `solution` to the change of Newton's method, and `size` to its size."""
    n, size, change = run.displaced.size, run.forces.size, run.change
    combine(change[:n], (1.0, -1.0), (run.inputs[:n], run.origin[:n]))
    combine(change[n:size], (1.0, -1.0), (run.inputs[2 * n :], run.origin[n:]))
    run.deviation = run.excess + inner_product(run.row[:size], change[:size])
    run.deviation += run.row[size] * (run.mu - run.origin_mu)
    run.has_direction = 0
    if run.counts_early == 1 and run.last_size <= _MAX_EARLY_CORRECTION and _is_balanced(run):
        code = _continue_path(run)
        if code != DONE:
            return code
        combine(run.tangent, (1.0,), (run.solution,))
        combine(run.base[:n], (1.0,), (run.inputs[:n],))
        combine(run.base[n:], (1.0,), (run.inputs[2 * n :],))
    code = _solve_bordered(run, _SOLVE_NEWTON)
    if code != DONE:
        return code
    if not max_norm(run.solution, run.weights) < np.inf:
        return NOT_FINITE
    # The displacements of the points, see `DisplacementMeasure`.
    multiply(run.squares, run.solution[:n], run.solution[:n])
    fill(run.distances, 0.0)
    add(run.distances, run.points, run.squares, run.row_sources, 0, n)
    pick(run.squares, run.row_sources, run.distances, run.points, 0, n)
    run.size = math.sqrt(max_norm(run.squares, run.distance_weights))
    return DONE if run.size <= _DIVERGENCE_LIMIT else DIVERGED


def _is_balanced(run: BorderedWorkspace) -> bool:
    """Return True if unbalanced forces are smaller than rounding errors of the stiffness."""
    _solve_bordered(run, EVALUATE_FORCES)
    residual = max_norm(run.forces, run.saddle.scales)
    return residual <= SPARSE_ZERO_TOLERANCE * run.saddle.reference


def _has_converged(run: BorderedWorkspace) -> bool:
    """Count an iteration; return True if the next correction would be negligible."""
    size, last_size = run.size, run.last_size
    run.iterations += 1
    run.last_size = size
    if size <= _CONVERGENCE_TOLERANCE:
        return True
    if last_size <= _QUADRATIC_LIMIT and size**3 <= _PREDICTED_TOLERANCE * last_size**2:
        return True
    return size <= _STAGNATION_TOLERANCE and size > _STAGNATION_RATIO * last_size


def _continue_path(run: BorderedWorkspace) -> int:
    """Count signs of pivots; set `solution` to the derivative by the control, if it is certain."""
    run.has_direction = 0
    if run.has_signs == 0:
        _solve_bordered(run, EVALUATE_TANGENT)
        if run.load_stiffness != 0.0:
            # The loads may have no potential, so that signs of pivots do not decide.
            return DONE
        _solve_bordered(run, COUNT_SIGNS)
    size = run.forces.size
    combine(run.column, (1.0,), (run.by_factor,))
    fill(run.right, 0.0)
    run.right[size] = 1.0
    code = _solve_bordered(run, SOLVE)
    if code == NEW_PIVOTS:
        return code
    run.has_direction = 1 if code == DONE else 0
    run.linear.singular = 0
    return DONE


def _solve_bordered(run: BorderedWorkspace, task: int) -> int:
    """Evaluate the equations and perform the task; return DONE or the code of the linear solver."""
    common, unloaded, loaded = run.common, run.unloaded, run.loaded
    mu = (run.mu - run.center) * run.scale
    if run.has_forces == 0:
        evaluate_sum(common.residual, run.inputs, common.forces)
        evaluate_sum(unloaded.residual, run.inputs, unloaded.forces)
        evaluate_sum(loaded.residual, run.inputs, loaded.forces)
        run.has_forces = 1
    # Increments, so that entries without loads are independent of mu to the last digit.
    combine(run.by_factor, (run.scale, -run.scale), (loaded.forces, unloaded.forces))
    change = run.mu - run.center
    combine(run.forces, (1.0, 1.0, change), (common.forces, unloaded.forces, run.by_factor))
    if task == EVALUATE_FORCES:
        return DONE
    if run.has_tangent == 0:
        _evaluate_tangent(run, run.inputs)
        run.has_tangent = 1
    parts = (common.nonzeros, unloaded.nonzeros, loaded.nonzeros)
    combine(run.nonzeros, (1.0, 1.0 - mu, mu), parts)
    add(run.nonzeros, run.held_targets, run.held, run.row_sources, 0, run.held.size)
    if task == EVALUATE_TANGENT:
        return DONE
    if task == COUNT_SIGNS:
        count_signs(run.saddle, run.nonzeros)
        run.has_signs = 1
        # With an eigenvalue between the shifts, the shift would determine the solution.
        run.has_factors = 0
        if run.saddle.below == run.saddle.above and run.saddle.below >= 0:
            run.has_factors = serve_solutions(run.saddle)
        return DONE
    size, column_start = run.forces.size, run.column_start
    if task == _SOLVE_NEWTON:
        combine(run.column, (1.0,), (run.by_factor,))
        combine(run.right[:size], (-1.0,), (run.forces,))
        run.right[size] = -run.deviation
    pick(run.nonzeros, run.row_targets, run.row, run.row_sources, 0, size + 1)
    combine(run.nonzeros[column_start : column_start + size], (1.0,), (run.column,))
    run.by_blocks = run.may_eliminate
    while run.by_blocks == 1:
        if run.has_factors == 0:
            run.by_blocks = run.has_factors = factorize_saddle_point(run.saddle, run.nonzeros)
            # The factors of the shifted matrix are lost.
            run.has_signs = 0
        if run.by_blocks == 1:
            # Corrections at a given load factor do not change it.
            is_at_load = run.row[size] != 0.0 and max_norm(run.row[:size], run.row[:size]) == 0.0
            run.has_response = 0 if is_at_load and run.right[size] == 0.0 else 1
            if run.has_response == 1:
                solve_saddle_point(run.saddle, run.column, run.response)
                run.denominator = run.row[size] - inner_product(run.row[:size], run.response)
            if _refine(run) <= _MAX_ELIMINATION_REFINEMENT:
                return DONE
            if run.has_signs == 0:
                # Elimination is inaccurate, for example near limit points.
                run.by_blocks, run.may_eliminate = 0, 0
            # Otherwise, the shift is too large: the stiffness of thin beams with fine meshes
            # differs little from rounding errors.
            run.has_factors = 0
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
    fill(change, 0.0)
    if max_norm(residual[:size], residual[:size]) != 0.0:
        solve_saddle_point(run.saddle, residual[:size], change[:size])
    if run.has_response == 1:
        factor = (residual[size] - inner_product(run.row[:size], change[:size])) / run.denominator
        combine(change[:size], (1.0, -factor), (change[:size], run.response))
        change[size] = factor
