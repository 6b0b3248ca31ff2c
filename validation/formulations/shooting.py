"""Bent cantilevers of Reissner's theory by shooting: an answer without elements."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import newton

import beamdae as bd

Array = np.ndarray


class CantileverSolution(NamedTuple):
    """A cantilever at rest: place and angle of its tip, strain energy [J], moments at `places`."""

    tip: Array
    energy: float
    moments: Array


def solve_cantilever(
    curve: Any, section: bd.Section, force: tuple[float, float], moment: float, places: Array
) -> CantileverSolution:
    """A cantilever under a dead force and a moment of its end, to 1e-12.

    x' = (1 + N / EA) t + Q / GA n, psi' = psi0' + m / EI, m' = -(x' x F), along the curve;
    beamdae's moment is -m. Shooting for the moment at the clamp brings that of the end about.
    """
    fx, fy = force

    def slopes(s: float, y: Array) -> list[float]:
        c, d = np.cos(y[2]), np.sin(y[2])
        N, Q, m = c * fx + d * fy, c * fy - d * fx, y[3]
        stretch, shear = 1.0 + N / section.EA, Q / section.GA
        along, up = stretch * c - shear * d, stretch * d + shear * c
        energy = 0.5 * (N**2 / section.EA + Q**2 / section.GA + m**2 / section.EI)
        turn = float(curve.curvature(s)) + m / section.EI
        return [along, up, turn, up * fx - along * fy, energy]

    def shot(at_clamp: float) -> Any:
        begin = [*curve.point(0.0), float(curve.tangent_angle(0.0)), at_clamp, 0.0]
        ends = (0.0, curve.length)
        return solve_ivp(slopes, ends, begin, "DOP853", places, rtol=1e-13, atol=1e-14)

    lever = np.subtract(curve.point(curve.length), curve.point(0.0))
    guess = moment + lever[0] * fy - lever[1] * fx
    # The end is not among the places where it is looked at.
    end = len(places) - 1
    root = newton(
        lambda m: shot(m).y[3, end] - moment, guess, x1=0.9 * guess, tol=1e-12 * abs(guess)
    )
    found = shot(float(root)).y
    return CantileverSolution(found[:3, end], float(found[4, end]), -found[3])
