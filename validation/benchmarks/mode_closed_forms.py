"""Natural frequencies of rings, arches, beams and rotating structures from analytic equations."""

import numpy as np
from numpy.polynomial import Chebyshev
from scipy.linalg import eigh, eigvalsh, expm
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


def rotating_cantilever(speed: float, offset: float, count: int) -> Array:
    """Return the lowest frequencies of a thin cantilever in the plane of rotation.

    By the Rayleigh-Ritz method, with unit EI, rho A and length and the clamp at the distance
    `offset` from the axis: y''^2 + W^2 ((1 - x^2) / 2 + offset (1 - x)) y'^2 - (w^2 + W^2) y^2 is
    stationary (Yoo & Shin, J. Sound Vib. 212 (1998) 807, without axial strain). The shapes are
    y = x^2 T_k(2 x - 1).
    """
    terms = 20
    # x^2 = (3 + 4 T_1 + T_2) / 8.
    square = Chebyshev([0.375, 0.5, 0.125], domain=[0.0, 1.0])
    shapes = [square * Chebyshev.basis(k, domain=[0.0, 1.0]) for k in range(terms)]
    x, weight = np.polynomial.legendre.leggauss(2 * terms + 4)
    x, weight = 0.5 * (x + 1.0), 0.5 * weight
    y, slope, bend = (np.array([s.deriv(d)(x) if d else s(x) for s in shapes]) for d in (0, 1, 2))
    tension = speed**2 * (0.5 * (1.0 - x**2) + offset * (1.0 - x))
    stiffness = (bend * weight) @ bend.T + (slope * weight * tension) @ slope.T
    squares = eigh(stiffness, (y * weight) @ y.T, eigvals_only=True)
    return np.sqrt(squares[:count] - speed**2)


def spinning_thin_ring(section: bd.Section, radius: float, n: int, speed: float) -> Array:
    """Return the frequencies [rad/s] of both waves of n periods, in the frame of a spinning ring.

    w = n / (n^2 + 1) (2 W -+ (n^2 - 1) sqrt(W^2 + (n^2 + 1) EI / (rho A R^4))) for inextensible
    rings (Bryan, Proc. Camb. Phil. Soc. 7 (1890) 101; Carrier, Q. Appl. Math. 3 (1945) 235). The
    centrifugal tension is included.
    """
    bending = section.EI / (section.rhoA * radius**4)
    root = (n**2 - 1) * np.sqrt(speed**2 + (n**2 + 1) * bending)
    return np.abs(n / (n**2 + 1) * (2.0 * speed + np.array([-root, root])))
