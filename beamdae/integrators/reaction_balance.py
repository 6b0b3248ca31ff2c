"""Reactions after a run: balance with the forces, and those of redundant constraints.

Where the constraint Jacobian G nearly loses rank, a step determines the reactions only up to its
errors divided by the smallest singular value of G and by the length of the step, although the
reactions of a motion through the position are finite and smooth. A polynomial lam(t) therefore
balances the momentum of all steps near the position: it minimizes the sum of
h^2 |F + G^T lam(t)|^2, in which steps of length h with larger singular values count more. Each row
then minimizes h^2 |F + G^T lam|^2 + c^2 |lam - lam(t)|^2 with a small c, so that rows that
determine their reactions keep them. All terms are scaled: rows of G have length one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial.legendre import legvander

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.smooth_intervals import time_on_branch
from beamdae.equations.starts.dependent_constraints import (
    MIN_RELATIVE_SHARE,
    build_constraint_jacobian,
    has_closed_loops,
)
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.results.singular_positions import count_samples
from beamdae.results.solution import Solution
from beamdae.results.trajectory import Interval, Trajectory

if TYPE_CHECKING:
    from beamdae.equations.starts.reduced_equations import ReducedEquations

Array = np.ndarray


def remove_redundant(equations: EquationsOfMotion, start: float) -> ReducedEquations | None:
    """Return equations without the constraints that are redundant after `start` [s], or None.

    None means that the model does not request the removal or has no redundant constraints.
    """
    if not equations.redundant:
        return None
    # Models without redundant constraints start faster without this import.
    from beamdae.equations.starts.reduced_equations import remove_redundant_constraints

    return remove_redundant_constraints(equations, time_on_branch(equations.breakpoints, start))


def restore_reactions(solution: Solution, reduced: ReducedEquations) -> Solution:
    """Return the solution of the full equations.

    The multipliers of all constraints have the minimum norm among those that give the same forces;
    see `ReducedEquations.restore_reactions` for the norm.
    """

    def restore(interval: Interval) -> Interval:
        rows = interval.rows
        lam = reduced.restore_reactions(interval.times, rows.q, rows.lam)
        return replace(interval, rows=rows._replace(lam=lam))

    return replace(
        solution,
        equations=reduced.full,
        trajectory=Trajectory(tuple(map(restore, solution.trajectory.intervals))),
        integrator={**solution.integrator, "redundant": reduced.description},
    )


# Smallest singular values of G, relative to their largest value over a run, below which positions
# are nearly singular, and below which steps belong to the polynomial through such a position.
_NEARLY_SINGULAR = 0.2
_NEAR = 0.3
# The constant c, relative to the longest step near the position.
_POLYNOMIAL_SHARE = 0.02
_DEGREE = 5
# Least weight of a step among those that determine the degree of the polynomial.
_LEAST_WEIGHT = 1e-3
# Largest forces that the polynomial leaves, relative to those that it balances in the direction of
# the smallest singular value.
_MAX_MISFIT = 0.05
# Reactions are unbounded if the remaining force exceeds this multiple of its standard error. It was
# below 3 without such a force, and above 11 if the masses of two cranks differed by 1 %.
_SIGNIFICANT = 10.0
# Number of nodes on each side of such a position whose reactions are unbounded.
_DENSE_NODES = 3
# Largest number of nodes that determine a polynomial, and that are evaluated together elsewhere.
_MAX_FITTED, _BLOCK = 256, 1024


def balance_reactions(solution: Solution) -> Solution:
    """Return the solution with the reactions of the balance, in runs near singular positions.

    A force that remains at the position, where no reaction can balance it, makes reactions grow
    without bounds; they are NaN where this part exceeds all other reactions. Runs with forces that
    depend on reactions are not changed.
    """
    e = solution.equations
    if e.has_friction:
        return solution
    balanced = [_balance(e, interval) for interval in solution.trajectory.intervals]
    if all(x is y for x, y in zip(balanced, solution.trajectory.intervals, strict=True)):
        return solution
    return replace(solution, trajectory=Trajectory(tuple(balanced)))


def bound_reactions(solution: Solution) -> Solution:
    """Return the solution with the reactions of single rows instead of NaN, for derivatives."""
    intervals = solution.trajectory.intervals
    if all(np.isfinite(x.rows.lam).all() for x in intervals):
        return solution
    bounded = (_bound(solution.equations, interval) for interval in intervals)
    return replace(solution, trajectory=Trajectory(tuple(bounded)))


def _bound(whole: EquationsOfMotion, interval: Interval) -> Interval:
    evaluator, lam = StateEvaluator(whole), interval.rows.lam.copy()
    for k in np.flatnonzero(np.isnan(lam).any(axis=1)):
        q, v, a, _ = (x[k] for x in interval.rows)
        gradient = evaluator.constraint_matrix(interval.times[k], q).toarray()
        lam[k] = np.linalg.lstsq(gradient.T, -evaluator.force(interval.times[k], q, v, a))[0]
    return replace(interval, rows=interval.rows._replace(lam=lam))


def _balance(whole: EquationsOfMotion, interval: Interval) -> Interval:
    e, (q, v, a, lam) = interval.active_equations(whole), interval.rows
    if not has_closed_loops(e) or len(q) < _DEGREE:
        return interval
    jacobian = build_constraint_jacobian(e)
    sampled = np.unique(np.linspace(0, len(q) - 1, count_samples(e.m)).astype(int))
    values = jacobian.smallest_singular_values(interval.times[sampled], q[sampled])
    if not values.min() < _NEARLY_SINGULAR * values.max():
        return interval
    values = jacobian.smallest_singular_values(interval.times, q)
    is_near = values < _NEAR * values.max()
    h = np.repeat(np.diff(interval.t) / interval.nodes_per_step, interval.nodes_per_step)
    h = np.append(h.max(), h)
    evaluator, columns = StateEvaluator(e), jacobian.columns
    lam = np.zeros((len(q), e.m))
    blocks = np.arange(_BLOCK, len(q), _BLOCK)
    ends = 1 + np.flatnonzero(np.diff(is_near))
    for k in np.split(np.arange(len(q)), np.union1d(ends, blocks[~is_near[blocks]])):
        rows, lengths = jacobian.scaled(interval.times[k], q[k])
        states = zip(interval.times[k], q[k], v[k], a[k], strict=True)
        forces = np.array([evaluator.force(*x)[columns] for x in states])
        forces = forces.reshape(len(k), -1) * e.position_scales[columns]
        if not np.isfinite(forces).all():
            return interval
        squares, vectors = np.linalg.eigh(rows @ rows.swapaxes(1, 2))
        squares = np.maximum(squares, np.finfo(float).tiny)
        balanced = _apply(vectors.swapaxes(1, 2), -_apply(rows, forces)) / squares
        balanced = _apply(vectors, balanced)
        if values[k].min() < _NEARLY_SINGULAR * values.max():
            weak = vectors[:, :, 0]
            balanced = _balance_together(e, interval.nodes[k], h[k], rows, forces, weak, balanced)
        lam[k] = balanced / np.where(lengths > 0.0, lengths, 1.0)
    if interval.configuration is not None:
        lam = interval.configuration.expand_multipliers(lam, whole.m)
    return replace(interval, rows=interval.rows._replace(lam=lam))


def _balance_together(
    e: EquationsOfMotion, t: Array, h: Array, rows: Array, forces: Array, weak: Array, single: Array
) -> Array:
    """Return the scaled reactions (k, m) of successive rows near a singular position.

    Parameters
    ----------
    e
        Equations of motion.
    t, h
        Times, and lengths of the steps between nodes (k,) [s].
    rows, forces
        Scaled G (k, m, n) and F (k, n).
    weak
        Left singular vectors of the smallest singular values, (k, m).
    single
        Scaled reactions that balance the forces of each row, (k, m); returned if the reactions
        vibrate, so that no polynomial follows them.
    """
    root = h / h.max()
    weights, span = root**2, max(t[-1] - t[0], np.finfo(float).tiny)
    degree = min(_DEGREE, max(int(np.sum(weights > _LEAST_WEIGHT)) // 2 - 1, 0))
    powers = legvander((2.0 * t - t[0] - t[-1]) / span, degree)
    # Forces along which the weak vectors act, with continuous signs.
    directions = _apply(rows.swapaxes(1, 2), weak)
    values = np.linalg.norm(directions, axis=1)
    directions /= values[:, None]
    turns = np.where(np.sum(directions[1:] * directions[:-1], axis=1) < 0.0, -1.0, 1.0)
    signs = np.cumprod(np.append(1.0, turns))[:, None]
    (fitted,) = np.nonzero(weights > _LEAST_WEIGHT)
    fitted = fitted[np.unique(np.linspace(0, len(fitted) - 1, _MAX_FITTED).astype(int))]
    factors = root[fitted, None]
    shapes = np.einsum("ki,kan->knia", factors * powers[fitted], rows[fitted])
    constant = (factors * signs[fitted] * directions[fitted]).ravel()
    matrix = np.column_stack([shapes.reshape(len(constant), -1), constant])
    loads = (factors * forces[fitted]).ravel()
    solution = -np.linalg.lstsq(matrix, loads)[0]
    polynomial, remaining = powers @ solution[:-1].reshape(-1, e.m), float(solution[-1])
    left = float(np.linalg.norm(matrix @ solution + loads)) / np.sqrt(len(loads))
    triangle = np.linalg.qr(matrix)[1]
    squares = np.average(values**2, weights=weights)
    squares *= np.average(np.sum(polynomial**2, axis=1), weights=weights)
    if left**2 * rows.shape[2] > _MAX_MISFIT**2 * squares:
        return single
    is_unbounded = np.zeros(len(t), bool)
    if abs(remaining * triangle[-1, -1]) > _SIGNIFICANT * left:
        is_unbounded = abs(remaining) > values * np.linalg.norm(polynomial, axis=1).max()
        # Polynomials of the dense output through the nearest nodes do not follow the reactions.
        is_unbounded |= np.abs(t - t[np.argmin(values)]) < _DENSE_NODES * h
        polynomial += signs * remaining * weak / values[:, None]
    normal = weights[:, None, None] * (rows @ rows.swapaxes(1, 2))
    normal += _POLYNOMIAL_SHARE**2 * np.eye(e.m)
    right = _POLYNOMIAL_SHARE**2 * polynomial - weights[:, None] * _apply(rows, forces)
    reactions = np.linalg.solve(normal, right[..., None])[..., 0]
    if is_unbounded.any():
        names = np.array([name.rpartition(".")[0] for name in e.lam_names])
        shares = np.abs(weak[np.argmin(values)])
        involved = np.isin(names, names[shares > MIN_RELATIVE_SHARE * shares.max()])
        reactions[np.ix_(is_unbounded, involved)] = np.nan
    return reactions


def _apply(matrices: Array, vectors: Array) -> Array:
    return (matrices @ vectors[..., None])[..., 0]
