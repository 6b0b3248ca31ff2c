"""How far the strains of a floating frame reach: what is measured of a run, and what it is worth.

Eqs. (5) and (6) of Pan & Liu (2012) hold for moderate rotations relative to the frame: a section
that turns by r has its shear off by r^3 / 6, the axis its curvature by a share of r^2 / 2, and
without the curvature in the quadratic strains an axis that turns by `turning` altogether has its
length off by terms of r turning^2.
"""

from __future__ import annotations

from functools import cache

import casadi as ca

from beamdae.beams.floating_frame.element import (
    FRAME_SIZE,
    NODE_SIZE,
    FloatingFrameElement,
    strain_points,
)
from beamdae.symbolic.statements import Local, RangeKernel

SX = ca.SX

# By frame: error of the deformation over rotation^2 [1/rad^2], over rotation times turning^2
# [1/rad^3] without the curvature in the quadratic strains, and over rotation [1/rad] without any
# of them. Fitted to cantilevers with exact answers and to the hub beam and the slider-crank
# (validation/reach/run.py): the error of a single beam is up to three times as much, and in pure
# bending down to a thirtieth; that of several welded together is smaller.
_ERROR_COEFFICIENTS = {"tangent": (1.0, 0.05, 1.0), "chord": (0.15, 0.1, 0.3)}


def strain_error_coefficients(
    strain: str, frame: str, turning: float
) -> tuple[float, float] | None:
    """(a, b) of the error a r + b r^2 of a deformation with rotations r [rad]; None of exact ones.

    Parameters
    ----------
    strain, frame
        As in `Beam`.
    turning
        Angle between the smallest and the largest tangent of the reference curve [rad].
    """
    if strain == "exact":
        return None
    square, curved, linear = _ERROR_COEFFICIENTS[frame]
    by_rotation = {"nonlinear": curved * turning**2, "green": 0.0, "linear": linear}
    return by_rotation[strain], square


@cache
def range_kernel(kind: FloatingFrameElement) -> RangeKernel:
    """Largest deflection over length, rotation and strain of an element.

    Its data are those of the element and the length of the beam. The strain is that of the outer
    fibers, |eps11| + h/2 |kappa11| at the stiffness points, with the height h = sqrt(12 I / A) of a
    rectangle: of a circle the bending part is 13 % larger.
    """
    local = Local(kind.size, kind.n_data + 1)
    data = kind.layout.split(local.data)
    nodal = ca.reshape(local.q[FRAME_SIZE:], NODE_SIZE, kind.nodes)
    strains = [
        ca.fabs(strain[0]) + _half_height(data.elasticity(k)) * ca.fabs(strain[2])
        for k, (_, strain) in enumerate(strain_points(kind, data.stiffness, local.q[FRAME_SIZE:]))
    ]
    deflections = ca.sqrt(nodal[0, :] ** 2 + nodal[1, :] ** 2)
    values = ca.vertcat(
        ca.mmax(deflections) / local.data[-1],
        ca.mmax(ca.fabs(nodal[2, :])),
        ca.mmax(ca.vertcat(*strains)),
    )
    return RangeKernel(local, values)


def _half_height(stiffness: SX) -> SX:
    return ca.sqrt(3.0 * stiffness[2] / stiffness[0])
