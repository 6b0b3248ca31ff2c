"""Contact: times of impact, restitution and friction."""

import numpy as np
import pytest
from conformance import integrators
from mechanisms import free_ball
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from support import NumericEquations

import beamdae as bd

GRAVITY = 9.81


def rebound(restitution, of, speed):
    """Return the speed after an impact: X v - ln(1 + X v) is equal for v before and -v after."""
    factor = bd.Contact(
        "c",
        bd.PointMass("p", 1.0, at=(0.0, 0.0)).point,
        bd.LineSurface(bd.Mechanism().ground.at(0.0, 0.0)),
        1.0,
        restitution=restitution,
        impact_speed=of,
    ).hysteresis
    before = factor * speed - np.log1p(factor * speed)
    low, high = 0.0, min(speed, 1.0 / factor)
    for _ in range(100):
        middle = 0.5 * (low + high)
        more = -factor * middle - np.log1p(-factor * middle) < before
        low, high = (middle, high) if more else (low, middle)
    return low


@pytest.mark.parametrize("restitution", [0.05, 0.3, 0.8, 0.99, 0.9999])
def test_restitution_is_exact_at_its_speed(restitution):
    # Near 1 cancellation in the equation leaves (1 - e)^2 of the digits of the loss.
    after = rebound(restitution, 2.0, 2.0)
    assert_allclose(after, 2.0 * restitution, rtol=1e-7)


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0])
def test_rest_on_the_floor(exponent):
    """The penetration at which k d^n carries the weight."""
    depth = (2.0 * GRAVITY / 5e5) ** (1.0 / exponent)
    mech, ball = free_ball((0.0, -depth), 2.0, gravity=GRAVITY)
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    mech.add(bd.Contact("floor", ball.point, floor, 5e5, exponent))
    assert_allclose(NumericEquations(mech).force(), 0.0, atol=1e-9)


@integrators(rtol=1e-6, step=1e-3)
def test_a_block_slides_to_rest_under_friction(integrator):
    """v = v0 - mu g t, then creep that decays within friction_speed / (mu g)."""
    depth = (2.0 * GRAVITY / 1e6) ** (1.0 / 1.5)
    mech, block = free_ball(
        (0.0, -depth), mass=2.0, name="block", gravity=GRAVITY, velocity=(2.0, 0.0)
    )
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    mech.add(bd.Contact("floor", block.point, floor, 1e6, friction=0.4, friction_speed=1e-3))
    solution = bd.simulate(mech, integrator, t_end=0.8, output_step=0.01)
    assert solution.status.success, solution.status.sentence
    slowing = 0.4 * GRAVITY
    t = solution.t
    speed = np.maximum(2.0 - slowing * t, 0.0)
    # Regularization: tanh(v / 1 mm/s) reaches 0.76 at 1 mm/s.
    assert_allclose(solution.v[:, 0], speed, rtol=0.0, atol=1.5e-3)
    assert_allclose(solution.energies["energy.dissipated [J]"].iloc[-1], 4.0, rtol=1e-3)


@pytest.mark.parametrize(
    "integrator", [bd.Ida(), bd.Radau(), bd.GeneralizedAlpha(rtol=1e-5)], ids=lambda x: str(x)[:5]
)
def test_max_step_keeps_integrators_from_stepping_over_a_post(integrator):
    mech, ball = free_ball(velocity=(100.0, 0.0))
    post = bd.CircleSurface(mech.ground.at(4.0, 0.0), 0.05)
    mech.add(bd.Contact("post", ball.point, post, 1e9, max_step=1e-4))
    solution = bd.simulate(mech, integrator, t_end=0.1)
    assert_allclose(solution.v[-1, 0], -100.0, rtol=3e-3)
    assert solution.statistics.steps >= 1000


def test_circles_from_outside_and_inside():
    mech, ball = free_ball((3.0, 4.0))
    for name, radius, side in (("out", 5.5, "outside"), ("in", 4.5, "inside")):
        surface = bd.CircleSurface(mech.ground.at(0.0, 0.0), radius, side)
        touch = mech.add(bd.Contact(name, ball.point, surface, 10.0, 1.0, friction=0.5))
        mech.observe(f"{name} gap", touch.gap)
        mech.observe(f"{name} force", touch.force)
    numeric = NumericEquations(mech)
    v = np.array([-4.0, 3.0])
    for name in ("out", "in"):
        assert_allclose(numeric.observed(f"{name} gap"), [-0.5], rtol=1e-13)
        # Counter-clockwise motion with full friction, tanh(5000), against it.
        assert_allclose(numeric.observed(f"{name} force", v=v), [5.0, -2.5], rtol=1e-13)
    # Normal forces cancel, friction forces add up.
    assert_allclose(numeric.force(v=v), 5.0 * np.array([-0.8, 0.6]), atol=1e-13)
    assert np.all(np.isfinite(numeric.stiffness(np.zeros(2), v)))


