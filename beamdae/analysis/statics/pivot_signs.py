"""Signs of the pivots of static equations, by symmetric elimination.

The saddle-point matrix of the tangent, with the stiffness K in units of the natural sizes of the
coordinates and the constraint matrix G, whose rows are scaled to the size of K, is

    [[K + G^T G / r, G^T], [G, -C / (1 - C / r)]],

with the compliances C of constraints. The rows of G are scaled to the size r of K, those of soft
springs to C = r / 2. G^T G / r is a share of the stiffness of joints and springs, but not of beams,
whose K is regular. It keeps leading pivots nonzero if bodies would be free without their joints and
springs, so that the matrix can be eliminated in an order that depends on the pattern only: along
the mechanism, each multiplier after the coordinates that it couples.

By Sylvester's law of inertia, the number of negative pivots is m plus the number of negative
eigenvalues of K + G^T C^-1 G in the motions that the joints allow, for any r. Rounding errors may
change the signs of pivots only if a pivot is close to zero. Then, pivots are counted for K - s I
with shifts s on both sides of zero; the difference is the number of motions without stiffness.
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
    eliminate,
    eliminate_by_scipy,
)
from beamdae.linear.orderings import compute_bordered_ordering
from beamdae.native.loop_functions import (
    add,
    add_weighted,
    combine,
    fill,
    gather,
    max_norm,
    pick,
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
# Memory of the cached index arrays [bytes]: about 3 kB per element of a beam.
_MAX_CACHED_BYTES = 16 * 2**20


class SaddlePattern(NamedTuple):
    """Sources of the terms of the saddle-point matrix in the non-zeros of a tangent.

    Attributes
    ----------
    entries, rows, columns
        Stiffness: indices of its non-zeros in the tangent, and their rows and columns.
    skew_rows, skew_sources, skew_signs
        Differences of opposite entries: skew[skew_rows] += skew_signs * entries[skew_sources].
    targets, mirrored
        nonzeros[targets] += entries / 2, and the same for opposite entries: the symmetric part.
    joint_entries, joint_rows, joint_columns
        Joints: indices of the non-zeros of G in the tangent, and their rows (from n) and columns.
    joint_targets, joint_sources
        nonzeros[joint_targets] += joints[joint_sources], for G and its transpose.
    product_targets, product_left, product_right
        nonzeros[product_targets] += joints[product_left] * joints[product_right] / r.
    diagonal
        Diagonal entries of the coordinates.
    plan
        Elimination in order, each multiplier after the coordinates that it couples.
    """

    entries: Array
    rows: Array
    columns: Array
    skew_rows: Array
    skew_sources: Array
    skew_signs: Array
    targets: Array
    mirrored: Array
    joint_entries: Array
    joint_rows: Array
    joint_columns: Array
    joint_targets: Array
    joint_sources: Array
    product_targets: Array
    product_left: Array
    product_right: Array
    diagonal: Array
    plan: FixedOrder


@dataclass(slots=True)
class SaddlePoint:
    """Work arrays of `count_signs`; see `SaddlePattern` for indices.

    Attributes
    ----------
    factors
        Factors of the last matrix.
    rows, columns, part_rows
        Stiffness: rows and columns of its non-zeros, and the first row of each part, with the end
        of the last part.
    part_scales
        Sizes of the parts of the coordinates, (n,), see `scale_by_reference`.
    weights, joint_weights, scales
        Products of the natural sizes of rows and columns, and sizes of the unknowns, (n + m,).
    rigid
        First row of G with compliance.
    values, joints, skew, left, nonzeros
        Entries of the stiffness and of G, differences of opposite entries, factors of products, and
        the saddle-point matrix.
    shift, counting, ones
        Shift of each coordinate, (n,), 0, 1, 2, ..., and ones for the norms of entries.
    reference
        Largest entry of the stiffness at the start, see `scale_by_reference`. The stiffness may
        vanish at a critical point, where rounding is that of its terms.
    joint_size
        Size r of the entries of G.
    size, asymmetry
        Largest entry of the stiffness or `reference`, and largest difference of opposite entries.
    below, above
        Numbers of negative pivots with a shift slightly below and above zero; -1 if a pivot
        vanishes.
    """

    factors: FixedOrderFactors
    entries: Array
    rows: Array
    columns: Array
    part_rows: Array
    part_scales: Array
    weights: Array
    values: Array
    skew_rows: Array
    skew_sources: Array
    skew_signs: Array
    skew: Array
    targets: Array
    mirrored: Array
    joint_entries: Array
    joint_rows: Array
    joint_columns: Array
    joint_weights: Array
    joints: Array
    joint_targets: Array
    joint_sources: Array
    product_targets: Array
    product_left: Array
    product_right: Array
    left: Array
    nonzeros: Array
    diagonal: Array
    scales: Array
    shift: Array
    counting: Array
    ones: Array
    rigid: int
    reference: float = 0.0
    joint_size: float = 1.0
    size: float = 0.0
    asymmetry: float = 0.0
    below: int = 0
    above: int = 0

    @classmethod
    def of(
        cls,
        pattern: sp.csc_array,
        positions: Array,
        part_rows: Array,
        rigid: int,
        remainder: Array,
    ) -> SaddlePoint:
        """Return the work arrays for tangents with this pattern, without natural sizes.

        The non-zeros of the tangent are at `positions` in the argument of `count_signs`.
        `part_rows` contains the first coordinate of each part, and the number of coordinates.
        The first `rigid` constraints have no compliance; that of the others is 1. Constraints with
        a `remainder` are beside a stiffness of the same motion.
        """
        n, positions = int(part_rows[-1]), positions.astype(np.uint32)
        indices = pattern.indices.astype(np.intp).tobytes()
        starts = pattern.indptr.astype(np.intp).tobytes()
        saddle = _plan_saddle_point(n, (remainder == 0.0).tobytes(), starts, indices)
        count, joint_count = len(saddle.entries), len(saddle.joint_entries)
        size, length = pattern.shape[0], len(saddle.plan.sources)
        longest = max(length, len(saddle.product_left))
        return cls(
            factors=FixedOrderFactors.of(saddle.plan),
            entries=positions[saddle.entries],
            rows=saddle.rows,
            columns=saddle.columns,
            part_rows=part_rows,
            part_scales=np.ones(n),
            weights=np.ones(count),
            values=np.zeros(count),
            skew_rows=saddle.skew_rows,
            skew_sources=saddle.skew_sources,
            skew_signs=saddle.skew_signs,
            skew=np.zeros(count),
            targets=saddle.targets,
            mirrored=saddle.mirrored,
            joint_entries=positions[saddle.joint_entries],
            joint_rows=saddle.joint_rows,
            joint_columns=saddle.joint_columns,
            joint_weights=np.zeros(joint_count),
            joints=np.zeros(joint_count),
            joint_targets=saddle.joint_targets,
            joint_sources=saddle.joint_sources,
            product_targets=saddle.product_targets,
            product_left=saddle.product_left,
            product_right=saddle.product_right,
            left=np.zeros(len(saddle.product_left)),
            nonzeros=np.zeros(length),
            diagonal=saddle.diagonal,
            scales=np.ones(size),
            shift=np.zeros(n),
            counting=np.arange(longest, dtype=np.uint32),
            ones=np.ones(count),
            rigid=n + rigid,
        )


def scale_by_reference(run: SaddlePoint, tangent: Array) -> None:
    """Set scales and `reference` by the tangent in the reference configuration, unloaded.

    The natural sizes S of the coordinates make all parts equally stiff: they are `part_scales`
    times sqrt(E / e). e is the largest entry, in `part_scales`, of the stiffness in the columns of
    the part, and E that of all parts. Otherwise, rounding errors of large and stiff parts would
    exceed the stiffness of small and soft ones. A part without stiffness is as stiff as its softest
    spring or, if that is softer, as a part that it is attached to. By Sylvester's law of inertia,
    S does not change the number of negative eigenvalues.
    """
    n, scales = run.shift.size, run.scales
    is_compliant = np.arange(scales.size) >= run.rigid
    scales[:n], scales[n:] = run.part_scales, 0.0
    values, largest = _scale_stiffness(run, tangent), _measure_rows(run, tangent)
    energies = np.zeros(run.part_rows.size)
    np.maximum.at(energies, _find_parts(run.part_rows, run.columns), values)
    is_spring = is_compliant & (largest**2 > NEGLIGIBLE_STIFFNESS)
    energies = _attach_parts(run, energies, np.where(is_spring, largest**2, np.inf))
    energy = energies.max(initial=0.0, where=np.isfinite(energies))
    ratios = np.where(np.isfinite(energies), energy / energies, 1.0)
    scales[:n] *= np.sqrt(ratios[_find_parts(run.part_rows, np.arange(n))])
    run.reference = _scale_stiffness(run, tangent).max(initial=energy)
    run.size = run.joint_size = size = run.reference or 1.0
    largest = _measure_rows(run, tangent)
    sizes = size / np.where(largest > 0.0, largest, 1.0)
    scales[n:] = np.where(is_compliant, np.minimum(sizes, math.sqrt(0.5 * size)), sizes)[n:]
    run.joint_weights[:] = scales[run.joint_columns] * scales[run.joint_rows]
    # Compliances beside a share G^T G / r, -C, become -C / (1 - C / r).
    _scale_stiffness(run, tangent)
    is_split = np.isin(run.rows, run.joint_rows[run.product_left])
    run.weights[is_split] /= 1.0 - run.weights[is_split] / size


def _attach_parts(run: SaddlePoint, energies: Array, stiffness: Array) -> Array:
    """Return the energies of all parts, inf where nothing determines them.

    `stiffness` are those of the springs, (n + m,), and inf elsewhere.
    """
    rows, parts = run.joint_rows, _find_parts(run.part_rows, run.joint_columns)
    is_held, last = energies <= NEGLIGIBLE_STIFFNESS, np.zeros(0)
    energies = np.where(is_held, np.inf, energies)
    while not np.array_equal(energies, last):
        last, least, attached = energies, stiffness.copy(), np.full_like(energies, np.inf)
        np.minimum.at(least, rows, energies[parts])
        np.minimum.at(attached, parts, least[rows])
        energies = np.where(is_held, attached, energies)
    return energies


def _scale_stiffness(run: SaddlePoint, tangent: Array) -> Array:
    """Set `weights` to the products of `scales`; return the entries of the stiffness, positive."""
    run.weights[:] = run.scales[run.rows] * run.scales[run.columns]
    return np.abs(run.weights * tangent[run.entries])


def _measure_rows(run: SaddlePoint, tangent: Array) -> Array:
    """Return the largest entries of the rows of G in the sizes of the coordinates, (n + m,)."""
    largest = np.zeros_like(run.scales)
    entries = run.scales[run.joint_columns] * tangent[run.joint_entries]
    np.maximum.at(largest, run.joint_rows, np.abs(entries))
    return largest


def _find_parts(part_rows: Array, coordinates: Array) -> Array:
    """Return the indices of the parts of coordinates; those of multipliers follow the others."""
    return np.searchsorted(part_rows, coordinates, "right") - 1


def assemble_saddle_point(run: SaddlePoint, tangent: Array) -> None:
    """Set `nonzeros` to the symmetric part of a tangent with these non-zeros."""
    counting, nonzeros, joints, left = run.counting, run.nonzeros, run.joints, run.left
    fill(nonzeros, 0.0)
    add_weighted(nonzeros, run.targets, run.weights, tangent, run.entries, 0, run.entries.size)
    add_weighted(nonzeros, run.mirrored, run.weights, tangent, run.entries, 0, run.entries.size)
    combine(nonzeros, (0.5,), (nonzeros,))
    gather(joints, counting, run.joint_weights, tangent, run.joint_entries, 0, joints.size)
    add(nonzeros, run.joint_targets, joints, run.joint_sources, 0, run.joint_targets.size)
    pick(left, counting, joints, run.product_left, 0, left.size)
    combine(left, (1.0 / run.joint_size,), (left,))
    add_weighted(nonzeros, run.product_targets, left, joints, run.product_right, 0, left.size)


def measure_stiffness(run: SaddlePoint, tangent: Array) -> None:
    """Set `size` and `asymmetry` for a tangent with these non-zeros."""
    values, rows, count = run.values, run.skew_rows, run.entries.size
    gather(values, run.counting, run.weights, tangent, run.entries, 0, count)
    run.size = max(max_norm(values, run.ones), run.reference)
    fill(run.skew, 0.0)
    add_weighted(run.skew, rows, run.skew_signs, values, run.skew_sources, 0, rows.size)
    run.asymmetry = max_norm(run.skew, run.ones)


def count_signs(run: SaddlePoint, tangent: Array) -> None:
    """Set `size`, `asymmetry`, `below` and `above` for a tangent with these non-zeros."""
    measure_stiffness(run, tangent)
    assemble_saddle_point(run, tangent)
    run.below = run.above = eliminate(run.factors, run.nonzeros)
    if run.above < 0 or run.factors.smallest_pivot <= _MIN_PIVOT_RATIO * run.size:
        shift_diagonal(run, -_SHIFT_RATIO * run.size)
        run.above = eliminate(run.factors, run.nonzeros)
        shift_diagonal(run, 2.0 * _SHIFT_RATIO * run.size)
        run.below = eliminate(run.factors, run.nonzeros)


def count_signs_by_scipy(run: SaddlePoint, tangent: Array) -> None:
    """Perform `count_signs` without machine code."""
    measure_stiffness(run, tangent)
    assemble_saddle_point(run, tangent)
    run.below = run.above = eliminate_by_scipy(run.factors, run.nonzeros)
    if run.above < 0 or run.factors.smallest_pivot <= _MIN_PIVOT_RATIO * run.size:
        shift_diagonal(run, -_SHIFT_RATIO * run.size)
        run.above = eliminate_by_scipy(run.factors, run.nonzeros)
        shift_diagonal(run, 2.0 * _SHIFT_RATIO * run.size)
        run.below = eliminate_by_scipy(run.factors, run.nonzeros)


def shift_diagonal(run: SaddlePoint, shift: float) -> None:
    """Add `shift` to the diagonal entries of the coordinates."""
    fill(run.shift, shift)
    add(run.nonzeros, run.diagonal, run.shift, run.counting, 0, run.diagonal.size)


@bounded_cache(_MAX_CACHED_BYTES, array_bytes)
def _plan_saddle_point(n: int, is_split: bytes, starts: bytes, indices: bytes) -> SaddlePattern:
    """Return the saddle-point matrix of tangents (n + m, n + m) with this CSC pattern.

    `is_split` are the flags of the constraints in G^T G / r, (m,).
    """
    indptr, rows = np.frombuffer(starts, np.intp), np.frombuffer(indices, np.intp)
    size = len(indptr) - 1
    columns = np.repeat(np.arange(size), np.diff(indptr))
    in_stiffness, in_joints = (rows < n) == (columns < n), (rows >= n) & (columns < n)
    entries, joint_entries = np.flatnonzero(in_stiffness), np.flatnonzero(in_joints)
    k_rows, k_columns = rows[entries], columns[entries]
    g_rows, g_columns = rows[joint_entries], columns[joint_entries]
    # Pairs of entries of G in the same row.
    order = np.argsort(g_rows, kind="stable")
    row_counts = np.bincount(g_rows, minlength=size)[n:]
    row_starts = np.cumsum(row_counts) - row_counts
    pairs = [
        order[first + np.indices((count, count)).reshape(2, -1)]
        for first, count in np.stack([row_starts, row_counts], 1)[np.frombuffer(is_split, bool)]
    ]
    left, right = np.concatenate(pairs, axis=1) if pairs else np.zeros((2, 0), int)
    i = np.concatenate([k_rows, k_columns, g_rows, g_columns, g_columns[left]])
    j = np.concatenate([k_columns, k_rows, g_columns, g_rows, g_columns[right]])
    everywhere = np.arange(n)
    keys = np.unique(np.concatenate([j * size + i, everywhere * (size + 1)]))
    pattern = sp.csc_array(
        (
            np.ones(len(keys)),
            (keys % size).astype(np.int32),
            np.searchsorted(keys, np.arange(size + 1) * size).astype(np.int32),
        ),
        shape=(size, size),
    )
    ends = np.cumsum([len(k_rows), len(k_rows), 2 * len(g_rows)])
    targets = np.searchsorted(keys, j * size + i)
    # Opposite entries; those without a partner differ from zero.
    upper = k_rows < k_columns
    off_diagonal = np.flatnonzero(k_rows != k_columns)
    smaller, larger = np.minimum(k_rows, k_columns), np.maximum(k_rows, k_columns)
    pair_keys, pair_of = np.unique((smaller * size + larger)[off_diagonal], return_inverse=True)
    assert len(pair_keys) <= len(entries)
    unsigned = np.uint32
    return SaddlePattern(
        entries=entries.astype(unsigned),
        rows=k_rows.astype(unsigned),
        columns=k_columns.astype(unsigned),
        skew_rows=pair_of.ravel().astype(unsigned),
        skew_sources=off_diagonal.astype(unsigned),
        skew_signs=np.where(upper[off_diagonal], -1.0, 1.0),
        targets=targets[: ends[0]].astype(unsigned),
        mirrored=targets[ends[0] : ends[1]].astype(unsigned),
        joint_entries=joint_entries.astype(unsigned),
        joint_rows=g_rows.astype(unsigned),
        joint_columns=g_columns.astype(unsigned),
        joint_targets=targets[ends[1] : ends[2]].astype(unsigned),
        joint_sources=np.tile(np.arange(len(g_rows)), 2).astype(unsigned),
        product_targets=targets[ends[2] :].astype(unsigned),
        product_left=left.astype(unsigned),
        product_right=right.astype(unsigned),
        diagonal=np.searchsorted(keys, everywhere * (size + 1)).astype(unsigned),
        plan=FixedOrder.of(pattern, _elimination_order(pattern, n, g_rows, g_columns)),
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
