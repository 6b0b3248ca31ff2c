"""ForceLaw: arguments, virtual work and energy balance."""

import numpy as np
import pytest
from conformance import integrators
from mechanisms import free_ball
from numpy.testing import assert_allclose
from support import NumericEquations

import beamdae as bd


def test_the_law_receives_the_observed_motion():
    """It does virtual work on that motion: forces at the point, moments on the rotation."""
    motions = []
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("body", 1.0, 1.0))
    on = body.at(1.0, 0.5)

    def law(body, t):
        motions.append((*body.position, body.angle, *body.velocity, body.rate))
        return (body.position[0], body.velocity[1] + t, 2.0 * body.rate + 3.0 * body.angle)

    load = mech.add(bd.ForceLaw("load", on, law))
    mech.observe("point", on)
    mech.observe("load", load.load)
    assert len(motions[0]) == 6
    numeric = NumericEquations(mech, time=(0.4, 0.4))
    q, v = np.array([0.3, -0.2, 0.7]), np.array([1.0, 0.5, -2.0])
    x, y, angle, _, vy, rate = numeric.observed("point", q=q, v=v)
    expected = np.array([x, vy + 0.4, 2.0 * rate + 3.0 * angle])
    assert_allclose(numeric.observed("load", q=q, v=v), expected, rtol=1e-13)
    arm = np.array([x, y]) - q[:2]
    moment = expected[2] + arm[0] * expected[1] - arm[1] * expected[0]
    assert_allclose(numeric.force(q, v), [-expected[0], -expected[1], -moment], rtol=1e-13)


@integrators(rtol=1e-6, step=1e-3)
def test_coulomb_damped_oscillator_decays_linearly(integrator):
    """The amplitude decreases by 4 mu m g / k per period under Coulomb friction."""
    stiffness, friction, speed = 100.0, 0.8, 1e-3
    mech, block = free_ball((1.2, 0.0), name="block")
    mech.add(bd.Spring("spring", mech.ground.at(0, 0), block.point, stiffness, free_length=1.0))

    def rub(block, t):
        return (-friction * np.tanh(block.velocity[0] / speed), 0.0)

    mech.add(bd.ForceLaw("friction", block.point, rub, dissipative=True))
    period = 2.0 * np.pi / 10.0
    solution = bd.simulate(mech, integrator, t_end=3.0 * period, output_step=0.5 * period)
    assert solution.status.success, solution.status.sentence
    decrement = 2.0 * friction / stiffness * np.arange(7)
    amplitude = (solution.q[:, 0] - 1.0) * (-1.0) ** np.arange(7)
    # Regularization by tanh reduces the decrement by speed / (w A), below 3 %.
    assert_allclose(amplitude, 0.2 - decrement, rtol=0.0, atol=0.03 * decrement[1])
    assert solution.quality.energy_imbalance < 1e-4
    dissipated = 0.5 * stiffness * (0.2**2 - (0.2 - decrement[-1]) ** 2)
    assert_allclose(solution.energies["energy.dissipated [J]"].iloc[-1], dissipated, rtol=5e-3)


@pytest.mark.parametrize("native", [True, False])
def test_numpy_functions_of_symbols(native, monkeypatch):
    """Formulas have the same values in kernels as for numbers."""
    if not native:
        monkeypatch.setenv("BEAMDAE_NATIVE", "off")

    def law(p, t):
        (x, y), (u, v) = p.position, p.velocity
        fx = np.tanh(x) + np.abs(u) ** 1.5 + np.maximum(x, y) * np.minimum(u, v) + np.hypot(x, y)
        fy = np.arctan2(y, x) + np.exp(-(u**2)) * np.log1p(x**2) + np.clip(v, -0.5, 0.5)
        return (fx + np.maximum(u, 0.0) ** 2.5, fy + np.cosh(t) * np.tanh(v / 0.3))

    mech, bob = free_ball((1.0, 0.5), name="bob")
    mech.add(bd.ForceLaw("load", bob.point, law))
    numeric = NumericEquations(mech, time=(0.3, 0.3))
    for seed in range(5):
        q, v = np.random.default_rng(seed).standard_normal((2, 2))

        class At:
            position, velocity = q, v

        assert_allclose(-numeric.force(q, v), law(At, 0.3), rtol=1e-13)


def _tangent_by_components(r):
    length = np.sqrt(r[0] ** 2 + r[1] ** 2)
    return (-r[1] / length, r[0] / length)


LINE = bd.table([-10.0, 10.0], [3.0, -3.0], kind="linear")
QUARTER_TURN = np.array([[0.0, -1.0], [1.0, 0.0]])
VECTOR_LAWS = {
    "array @ vector": lambda r, v: (np.array([-r[1], r[0]]) / np.sqrt(r @ r), lambda e: e @ v),
    "vector @ array": lambda r, v: (np.array([-r[1], r[0]]) / np.sqrt(r @ r), lambda e: v @ e),
    "np.dot": lambda r, v: (np.array([-r[1], r[0]]) / np.hypot(*r), lambda e: np.dot(v, e)),
    "matrix": lambda r, v: (QUARTER_TURN @ r / np.linalg.norm(r), lambda e: np.dot(e, v)),
    "sum": lambda r, v: (np.array([-r[1], r[0]]) * (r @ r) ** -0.5, lambda e: np.sum(e * v)),
    "table": lambda r, v: (
        np.array([-r[1], r[0]]) / np.sqrt(r @ r),
        lambda e: -LINE(v @ e) * np.array([0.0, 1.0 / 0.3]) @ np.array([0.5, 1.0]),
    ),
    "smooth functions": lambda r, v: (
        np.array([-r[1], r[0]]) / np.sqrt(np.maximum(r @ r, 0.0)),
        lambda e: np.tanh((1e6 * v @ v) / 1.0) * e @ v,
    ),
}


@pytest.mark.parametrize("name", VECTOR_LAWS)
def test_regression_vectors_of_a_law_multiply_arrays(name):
    """An array divided by an expression became a matrix of CasADi, whose products failed."""

    def law(point, t):
        direction, product = VECTOR_LAWS[name](point.position, point.velocity)
        return -0.3 * product(direction) * direction

    def law_by_components(point, t):
        ex, ey = _tangent_by_components(point.position)
        speed = point.velocity[0] * ex + point.velocity[1] * ey
        return (-0.3 * speed * ex, -0.3 * speed * ey)

    forces = []
    for each in (law, law_by_components):
        mech = bd.Mechanism()
        bob = mech.add(bd.PointMass("bob", 1.0, at=(1.0, 0.0)))
        mech.add(bd.ForceLaw("drag", bob.point, each))
        forces.append(NumericEquations(mech).force([0.8, 0.4], [0.5, -1.0]))
    assert_allclose(*forces, rtol=1e-13)
