"""Chains of beams and the matrices that integrators factorize for them."""

import numpy as np
import scipy.sparse as sp
from mechanisms import EARTH, rectangle

import beamdae as bd
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.equations.formulations.step_equations import StepPrediction, formulate_step
from beamdae.equations.starts.state_evaluator import StateEvaluator
from beamdae.integrators.radau.coefficients import COMPLEX_EIGENVALUE, REAL_EIGENVALUE

ALLOY = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
STRIP = rectangle(0.0025, 0.03, damping=1e-4, material=ALLOY)


def chain_of_beams(beams, joint=bd.Revolute, elements=4, frame="tangent"):
    """Return a mechanism of straight beams in a row, the first hinged to the ground."""
    mech = bd.Mechanism(gravity=EARTH)
    links = []
    for k in range(beams):
        line = bd.Line((0.4 * k, 0.0), (0.4 * (k + 1), 0.0))
        links.append(mech.add(bd.Beam(f"link {k}", line, STRIP, elements=elements, frame=frame)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), links[0].start))
    for k in range(1, beams):
        mech.add(joint(f"joint {k}", links[k - 1].end, links[k].start))
    return mech


def random_state(equations, seed=0):
    """Return random coordinates, velocities, accelerations and multipliers."""
    rng = np.random.default_rng(seed)
    motion = (rng.normal(size=equations.n) * equations.position_scales for _ in range(3))
    q, v, a = (size * x for size, x in zip((1e-5, 1e-3, 0.1), motion, strict=True))
    return equations.q0 + q, v, a, 10.0 * rng.normal(size=equations.m)


def integrator_matrices(equations, step):
    """Return the matrices of Ida, Radau, generalized-alpha and the start: patterns, non-zeros."""
    q, v, a, lam = random_state(equations)
    time, zeros = np.zeros(2), np.zeros(equations.m)
    form = formulate_first_order(equations, "stabilized-index1")

    def jacobian(c):
        y, yp = np.concatenate([q, v, zeros, zeros]), np.concatenate([v, a, lam, zeros])
        return form.jacobian(time, y, yp, c)

    stiffness, inertia = jacobian(0.0), jacobian(1.0) - jacobian(0.0)
    systems = {
        "Ida": (form.pattern, jacobian(1.0 / step)),
        "Radau": (form.pattern, jacobian(REAL_EIGENVALUE / step)),
        "Radau, complex": (form.pattern, stiffness + (COMPLEX_EIGENVALUE / step) * inertia),
    }
    for name, stabilized in (("index 3", False), ("index 2", True)):
        form = formulate_step(equations, stabilized)
        x = np.zeros(form.size)
        x[equations.n :][: equations.m] = step**2 * lam
        coefficients = np.array([2.0 / step, 3.0 / step**2, 0.3 * step**2])
        predicted = StepPrediction(q, v, a, q, coefficients)
        systems[name] = (form.pattern, form.jacobian(time, predicted, x))
    evaluator = StateEvaluator(equations)
    nonzeros = evaluator.saddle_matrix(time, q, v, a, (0.0, 0.0, 1.0))
    return {**systems, "start": (evaluator.sums.saddle_pattern, nonzeros)}


def backward_error(pattern, nonzeros, x, right):
    """Return the backward error of Oettli & Prager: largest residual relative to its terms."""
    matrix = sp.csc_array((nonzeros, pattern.indices, pattern.indptr), shape=pattern.shape)
    terms = abs(matrix) @ np.abs(x) + np.abs(right)
    return float(np.max(np.abs(matrix @ x - right) / terms))


def pattern_of_elements(elements, border):
    """Return the dense pattern of a chain of elements of 4 nodes, coupled with a border."""
    size = 9 * elements + 3
    dense = np.zeros((size + border, size + border), bool)
    for first in range(0, 9 * elements, 9):
        dense[first : first + 12, first : first + 12] = True
    dense[size:, :] = dense[:, size:] = True
    return dense
