"""Cantilevers under proportional loads: equilibria of a mechanism and of Reissner's beam."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.integrate import solve_bvp
from scipy.sparse.linalg import splu

import beamdae as bd
from beamdae.equations import measures
from beamdae.equations.formulations.first_order import formulate_first_order

SECTION = bd.Section.rectangle(bd.Material(E=1e7, nu=0.3, rho=1e3), width=1.0, height=0.01)

_MAX_ITERATIONS = 50
_MAX_ROTATION_CHANGE = 0.5  # largest change of a coordinate in one Newton iteration [rad or m]
_CONVERGENCE_TOLERANCE = 1e-10  # largest change of a coordinate [rad or m]


def cantilever(curve, force, moment, bodies, **settings):
    """Return the equations of a clamped beam whose end loads reach the given values at t = 1 s."""
    mech = bd.Mechanism()
    elements = max(8 // bodies, 2)
    beams = bd.welded_beams(mech, "beam", curve, SECTION, bodies, elements=elements, **settings)
    mech.add(bd.Weld("clamp", mech.ground.at(*curve.point(0.0)), beams[0].start))
    fx, fy = force
    mech.add(bd.Force("force", beams[-1].end, (lambda t: fx * t, lambda t: fy * t)))
    mech.add(bd.Moment("moment", beams[-1].end, lambda t: moment * t))
    mech.observe("tip", beams[-1].end)
    return bd.equations_of_motion(mech)


def solve_path(equations, times):
    """Return equilibria (k, n) at the load factors `times`, up to the first that fails."""
    form = formulate_first_order(equations, "index3")
    pattern, n = form.pattern, equations.n
    y, equilibria = np.zeros(form.size), []
    y[:n] = equations.q0
    rates = np.zeros(form.size)
    for t in times:
        for _ in range(_MAX_ITERATIONS):
            residual = form.residual(np.array([t, t]), y, rates)
            values = form.jacobian(np.array([t, t]), y, rates, 0.0)
            matrix = sp.csc_array((values, pattern.indices, pattern.indptr), shape=pattern.shape)
            change = splu(matrix).solve(residual)
            y -= change * min(1.0, _MAX_ROTATION_CHANGE / np.max(np.abs(change[:n])))
            if np.max(np.abs(change[:n])) < _CONVERGENCE_TOLERANCE:
                break
        else:
            break
        equilibria.append(y[:n].copy())
    return np.array(equilibria)


def solve_tips(equations, times):
    """Return tips (k, 2) [m]."""
    q = solve_path(equations, times)
    zeros = np.zeros((len(q), 2)), np.zeros_like(q), np.zeros((len(q), equations.m))
    observables = measures.ObservedRows(equations)(zeros[0], q, zeros[1], zeros[1], zeros[2])
    return observables[:, :2]


def solve_exact_tips(curve, force, moment, times):
    """Return tips (k, 2) [m] of Reissner's beam (J. Appl. Math. Phys. 23 (1972) 795)."""
    tips = []
    s = np.linspace(0.0, curve.length, 400)
    guess = np.vstack([curve.point(s).T, np.zeros((2, len(s)))])
    for t in times:
        (fx, fy), end_moment = np.multiply(force, t), moment * t

        def slope(s, y, fx=fx, fy=fy):
            c, d = np.cos(curve.tangent_angle(s) + y[2]), np.sin(curve.tangent_angle(s) + y[2])
            stretch, shear = 1.0 + (c * fx + d * fy) / SECTION.EA, (c * fy - d * fx) / SECTION.GA
            along, up = stretch * c - shear * d, stretch * d + shear * c
            return np.stack([along, up, y[3] / SECTION.EI, up * fx - along * fy])

        def boundary_residual(a, b, end_moment=end_moment):
            return np.array([*(a[:2] - curve.point(0.0)), a[2], b[3] - end_moment])

        solution = solve_bvp(slope, boundary_residual, s, guess, tol=1e-8, max_nodes=20000)
        s, guess = solution.x, solution.y
        tips.append(guess[:2, -1])
    return np.array(tips)
