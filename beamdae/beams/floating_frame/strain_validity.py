"""Validity of the small-strain assumption in a floating frame.

Eqs. (5) and (6) of Pan & Liu (2012) hold for moderate rotations relative to the frame. At a section
rotation r, the shear strain has an error of r^3 / 6, and the error of the axis curvature is
proportional to r^2 / 2. Without the curvature in the quadratic strains, the length of an axis whose
tangent rotates by the angle `turning` has errors proportional to r * turning^2.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import casadi as ca

from beamdae.beams.floating_frame.element import (
    FRAME_SIZE,
    NODE_SIZE,
    FloatingFrameElement,
    strain_points,
)
from beamdae.beams.strains import AXIAL, BENDING
from beamdae.symbolic.statements import Local, RangeKernel

SX = ca.SX


class _ErrorCoefficients(NamedTuple):
    """Relative error of the deformation divided by powers of the section rotation.

    Attributes
    ----------
    quadratic
        Error divided by rotation^2 [1/rad^2].
    without_curvature
        Error divided by rotation * turning^2 [1/rad^3], for quadratic strains without curvature.
    linear
        Error divided by rotation [1/rad], for strains without quadratic terms.
    """

    quadratic: float
    without_curvature: float
    linear: float


# Fitted to cantilevers with exact solutions, the hub beam and the slider-crank
# (validation/strain_validity/run.py). Actual errors are up to three times the estimate for single
# beams, as small as a thirtieth of it in pure bending, and smaller for several welded beams.
_ERROR_COEFFICIENTS = {
    "tangent": _ErrorCoefficients(1.0, 0.05, 1.0),
    "chord": _ErrorCoefficients(0.15, 0.1, 0.3),
}


def strain_error_coefficients(
    strain: str, frame: str, turning: float
) -> tuple[float, float] | None:
    """Return (a, b) of the relative error a r + b r^2 of a deformation with rotation r [rad].

    Parameters
    ----------
    strain, frame
        As in `Beam`.
    turning
        Difference between the largest and the smallest tangent angle of the reference curve [rad].

    Returns
    -------
    tuple or None
        a [1/rad] and b [1/rad^2]; None for exact strains, which have no such error.
    """
    if strain == "exact":
        return None
    error = _ERROR_COEFFICIENTS[frame]
    linear_terms = {
        "nonlinear": error.without_curvature * turning**2,
        "green": 0.0,
        "linear": error.linear,
    }
    return linear_terms[strain], error.quadratic


@cache
def range_kernel(element: FloatingFrameElement) -> RangeKernel:
    """Return the kernel of the largest relative deflection, rotation and strain of an element.

    The data are the element data and the length of the beam, to which the deflection is relative.
    Deflections and rotations are evaluated at the nodes. The strain is that of the outer fibers,
    |eps11| + h/2 |kappa11| at the stiffness points, with the height h = sqrt(12 I / A) of a
    rectangle; for a solid circle, this h is 13 % less than the diameter.
    """
    local = Local(element.size, element.n_data + 1)
    data = element.layout.split(local.data)
    u, v, phi = ca.vertsplit(ca.reshape(local.q[FRAME_SIZE:], NODE_SIZE, element.nodes))
    strains = [
        ca.fabs(strain[AXIAL]) + _half_height(data.elasticity(k)) * ca.fabs(strain[BENDING])
        for k, (_, strain) in enumerate(
            strain_points(element, data.stiffness, local.q[FRAME_SIZE:])
        )
    ]
    values = ca.vertcat(
        ca.mmax(ca.sqrt(u**2 + v**2)) / local.data[-1],
        ca.mmax(ca.fabs(phi)),
        ca.mmax(ca.vertcat(*strains)),
    )
    return RangeKernel(local, values)


def _half_height(stiffness: SX) -> SX:
    """Return half the height of a rectangle with the stiffnesses (EA, GA, EI)."""
    return ca.sqrt(3.0 * stiffness[BENDING] / stiffness[AXIAL])