BELT = {"mass": 1.0, "stiffness": 100.0, "weight": 10.0, "speed": 0.1}
STRIBECK = {"friction": 0.2, "friction_speed": 1e-2, "static": 0.4, "stribeck": 0.15}


def stribeck_coefficient(v, friction, friction_speed, static, stribeck):
    """Return the coefficient of friction with its sign, from the formula of the docstring."""
    kinetic = friction + (static - friction) * np.exp(-((v / stribeck) ** 2))
    return kinetic * np.tanh(v / friction_speed)


def block_on_belt(exponent=1.0, **changes):
    """A block on a spring, pressed against a belt so heavy that it keeps its speed."""
    law = STRIBECK | changes
    mech = bd.Mechanism()
    belt = mech.add(bd.RigidBody("belt", 1e12, 1e12, velocity=(BELT["speed"], 0.0)))
    normal_stiffness = 1e6
    depth = (BELT["weight"] / normal_stiffness) ** (1.0 / exponent)
    block = mech.add(bd.PointMass("block", BELT["mass"], at=(0.0, -depth)))
    mech.add(bd.Force("weight", block.point, (0.0, -BELT["weight"])))
    surface = bd.LineSurface(belt.at(0.0, 0.0))
    sole = mech.add(bd.Contact("sole", block.point, surface, normal_stiffness, exponent, **law))
    wall = mech.ground.at(-1.0, -depth)
    mech.add(bd.Spring("spring", wall, block.point, BELT["stiffness"], free_length=1.0))
    mech.observe("block", block.point)
    mech.observe("sole", sole.force)
    mech.observe("sliding", sole.sliding)
    return mech


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    "method",
    [
        pytest.param(bd.Radau(1e-8), marks=pytest.mark.slow(reason="2 s")),
        bd.GeneralizedAlpha(5e-4, rho_inf=0.9),
    ],
    ids=["radau", "alpha"],
)
def test_a_block_on_a_belt_sticks_and_slips_as_a_rigid_model(method):
    """Beside an independent integration of m x'' = -k x - mu(x' - speed) N."""

    def rates(t, y):
        friction = stribeck_coefficient(y[1] - BELT["speed"], **STRIBECK) * BELT["weight"]
        return [y[1], (-BELT["stiffness"] * y[0] - friction) / BELT["mass"]]

    reference = solve_ivp(
        rates, (0.0, 2.0), [0.0, 0.0], "DOP853", rtol=1e-10, atol=1e-12, dense_output=True
    )
    run = bd.simulate(block_on_belt(), method, t_end=2.0, output_step=0.01)
    expected, speed = reference.sol(run.t)
    # It sticks, slips back and sticks again.
    assert expected[-1] < expected.max() - 0.02
    assert np.abs(speed - BELT["speed"]).min() < STRIBECK["friction_speed"]
    size = 0.5 * np.ptp(expected)
    assert_allclose(run["block.x"], expected, rtol=0.0, atol=1e-4 * size)
    slip = run["sliding.v"].to_numpy()
    assert_allclose(slip, run["block.x_dot"] - BELT["speed"], rtol=0.0, atol=1e-9)
    force = -stribeck_coefficient(slip, **STRIBECK) * run["sole.N"]
    assert_allclose(run["sole.T"], force, rtol=1e-9, atol=1e-12)
    assert_allclose(run["sliding.N"], run["sole.N"], rtol=1e-12)
    ledger = run.energies
    work = np.trapezoid(-run["sole.T"] * run["sliding.v"], run.t)
    assert ledger["energy.dissipated [J]"].iloc[-1] == pytest.approx(work, rel=0.02)


def test_equal_coefficients_are_friction_without_the_stribeck_effect():
    runs = [
        bd.simulate(block_on_belt(static=static, stribeck=v), bd.GeneralizedAlpha(1e-3), 0.2)
        for static, v in ((0.2, 0.1), (None, None))
    ]
    assert_allclose(runs[0]["sole.T"], runs[1]["sole.T"], rtol=1e-10, atol=1e-12)
