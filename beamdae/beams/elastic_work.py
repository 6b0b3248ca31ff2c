"""Virtual work of elasticity and material damping of one element, whatever its strains are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from beamdae.beams.element_data import Data
from beamdae.symbolic.statements import SX


def elastic_work(
    points: Sequence[tuple[SX, SX]], data: Data, damped: bool, q: Any, v: Any
) -> tuple[SX, SX, SX]:
    """Generalized forces of D (eps + damping eps'), strain energy and dissipated power.

    Eq. (21) of Pan & Liu (2012), D = diag(EA, GA, EI).

    Parameters
    ----------
    points
        Weight and (axial strain, shear strain, kappa11) of each stiffness point, from `q`.
    data
        Stiffnesses and retardation times of the points.
    damped
        Whether there is material damping.
    q, v
        Coordinates the strains depend on, and their rates.
    """
    force, stored, dissipated = SX.zeros(q.shape[0]), SX(0), SX(0)
    for k, (weight, strain) in enumerate(points):
        stiffness = data.elasticity(k)
        section_forces = stiffness * strain
        stored += 0.5 * weight * ca.dot(section_forces, strain)
        if damped:
            strain_rate = ca.jtimes(strain, q, v)
            viscous = data.damping(k) * stiffness * strain_rate
            section_forces += viscous
            dissipated += weight * ca.dot(viscous, strain_rate)
        force += weight * ca.jtimes(strain, q, section_forces, True)
    return force, stored, dissipated
