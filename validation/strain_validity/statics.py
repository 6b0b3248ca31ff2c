"""Cantilevers under slowly growing loads: equilibria of a mechanism, and the exact ones."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.integrate import solve_bvp
from scipy.sparse.linalg import splu

import beamdae as bd
from beamdae.equations import measures
from beamdae.equations.formulations.first_order import formulate_first_order

SECTION = bd.Section.rectangle(bd.Material(E=1e7, nu=0.3, rho=1e3), width=1.0, height=0.01)


def cantilever(curve, force, moment, bodies, **settings):
    """A clamped beam whose end force and moment grow with time, at 1 s to the values given."""
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
    """Coordinates (k, n) of equilibrium at load parameters `times`, as far as it goes."""
    form = formulate_first_order(equations, "index3")
    pattern, n = form.pattern, equations.n
    y, rows = np.zeros(form.size), []
    y[:n] = equations.q0
    rest = np.zeros(form.size)
    for t in times:
        for _ in range(50):
            residual = form.residual(np.array([t, t]), y, rest)
            values = form.jacobian(np.array([t, t]), y, rest, 0.0)
            matrix = sp.csc_array((values, pattern.indices, pattern.indptr), shape=pattern.shape)
            change = splu(matrix).solve(residual)
            # No section turns by more than this in one iteration.
            y -= change * min(1.0, 0.5 / np.max(np.abs(change[:n])))
            if np.max(np.abs(change[:n])) < 1e-10:
                break
        else:
            break
        rows.append(y[:n].copy())
    return np.array(rows)


def solve_tips_and_rotations(equations, times):
    """Tips (k, 2) and largest rotations (k,) relative to the frames along the path."""
    q = solve_path(equations, times)
    zeros = np.zeros((len(q), 2)), np.zeros_like(q), np.zeros((len(q), equations.m))
    observed = measures.ObservedRows(equations)(zeros[0], q, zeros[1], zeros[1], zeros[2])
    rotation = [max(term.largest(row[None])[1] for term in equations.ranges) for row in q]
    return observed[:, :2], np.array(rotation)


def solve_exact_tips(curve, force, moment, times):
    """Tips (k, 2) of Reissner's beam (J. Appl. Math. Phys. 23 (1972) 795) along the path."""
    x, found = SECTION, []
    s = np.linspace(0.0, curve.length, 400)
    guess = np.vstack([curve.point(s).T, np.zeros((2, len(s)))])
    for t in times:
        (fx, fy), end = np.multiply(force, t), moment * t

        def slope(s, y, fx=fx, fy=fy):
            c, d = np.cos(curve.tangent_angle(s) + y[2]), np.sin(curve.tangent_angle(s) + y[2])
            stretch, shear = 1.0 + (c * fx + d * fy) / x.EA, (c * fy - d * fx) / x.GA
            along, up = stretch * c - shear * d, stretch * d + shear * c
            return np.stack([along, up, y[3] / x.EI, up * fx - along * fy])

        def ends(a, b, end=end):
            return np.array([*(a[:2] - curve.point(0.0)), a[2], b[3] - end])

        solution = solve_bvp(slope, ends, s, guess, tol=1e-8, max_nodes=20000)
        s, guess = solution.x, solution.y
        found.append(guess[:2, -1])
    return np.array(found)
