"""Shooting solutions of Reissner's cantilevers, as references without finite elements."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import newton

import beamdae as bd

Array = np.ndarray


class CantileverSolution(NamedTuple):
    """Tip (x, y, angle), strain energy [J] and moments [N m] of a cantilever in equilibrium."""

    tip: Array
    energy: float
    moments: Array


def solve_cantilever(
    curve: Any, section: bd.Section, force: tuple[float, float], moment: float, positions: Array
) -> CantileverSolution:
    """Return the equilibrium under a dead force and a moment at the end, to 1e-12.

    x' = (1 + N / EA) t + Q / GA n, psi' = psi0' + m / EI, m' = -(x' x F), along the curve;
    beamdae's moment is -m. The moment at the clamp is adjusted until the moment at the end is met.
    `positions` are arc lengths [m]; the last one is the end.
    """
    fx, fy = force

    def slopes(s: float, y: Array) -> list[float]:
        c, d = np.cos(y[2]), np.sin(y[2])
        N, Q, m = c * fx + d * fy, c * fy - d * fx, y[3]
        stretch, shear = 1.0 + N / section.EA, Q / section.GA
        along, up = stretch * c - shear * d, stretch * d + shear * c
        energy = 0.5 * (N**2 / section.EA + Q**2 / section.GA + m**2 / section.EI)
        curvature = float(curve.curvature(s)) + m / section.EI
        return [along, up, curvature, up * fx - along * fy, energy]

    def integrate(clamp_moment: float) -> Any:
        start = [*curve.point(0.0), float(curve.tangent_angle(0.0)), clamp_moment, 0.0]
        ends = (0.0, curve.length)
        return solve_ivp(slopes, ends, start, "DOP853", positions, rtol=1e-13, atol=1e-14)

    lever = np.subtract(curve.point(curve.length), curve.point(0.0))
    guess = moment + lever[0] * fy - lever[1] * fx
    end = len(positions) - 1
    root = newton(
        lambda m: integrate(m).y[3, end] - moment, guess, x1=0.9 * guess, tol=1e-12 * abs(guess)
    )
    states = integrate(float(root)).y
    return CantileverSolution(states[:3, end], float(states[4, end]), -states[3])
