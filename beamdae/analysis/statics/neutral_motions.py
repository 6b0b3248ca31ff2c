"""Motions without stiffness, such as those of a cart on a rail.

If loads do no work in them, the tangent stiffness is singular along the whole path. Springs that
act on the tangent alone hold such motions, so that Newton's method does not move the mechanism
along them.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from beamdae.analysis.continuation.engine import Point, prescribe_parameter
from beamdae.analysis.eigenproblems.eigensolution import EQUAL_SIZE_TOLERANCE
from beamdae.analysis.statics.load_scaling import LoadedEquations
from beamdae.analysis.statics.static_problem import StaticProblem
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.rigid_motions import compute_rigid_motions

Array = np.ndarray

# Forces up to the first fraction of their sizes are rounding errors, and work of loads up to the
# second one: motions contain parts of soft ones.
_ROUNDING, _ROUNDING_OF_MOTIONS = 1e-12, 1e-9
# Decimals of motions that are not rounding errors.
_DECIMALS = 9


def hold_neutral_motions(point: Point) -> Point:
    """Return the point of the equations whose motions without stiffness are held, if there are any.

    Each is held by a spring on one of its coordinates, whose position is then arbitrary.
    """
    system, count = point.problem.system, point.monitor.free
    if not count:
        return point
    x = point.x[: system.loaded.size]
    motions = _find_motions_without_stiffness(system, x, point.p, count)
    # Of coordinates that move equally but for rounding, the first one is held.
    sizes = motions.T.round(_DECIMALS) * prefer_angles(system.equations)
    order = la.qr(sizes, mode="r", pivoting=True)[1]
    held = sorted(order[: motions.shape[1]].tolist())
    return StaticProblem(system, {k: float(x[k]) for k in held}).point(point.x, point.p)


def are_neutral(point: Point) -> bool:
    """Return True if loads do no work in the held motions: their springs resist no load."""
    held, scales = list(point.problem.held), point.problem.scales
    forces = point.tangent(prescribe_parameter)[held] / scales[held]
    loads = scales * point.linearization.by_parameter
    return _size(forces) <= _ROUNDING_OF_MOTIONS * float(np.sum(np.abs(loads)))


def prefer_angles(e: EquationsOfMotion) -> Array:
    """Return weights (n,) of motions: angles describe them better than points that move equally."""
    return np.where(e.is_angle, 1.0 + 3.0 * EQUAL_SIZE_TOLERANCE, 1.0)


def _find_motions_without_stiffness(
    system: LoadedEquations, x: Array, mu: float, count: int
) -> Array:
    """Return at most `count` rigid motions that joints allow without a change of forces, (n, k).

    Columns are orthonormal after division by `position_scales`; reactions may change.
    """
    e, n = system.equations, system.equations.n
    sizes = np.append(e.position_scales, np.ones(len(x) - n))
    matrix = system.at_factor(mu).matrix(*np.split(x, [n]))
    tangent = (matrix * sizes * sizes[:, None]).toarray()
    stiffness, gradients = (y / (_size(y) or 1.0) for y in (tangent[:n, :n], tangent[n:, :n]))
    rigid = compute_rigid_motions(e, x[:n])
    # Motions and reactions that leave joints closed and forces unchanged.
    changes = np.block(
        [[stiffness @ rigid, gradients.T], [gradients @ rigid, np.zeros((len(x) - n,) * 2)]]
    )
    _, values, right = la.svd(changes)
    first = max(int(np.sum(values > _ROUNDING)), len(right) - count)
    free = right[first:, : rigid.shape[1]]
    return la.qr(rigid @ free.T, mode="economic")[0]


def _size(entries: Array) -> float:
    return float(np.max(np.abs(entries), initial=0.0))
