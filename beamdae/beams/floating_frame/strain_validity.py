"""Validity of the small-strain assumption in a floating frame.

Eqs. (5) and (6) of Pan & Liu (2012) hold for moderate rotations relative to the frame. In the same
deformation, Reissner's strains result in different elastic forces. A linear system gives the change
of deformation that this difference would cause under the same loads, for a single beam with the
statically determinate supports of its frame. The relative change is a measure of the error.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import casadi as ca

from beamdae.beams.floating_frame.element import (
    FRAME_SIZE,
    NODE_SIZE,
    FloatingFrameElement,
    strain_points,
)
from beamdae.beams.strains import AXIAL, BENDING, half_height
from beamdae.symbolic.statements import Local, RangeKernel, StrainDefectKernel

SX = ca.SX


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
        ca.fabs(strain[AXIAL]) + half_height(data.elasticity(k)) * ca.fabs(strain[BENDING])
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


@cache
def strain_defect_kernel(element: FloatingFrameElement) -> StrainDefectKernel:
    """Return the kernel of exact elastic forces minus the elastic forces of an element.

    The stiffness of the kernel does not contain the geometric stiffness of the section forces.
    Assembled for a beam, it is therefore positive definite even if the beam buckles or snaps
    through. The data are those of `range_kernel`.
    """
    local = Local(element.size, element.n_data + 1)
    data = element.layout.split(local.data)
    nodal = local.q[FRAME_SIZE:]
    exact_element = replace(element, strain="exact")
    force, stiffness = SX(nodal.shape[0], 1), SX(nodal.shape[0], nodal.shape[0])
    for k, ((weight, strain), (_, exact)) in enumerate(
        zip(
            strain_points(element, data.stiffness, nodal),
            strain_points(exact_element, data.stiffness, nodal),
            strict=True,
        )
    ):
        elasticity = data.elasticity(k)
        slopes = ca.jacobian(exact, nodal)
        force += weight * (
            slopes.T @ (elasticity * exact) - ca.jacobian(strain, nodal).T @ (elasticity * strain)
        )
        stiffness += weight * (slopes.T @ ca.diag(elasticity) @ slopes)
    u, v, phi = (slice(k, None, NODE_SIZE) for k in range(NODE_SIZE))
    return StrainDefectKernel(local, slice(FRAME_SIZE, None), (u, v), phi, force, stiffness)
