"""Natural frequencies of rings, a hinged arch and a supported beam from analytic equations."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigvalsh, expm
from scipy.optimize import brentq

import beamdae as bd

Array = np.ndarray


def thin_ring(section: bd.Section, radius: float, n: int) -> float:
    """Return w [rad/s], w^2 = n^2 (n^2 - 1)^2 / (n^2 + 1) EI / (rho A R^4) (Love; Blevins 1979)."""
    square = n**2 * (n**2 - 1) ** 2 / (n**2 + 1) * section.EI / (section.rhoA * radius**4)
    return float(np.sqrt(square))


def ring(section: bd.Section, radius: float, n: int) -> float:
    """Return the lowest angular frequency [rad/s] of `n` waves.

    With n s / R as argument the shape is u = U sin, w = W cos (outward) and the rotation P sin:
    stretch (n U + W) / R, shear P - (n W + U) / R, curvature n P / R.
    """
    stretch = np.array([n, 1.0, 0.0]) / radius
    shear = np.array([-1.0, -n, radius]) / radius
    bend = np.array([0.0, 0.0, n]) / radius
    stiffness = section.EA * np.outer(stretch, stretch) + section.GA * np.outer(shear, shear)
    stiffness += section.EI * np.outer(bend, bend)
    mass = np.diag([section.rhoA, section.rhoA, section.rhoI])
    return float(np.sqrt(eigvalsh(stiffness, mass)[0]))


def hinged_arch(section: bd.Section, radius: float, length: float, near: Array) -> Array:
    """Return the angular frequencies [rad/s] of a hinged arch that are closest to `near`.

    They are zeros of a minor of the matrix exponential of the state equations along s. The state
    is (u, w, rotation, N, Q, M), w towards the center: u' = N / EA + w / R,
    w' = Q / GA + rotation - u / R, rotation' = M / EI, and the balance of forces and moments.
    """
    curvature = 1.0 / radius

    def characteristic(w: float) -> float:
        rates = np.zeros((6, 6))
        rates[0, [3, 1]] = 1.0 / section.EA, curvature
        rates[1, [4, 2, 0]] = 1.0 / section.GA, 1.0, -curvature
        rates[2, 5] = 1.0 / section.EI
        rates[3, [4, 0]] = curvature, -(w**2) * section.rhoA
        rates[4, [3, 1]] = -curvature, -(w**2) * section.rhoA
        rates[5, [4, 2]] = -1.0, -(w**2) * section.rhoI
        # Scaling by natural units makes the determinant dimensionless.
        sizes = np.array([1.0, 1.0, 1.0 / length, *np.full(3, section.EI)])
        sizes[3:] *= np.array([length**-3, length**-3, length**-2])
        transfer = expm(rates * length * sizes / sizes[:, None])
        return float(np.linalg.det(transfer[np.ix_([0, 1, 5], [2, 3, 4])]))

    return np.array(
        [brentq(characteristic, w * (1 - 1e-3), w * (1 + 1e-3), xtol=1e-12 * w) for w in near]
    )


def supported_beam(section: bd.Section, length: float, count: int) -> Array:
    """Return the lowest angular frequencies [rad/s] of a beam on a fixed and a sliding hinge.

    w^4 rhoA rhoI / GA - w^2 (rhoA + rhoI b^2 + EI rhoA b^2 / GA) + EI b^4 = 0 with b = n pi / L
    (both roots, and pure shear without deflection, w^2 = GA / rhoI); axial modes have
    w = (n - 1/2) pi / L sqrt(EA / rhoA).
    """
    b = np.pi / length * np.arange(1, 2 * count)
    squared = section.rhoA * section.rhoI / section.GA
    middle = section.rhoA + (section.rhoI + section.EI * section.rhoA / section.GA) * b**2
    root = np.sqrt(middle**2 - 4.0 * squared * section.EI * b**4)
    # The lower root follows from the product of both, which avoids cancellation.
    bending = np.sqrt(2.0 * section.EI * b**4 / (middle + root))
    shear = np.sqrt((middle + root) / (2.0 * squared))
    axial = np.sqrt(section.EA / section.rhoA) * np.pi * (np.arange(count) + 0.5) / length
    pure_shear = [np.sqrt(section.GA / section.rhoI)]
    return np.sort(np.concatenate([bending, shear, axial, pure_shear]))[:count]
