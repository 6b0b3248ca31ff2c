"""The appendix and eq. (22) as printed, and the equations they come from.

The print is evaluated in numbers on a short thick curved beam of two elements with the paper's
continuity, moving at random. Its Greek letters and minus signs are lost in the text at hand: those
are restored, Latin letters (areas, Jacobians, matrices) are taken as they stand.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

import beamdae as bd

SECTION = bd.Section(bd.Material(E=60.0, nu=0.3, rho=1.3), area=0.9, second_moment=0.05)
ARC = bd.Arc(radius=1.6, length=2.0, start=(0.3, -0.2), angle=0.4)
ELEMENTS, NODES = 2, 4
QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])


class Point(NamedTuple):
    """A Gauss point: its weight and J, s0, A_alpha, 1/R, N and N' of (u, v, phi) in p."""

    weight: float
    J: float
    s0: np.ndarray
    A_alpha: np.ndarray
    curvature: float
    N: np.ndarray
    N_s: np.ndarray

    @property
    def N_I(self) -> np.ndarray:
        """[N3; 0]."""
        return np.stack([self.N[2], 0.0 * self.N[2]])


class State(NamedTuple):
    """Coordinates q = (r0, theta, p) and their rates."""

    q: np.ndarray
    v: np.ndarray

    @property
    def motion(self) -> tuple[np.ndarray, float, np.ndarray, np.ndarray]:
        """Rotation matrix A, theta', p and p'."""
        return rotation(self.q[2]), float(self.v[2]), self.q[3:], self.v[3:]


