"""Signs of the pivots of static equations, by symmetric elimination.

The saddle-point matrix of the tangent, with the stiffness K, the constraint matrix G and the
compliances C of constraints, is

    [[K + G^T G, G^T], [G, -C / (1 - C)]]

in units of natural sizes in which the largest entry of each row is 1, and C at most 1/2. G^T G is a
share of the stiffness of joints and springs, but not of beams, whose K is regular and whose
constraints keep -C. It keeps leading pivots nonzero if bodies would be free without their joints
and springs, so that the matrix can be eliminated in an order that depends on the pattern only:
along the mechanism, each multiplier after the coordinates that it couples.

By Sylvester's law of inertia, the number of negative pivots is m plus the number of negative
eigenvalues of K + G^T C^-1 G in the motions that the joints allow, in any units. Rounding errors
may change the signs of pivots only if a pivot is close to zero. Then, pivots are counted for
K - s I with shifts s on both sides of zero; the difference is the number of motions without
stiffness.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from beamdae.bounded_cache import array_bytes, bounded_cache
from beamdae.linear.fixed_order import (
    FixedOrder,
    FixedOrderFactors,
)
from beamdae.linear.orderings import compute_bordered_ordering
from beamdae.native.loop_functions import (
    add,
    add_weighted,
    count_negative_pivots,
    fill,
    gather,
    max_norm,
)

Array = np.ndarray

# Shifts relative to the largest entry of the stiffness. Above 2e-16, signs of pivots are right for
# all zero eigenvalues that were tried: free beams with h/L = 1e-5 to 3e-2 and 2 to 128 elements in
# any position, prestressed beams, and linkages of up to 60 bodies.
_SHIFT_RATIO = 1e-15
# Asymmetry up to which the stiffness is treated as symmetric, relative to its largest entry. It is
# small because a follower load is small compared with the axial stiffness of a thin beam.
ASYMMETRY_TOLERANCE = 1e-13
# If no entry of the stiffness exceeds this value [J], all are zeros or rounding errors, as without
# loads and springs. The thermal energy of a coordinate is larger (2e-21 J at room temperature).
NEGLIGIBLE_STIFFNESS = 1e-22
# Motions with a pivot below this fraction may have no stiffness: pivots of coordinates are their
# stiffness if all later ones are free to move.
_MIN_PIVOT_RATIO = 1e-13
# Steps of equilibration: each halves the logarithm of the ratio of rows. Largest compliance, and
# size of multipliers before.
_EQUILIBRATIONS, _MAX_COMPLIANCE, _FIRST_SIZE = 10, 0.5, 0.5
# Memory of the cached index arrays [bytes]: about 3 kB per element of a beam.
_MAX_CACHED_BYTES = 16 * 2**20


class SaddlePattern(NamedTuple):
    """Terms of the saddle-point matrix: indices of non-zeros of the tangent and of the matrix.

    Attributes
    ----------
    rows, columns
        Rows and columns of the non-zeros of the tangent.
    targets, sources, shares
        nonzeros[targets] += shares * tangent[sources]: the stiffness, its transpose, G, and its
        transpose. Shares of the symmetric part are 1/2.
    skew_rows, skew_sources, skew_signs
        Differences of opposite entries: skew[skew_rows] += skew_signs * tangent[skew_sources].
    product_targets, product_left, product_right
        nonzeros[product_targets] += tangent[product_left] * tangent[product_right]: G^T G.
    reduced
        Compliances beside G^T G.
    diagonal
        Diagonal entries of the coordinates.
    groups, group_rows, group_columns, pairs
        First coordinate of the part of each coordinate, and multipliers; pairs of these groups that
        share terms, and the index of each term in them.
    plan
        Elimination in order, each multiplier after the coordinates that it couples.
    """

    rows: Array
    columns: Array
    targets: Array
    sources: Array
    shares: Array
    skew_rows: Array
    skew_sources: Array
    skew_signs: Array
    product_targets: Array
    product_left: Array
    product_right: Array
    reduced: Array
    diagonal: Array
    groups: Array
    group_rows: Array
    group_columns: Array
    pairs: Array
    plan: FixedOrder


@dataclass(slots=True)
class SaddlePoint:
    """Work arrays of `count_signs`.

    Attributes
    ----------
    pattern
        Terms of the matrix.
    factors
        Factors of the last matrix.
    sources, skew_sources, product_left, product_right
        Those of the pattern, as indices of the argument of `count_signs`.
    scales
        Natural sizes of the unknowns, (n + m,).
    weights, skew_weights, product_weights
        Factors of the terms of the pattern, in natural sizes.
    values, skew, left, nonzeros
        Halves of the entries of the stiffness, differences of opposite entries, factors of
        products, and the saddle-point matrix.
    shift, counting, ones
        Shift of each coordinate, (n,), 0, 1, 2, ..., and ones for the norms of entries.
    rigid
        Number of unknowns before the multipliers of constraints with compliance.
    reference
        Largest entry of the stiffness at the start, see `scale_by_reference`. The stiffness may
        vanish at a critical point, where rounding is that of its terms.
    size, asymmetry
        Largest entry of the stiffness or `reference`, and largest difference of opposite entries.
    below, above
        Numbers of negative pivots with a shift slightly below and above zero; -1 if a pivot
        vanishes.
    """

    pattern: SaddlePattern
    factors: FixedOrderFactors
    sources: Array
    skew_sources: Array
    product_left: Array
    product_right: Array
    scales: Array
    weights: Array
    skew_weights: Array
    product_weights: Array
    values: Array
    skew: Array
    left: Array
    nonzeros: Array
    shift: Array
    counting: Array
    ones: Array
    rigid: int
    reference: float = 0.0
    size: float = 0.0
    asymmetry: float = 0.0
    below: int = 0
    above: int = 0

    @classmethod
    def of(
        cls, pattern: sp.csc_array, positions: Array, parts: Array, rigid: int, remainder: Array
    ) -> SaddlePoint:
        """Return the work arrays for tangents with this pattern, without natural sizes.

        The non-zeros of the tangent are at `positions` in the argument of `count_signs`. `parts`
        contains the first coordinate of the part of each coordinate, (n,). The first `rigid` of the
        n + m unknowns have no compliance; that of the others is 1. Constraints with a `remainder`,
        (m,), are beside a stiffness of the same motion.
        """
        n, positions = len(parts), positions.astype(np.uint32)
        indices = pattern.indices.astype(np.intp).tobytes()
        starts = pattern.indptr.astype(np.intp).tobytes()
        shared = (remainder == 0.0).tobytes()
        saddle = _plan_saddle_point(parts.astype(np.intp).tobytes(), shared, starts, indices)
        stiffness, products = int(np.sum(saddle.shares < 1.0)) // 2, len(saddle.product_left)
        return cls(
            pattern=saddle,
            factors=FixedOrderFactors.of(saddle.plan),
            sources=positions[saddle.sources],
            skew_sources=positions[saddle.skew_sources],
            product_left=positions[saddle.product_left],
            product_right=positions[saddle.product_right],
            scales=np.ones(pattern.shape[0]),
            weights=saddle.shares.copy(),
            skew_weights=saddle.skew_signs.copy(),
            product_weights=np.ones(products),
            values=np.zeros(stiffness),
            skew=np.zeros(stiffness),
            left=np.zeros(products),
            nonzeros=np.zeros(len(saddle.plan.sources)),
            shift=np.zeros(n),
            counting=np.arange(max(n, stiffness, products), dtype=np.uint32),
            ones=np.ones(stiffness),
            rigid=rigid,
        )


def scale_by_reference(run: SaddlePoint, tangent: Array, sizes: Array) -> None:
    """Set natural sizes and `reference` by the tangent in the reference configuration, unloaded.

    `sizes` are first sizes of the coordinates, (n,). The final ones make all parts equally stiff:
    otherwise, rounding errors of large and stiff parts would exceed the stiffness of small and soft
    ones (D. Ruiz, A scaling algorithm to equilibrate both rows and columns norms in matrices,
    RAL-TR-2001-034). Parts without stiffness are as stiff as their softest spring or, without
    springs, as what their joints attach them to. By Sylvester's law of inertia, sizes do not change
    the number of negative eigenvalues.
    """
    n, count, pattern = len(sizes), len(run.scales), run.pattern
    scales = np.append(sizes, np.full(count - n, _FIRST_SIZE))
    _set_weights(run, scales)
    rows, columns = pattern.group_rows, pattern.group_columns
    entries, softest, factors = np.zeros(len(rows)), np.full(count, np.inf), np.ones(count)
    np.maximum.at(entries, pattern.pairs, np.abs(run.weights * tangent[run.sources]))
    is_stiffness = (rows < n) & (entries > NEGLIGIBLE_STIFFNESS)
    is_spring = (rows >= run.rigid) & (entries > 0.0)
    np.minimum.at(softest, columns[is_spring], entries[is_spring])
    is_softest = np.isinf(softest[columns]) | (entries == softest[columns])
    is_used = np.where(np.isin(columns, columns[is_stiffness]), is_stiffness, is_softest)
    entries[(columns < n) & ~is_used] = 0.0
    for _ in range(_EQUILIBRATIONS):
        largest = np.zeros(count)
        np.maximum.at(largest, columns, entries * factors[rows] * factors[columns])
        factors /= np.sqrt(np.where(largest > 0.0, largest, 1.0))
    scales *= factors[pattern.groups]
    scales[run.rigid :] = np.minimum(scales[run.rigid :], math.sqrt(_MAX_COMPLIANCE))
    _set_weights(run, scales)
    run.reference = 0.0
    _measure_stiffness(run, tangent)
    run.reference = run.size


def _set_weights(run: SaddlePoint, scales: Array) -> None:
    """Set the natural sizes of the unknowns."""
    pattern = run.pattern
    weights = scales[pattern.rows] * scales[pattern.columns]
    # -C becomes -C / (1 - C).
    weights[pattern.reduced] /= 1.0 - weights[pattern.reduced]
    run.scales[:] = scales
    run.weights[:] = pattern.shares * weights[pattern.sources]
    run.skew_weights[:] = pattern.skew_signs * weights[pattern.skew_sources]
    run.product_weights[:] = weights[pattern.product_left] * weights[pattern.product_right]


def _assemble_terms(run: SaddlePoint, tangent: Array) -> None:
    """Set `nonzeros` to the matrix without G^T G."""
    targets, count = run.pattern.targets, run.sources.size
    fill(run.nonzeros, 0.0)
    add_weighted(run.nonzeros, targets, run.weights, tangent, run.sources, 0, count)


def _measure_stiffness(run: SaddlePoint, tangent: Array) -> None:
    """Set `size` and `asymmetry` for a tangent with these non-zeros."""
    values, rows, count = run.values, run.pattern.skew_rows, run.values.size
    gather(values, run.counting, run.weights, tangent, run.sources, 0, count)
    run.size = max(2.0 * max_norm(values, run.ones), run.reference)
    fill(run.skew, 0.0)
    add_weighted(run.skew, rows, run.skew_weights, tangent, run.skew_sources, 0, rows.size)
    run.asymmetry = max_norm(run.skew, run.ones)


def assemble_saddle_point(run: SaddlePoint, tangent: Array) -> None:
    """Set `size`, `asymmetry` and `nonzeros` for a tangent with these non-zeros."""
    left, count = run.left, run.left.size
    _measure_stiffness(run, tangent)
    _assemble_terms(run, tangent)
    gather(left, run.counting, run.product_weights, tangent, run.product_left, 0, count)
    targets = run.pattern.product_targets
    add_weighted(run.nonzeros, targets, left, tangent, run.product_right, 0, count)


def count_signs(run: SaddlePoint, tangent: Array) -> None:
    """Set `size`, `asymmetry`, `below` and `above` for a tangent with these non-zeros."""
    assemble_saddle_point(run, tangent)
    run.below = run.above = count_negative_pivots(run.factors, run.nonzeros)
    if run.above < 0 or run.factors.smallest_pivot <= _MIN_PIVOT_RATIO * run.size:
        shift_diagonal(run, -_SHIFT_RATIO * run.size)
        run.above = count_negative_pivots(run.factors, run.nonzeros)
        shift_diagonal(run, 2.0 * _SHIFT_RATIO * run.size)
        run.below = count_negative_pivots(run.factors, run.nonzeros)


def shift_diagonal(run: SaddlePoint, shift: float) -> None:
    """Add `shift` to the diagonal entries of the coordinates."""
    diagonal = run.pattern.diagonal
    fill(run.shift, shift)
    add(run.nonzeros, diagonal, run.shift, run.counting, 0, diagonal.size)


@bounded_cache(_MAX_CACHED_BYTES, array_bytes)
def _plan_saddle_point(
    parts: bytes, is_shared: bytes, starts: bytes, indices: bytes
) -> SaddlePattern:
    """Return the saddle-point matrix of tangents (n + m, n + m) with this CSC pattern.

    `parts` are the first coordinates of parts, (n,), `is_shared` the flags of the constraints in
    G^T G, (m,).
    """
    indptr, rows = np.frombuffer(starts, np.intp), np.frombuffer(indices, np.intp)
    groups, shared = np.frombuffer(parts, np.intp), np.frombuffer(is_shared, bool)
    n, size = len(groups), len(indptr) - 1
    groups = np.append(groups, np.arange(n, size))
    columns = np.repeat(np.arange(size), np.diff(indptr))
    (stiffness,) = np.nonzero((rows < n) == (columns < n))
    (joints,) = np.nonzero((rows >= n) & (columns < n))
    sources = np.concatenate([stiffness, stiffness, joints, joints])
    shares = np.repeat([0.5, 1.0], [2 * len(stiffness), 2 * len(joints)])
    i = np.concatenate([rows[stiffness], columns[stiffness], rows[joints], columns[joints]])
    j = np.concatenate([columns[stiffness], rows[stiffness], columns[joints], rows[joints]])
    # Pairs of entries of G in the same row.
    gradients = [joints[rows[joints] == row] for row in n + np.flatnonzero(shared)]
    pairs = [np.stack(np.meshgrid(x, x)).reshape(2, -1) for x in gradients]
    left, right = np.concatenate(pairs, axis=1) if pairs else np.zeros((2, 0), int)
    keys = [j * size + i, columns[right] * size + columns[left], np.arange(size) * (size + 1)]
    entries, targets = np.unique(np.concatenate(keys), return_inverse=True)
    terms, products, diagonal = np.split(targets, np.cumsum([len(x) for x in keys[:2]]))
    indptr = np.searchsorted(entries, np.arange(size + 1) * size).astype(np.int32)
    ones, at = np.ones(len(entries)), (entries % size).astype(np.int32)
    pattern = sp.csc_array((ones, at, indptr), shape=(size, size))
    group_keys, group_pairs = np.unique(groups[j] * size + groups[i], return_inverse=True)
    # Opposite entries; those without a partner differ from zero.
    mixed = stiffness[rows[stiffness] != columns[stiffness]]
    low, high = np.minimum(rows[mixed], columns[mixed]), np.maximum(rows[mixed], columns[mixed])
    pair_of = np.unique(low * size + high, return_inverse=True)[1].ravel()
    is_compliance = (rows == columns) & (rows >= n)
    unsigned = np.uint32
    return SaddlePattern(
        rows=rows.astype(unsigned),
        columns=columns.astype(unsigned),
        targets=terms.astype(unsigned),
        sources=sources.astype(unsigned),
        shares=shares,
        skew_rows=pair_of.astype(unsigned),
        skew_sources=mixed.astype(unsigned),
        skew_signs=np.where(rows[mixed] < columns[mixed], -1.0, 1.0),
        product_targets=products.astype(unsigned),
        product_left=left.astype(unsigned),
        product_right=right.astype(unsigned),
        reduced=np.flatnonzero(is_compliance & np.append(np.zeros(n, bool), shared)[rows]),
        diagonal=diagonal[:n].astype(unsigned),
        groups=groups,
        group_rows=group_keys % max(size, 1),
        group_columns=group_keys // max(size, 1),
        pairs=group_pairs.ravel(),
        plan=FixedOrder.of(pattern, _elimination_order(pattern, n, rows[joints], columns[joints])),
    )


def _elimination_order(
    pattern: sp.csc_array, n: int, joint_rows: Array, joint_columns: Array
) -> Array:
    """Return an order with little fill, each multiplier after the coordinates that it couples."""
    coordinates = compute_bordered_ordering(sp.csc_array(pattern[:n, :n])).order
    position = np.zeros(pattern.shape[0])
    position[coordinates] = np.arange(n)
    last = np.zeros(pattern.shape[0])
    np.maximum.at(last, joint_rows, position[joint_columns])
    position[n:] = last[n:] + 0.5
    return np.argsort(position, kind="stable")