def rotation(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


@cache
def points() -> tuple[Point, ...]:
    """Four in each element; the first node is clamped to the floating frame."""
    xi, weights = np.polynomial.legendre.leggauss(NODES)
    at = np.linspace(-1.0, 1.0, NODES)
    shapes = [np.poly1d(row) for row in np.linalg.inv(np.vander(at, NODES)).T]
    n = ELEMENTS * (NODES - 1) + 1
    drawn = ARC.point(np.linspace(0.0, ARC.length, n)) - ARC.point(0.0)
    nodes = drawn @ rotation(-ARC.angle).T
    found = []
    for e in range(ELEMENTS):
        mine = slice(3 * e, 3 * e + NODES)
        for x, weight in zip(xi, weights, strict=True):
            rows = np.array([[h.deriv(k)(x) if k else h(x) for h in shapes] for k in range(3)])
            s0, d1, d2 = rows @ nodes[mine]
            J = float(np.hypot(*d1))
            N = np.zeros((2, 3, 3 * n))
            for k in range(3):
                N[:, k, 9 * e + k : 9 * e + 3 * NODES : 3] = rows[0], rows[1] / J
            N = N[:, :, 3:]
            t = d1 / J
            turned = np.array([[t[0], -t[1]], [t[1], t[0]]])
            curvature = float(d1[0] * d2[1] - d1[1] * d2[0]) / J**3
            found.append(Point(float(weight), J, s0, turned, curvature, N[0], N[1]))
    return tuple(found)


# The print ------------------------------------------------------------------------------------


def printed(state: State, f: np.ndarray, corrected: bool) -> dict[str, np.ndarray]:
    """M, Q_m, Q_F and f_s as printed; `corrected` puts in the A and the J that the print lacks."""
    A, omega, p, p_dot = state.motion
    area, inertia, rho = SECTION.area, SECTION.second_moment, SECTION.material.rho
    lost = area if corrected else 1.0
    terms: dict[str, np.ndarray] = {}

    def add(name: str, value: np.ndarray | float) -> None:
        terms[name] = terms.get(name, np.zeros(np.shape(value))) + value

    for x in points():
        N, N_I, w = x.N[:2], x.N_I, x.weight * x.J
        s = x.s0 + x.A_alpha @ N @ p
        add("M_rr", rho * w * area * np.eye(2))
        add("M_rtheta", rho * w * area * QUARTER @ A @ s)
        add("M_rp", rho * w * area * A @ x.A_alpha @ N)
        add("M_thetatheta", rho * w * (area * s @ s + inertia * p @ N_I.T @ N_I @ p))
        turning = area * s @ QUARTER.T @ x.A_alpha @ N + inertia * p @ N_I.T @ QUARTER.T @ N_I
        add("M_thetap", rho * w * turning)
        both = area * N.T @ N + inertia * N_I.T @ N_I
        add("M_pp", rho * w * both)
        swept = -(omega**2) * A @ s + 2.0 * omega * QUARTER @ A @ x.A_alpha @ N @ p_dot
        add("Q_r", rho * w * lost * swept)
        add("Q_theta", 2.0 * omega * rho * w * (area * x.s0 @ x.A_alpha @ N + p @ both) @ p_dot)
        pulled = lost * N.T @ x.A_alpha.T @ x.s0 + both @ p
        coriolis = 2.0 * omega * lost * N.T @ QUARTER @ N @ p_dot
        add("Q_p", rho * w * (-(omega**2) * pulled + coriolis))
        add("f_r", w * area * f)
        add("f_theta", w * lost * s @ A.T @ QUARTER.T @ f)
        add("f_p", w * lost * N.T @ x.A_alpha.T @ A.T @ f)
        add("f_s", x.weight * (x.J if corrected else 1.0) * _eq_22(x, p))
    return terms


def _eq_22(x: Point, p: np.ndarray) -> np.ndarray:
    """The integrand of eq. (22), with eqs. (18) and (19)."""
    k = x.curvature
    B_L0 = np.stack([x.N_s[0] - k * x.N[1], x.N_s[1] + k * x.N[0] - x.N[2]])
    B_L = np.stack([-x.N_s[2], 0.0 * x.N_s[2]])
    G = x.N_s[:2]
    C = np.stack([G @ p, np.zeros(2)])
    D = np.diag([SECTION.material.E, SECTION.shear_coefficient * SECTION.material.G])
    stretched = (B_L0 + C @ G).T @ D @ (B_L0 + 0.5 * C @ G) @ p
    return SECTION.area * stretched + SECTION.second_moment * B_L.T @ D @ B_L @ p


# What it comes from ---------------------------------------------------------------------------


def derived(state: State, f: np.ndarray, offset: bool) -> dict[str, np.ndarray]:
    """M, Q_m and Q_F from moving points, eqs. (10), (11), (15), (16), and f_s from eqs. (5) to (7).

    Two points a section, at eta = +-sqrt(I/A), stand for its area and second moment. Without
    `offset` they move as eq. (8) has it; with it the undeformed eta is there and the section turns
    as a whole.
    """
    A, omega, p, p_dot = state.motion
    n = len(state.q)
    mass, quadratic, body = np.zeros((n, n)), np.zeros(n), np.zeros(n)
    for x in points():
        s = x.s0 + x.A_alpha @ x.N[:2] @ p
        phi, phi_dot = x.N[2] @ p, x.N[2] @ p_dot
        for eta in np.array([-1.0, 1.0]) * np.sqrt(SECTION.second_moment / SECTION.area):
            if offset:
                arm = A @ x.A_alpha @ rotation(phi) @ (0.0, eta)
                d_phi = QUARTER @ arm
                swept = -((omega + phi_dot) ** 2) * arm
            else:
                arm, d_phi = (A @ x.A_alpha @ (-eta * k, 0.0) for k in (phi, 1.0))
                swept = -(omega**2) * arm + 2.0 * omega * QUARTER @ d_phi * phi_dot
            moved = A @ x.A_alpha @ x.N[:2]
            by_q = np.column_stack(
                [np.eye(2), QUARTER @ (A @ s + arm), moved + np.outer(d_phi, x.N[2])]
            )
            swept = swept - omega**2 * A @ s + 2.0 * omega * QUARTER @ moved @ p_dot
            area = 0.5 * SECTION.area * x.weight * x.J
            mass += area * SECTION.material.rho * by_q.T @ by_q
            quadratic += area * SECTION.material.rho * by_q.T @ swept
            body += area * by_q.T @ f
    gradient = np.array([_slope(p, direction) for direction in np.eye(len(p))])
    return parts(mass, quadratic, body) | {"f_s": gradient}


def _strain_energy(p: np.ndarray) -> float:
    """Of the strains (5) and (6)."""
    energy, G = 0.0, SECTION.shear_coefficient * SECTION.material.G
    for x in points():
        (u, v, phi), (u_s, v_s, phi_s) = x.N @ p, x.N_s @ p
        axial = u_s - x.curvature * v + 0.5 * (u_s**2 + v_s**2)
        shear = v_s + x.curvature * u - phi
        per_length = SECTION.EA * axial**2 + SECTION.EI * phi_s**2 + G * SECTION.area * shear**2
        energy += 0.5 * x.weight * x.J * per_length
    return energy


def _slope(p: np.ndarray, direction: np.ndarray, step: float = 1e-2) -> float:
    """Derivative by five points: exact for a polynomial of degree four, which the energy is."""
    far, near = (
        _strain_energy(p + k * step * direction) - _strain_energy(p - k * step * direction)
        for k in (2, 1)
    )
    return (8.0 * near - far) / (12.0 * step)


def parts(mass: np.ndarray, quadratic: np.ndarray, body: np.ndarray) -> dict[str, np.ndarray]:
    """The blocks of M, Q_m and Q_F by the appendix's names."""
    r, theta, p = slice(0, 2), 2, slice(3, None)
    return {
        "M_rr": mass[r, r],
        "M_rtheta": mass[r, theta],
        "M_rp": mass[r, p],
        "M_thetatheta": mass[theta, theta],
        "M_thetap": mass[theta, p],
        "M_pp": mass[p, p],
        "Q_r": quadratic[r],
        "Q_theta": quadratic[theta],
        "Q_p": quadratic[p],
        "f_r": body[r],
        "f_theta": body[theta],
        "f_p": body[p],
    }
