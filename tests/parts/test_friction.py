"""Friction in joints: closed forms, energy balance and paradoxes."""

import numpy as np
import pytest
from conformance import IDA_FORMS, tuned
from mechanisms import driven, free_ball, hinged_body, rectangle
from numpy.testing import assert_allclose
from support import NumericEquations

import beamdae as bd

GRAVITY, MASS, COEFFICIENT = 9.81, 2.0, 0.3


def run(model, integrator, t_end, step=None):
    """Return the solution of a run that reached its end."""
    solution = bd.simulate(model, integrator, t_end, step)
    assert solution.status.success, solution.status.sentence
    return solution


def block(speed=2.0, turn=0.0, at=(0.0, 0.0), pull=0.0, mass=MASS, **friction):
    """Return a block on an inclined guide, pressed onto it by its weight."""
    c, s = np.cos(turn), np.sin(turn)
    mech = bd.Mechanism(gravity=(GRAVITY * s, -GRAVITY * c))
    body = mech.add(bd.RigidBody("block", mass, 0.25 * mass, at, (c * speed, s * speed)))
    guide = mech.add(bd.PointOnLine("guide", mech.ground.at(*at), body.at(*at), (c, s)))
    mech.add(bd.Force("pull", body.at(*at), (c * pull, s * pull)))
    settings = {"coefficient": COEFFICIENT, "friction_speed": 1e-3} | friction
    rubbing = mech.add(bd.Friction("friction", guide, **settings))
    mech.observe("friction", rubbing.reaction)
    mech.observe("block", body.at(*at))
    return mech


@pytest.mark.parametrize(
    "integrator",
    [pytest.param(x, id=name) for name, x in tuned(1e-8, 1e-3, also=IDA_FORMS).items()],
)
@pytest.mark.parametrize("turn", [0.0, 2.5])
def test_block_on_a_plane_slows_down_by_mu_g(integrator, turn):
    solution = run(block(turn=turn, at=(2.0, -1.0)), integrator, 0.5, 0.1)
    travel = 2.0 * solution.t - 0.5 * COEFFICIENT * GRAVITY * solution.t**2
    distance = np.hypot(solution.q[:, 0] - 2.0, solution.q[:, 1] + 1.0)
    assert_allclose(distance, travel, rtol=0.0, atol=2e-8)
    friction_force = COEFFICIENT * MASS * GRAVITY
    assert_allclose(solution.columns["friction.F [N]"], -friction_force, rtol=1e-6)
    assert_allclose(
        solution.columns["friction.v [m/s]"], 2.0 - 0.3 * GRAVITY * solution.t, atol=1e-6
    )
    assert solution.quality.energy_imbalance < 1e-7
    assert_allclose(solution.energies["energy.dissipated [J]"], friction_force * travel, atol=1e-6)


@pytest.mark.parametrize("force", [1e-14, 1e-7, 1e-4, 1e2])
def test_regression_reactions_below_a_millinewton_cause_friction(force):
    """Grains and blocks of a crane slow down alike; the default smoothing was 1e-3 and 1e-12 N."""
    solution = run(block(mass=force / GRAVITY), bd.Radau(1e-8), 0.5, 0.1)
    travel = 2.0 * solution.t - 0.5 * COEFFICIENT * GRAVITY * solution.t**2
    assert_allclose(solution.q[:, 0], travel, rtol=0.0, atol=2e-8)
    assert_allclose(solution.columns["friction.F [N]"], -COEFFICIENT * force, rtol=1e-6)


def test_a_force_below_the_friction_limit_makes_it_creep():
    """Under F < mu N it creeps with v = friction_speed atanh(F / (mu N))."""
    pull = 3.0
    solution = run(block(speed=0.0, pull=pull), bd.Radau(rtol=1e-8), 1.0, 0.5)
    creep = 1e-3 * np.arctanh(pull / (COEFFICIENT * MASS * GRAVITY))
    assert_allclose(solution.columns["friction.v [m/s]"][1:], creep, rtol=1e-6)


@pytest.mark.parametrize("speed", [1e-4, 0.01, 0.05, 2.0])
def test_stribeck(speed):
    law = {"static": 0.5, "stribeck": 0.02, "friction_speed": 1e-3}
    numeric = NumericEquations(block(speed=speed, **law))
    expected = -MASS * GRAVITY * np.tanh(speed / 1e-3)
    expected *= 0.3 + 0.2 * np.exp(-((speed / 0.02) ** 2))
    solution = numeric.observed("friction", v=[speed, 0.0, 0.0], lam=[-MASS * GRAVITY])
    assert_allclose(solution, [expected, speed], rtol=1e-12)


def test_painleve_paradox_is_reported():
    """Painleve's rod, pushed ahead of its contact, jams for I = m l^2 / 3 and 135 deg."""
    half, turn = 1.0, 0.75 * np.pi

    def rod(coefficient):
        center = (half * np.cos(turn), half * np.sin(turn))
        mech = bd.Mechanism(gravity=(0.0, -GRAVITY))
        bar = mech.add(bd.RigidBody("rod", 1.0, 1.0 / 3.0, center, velocity=(1.0, 0.0)))
        tip = bd.PointOnLine("floor", mech.ground.at(0, 0), bar.at(0, 0))
        mech.add(bd.Friction("rub", mech.add(tip), coefficient, friction_speed=1e-3))
        return mech

    # N (1 + 3 cos^2) + 3 mu |N| cos sin = m g: no solution N for mu above (1 + 1.5) / 1.5.
    run(rod(1.6), bd.Radau(), 1e-3)
    with pytest.raises(
        bd.BeamdaeError, match=r"floor: with friction, no accelerations .* at t = 0 s .*Painleve"
    ):
        run(rod(1.8), bd.Radau(), 1e-3)


def test_regression_the_radius_is_a_possible_cause_of_a_paradox():
    """A radius in mm led to the advice to reduce the coefficient of friction."""
    mech, _ = hinged_body(MASS, 0.2, (0.5, 0.0), gravity=GRAVITY, angular_velocity=-1.0)
    mech.add(bd.Friction("bush", mech.part("hinge"), 0.3, friction_speed=0.01, radius=50.0))
    with pytest.raises(bd.BeamdaeError, match=r"check the radius \(bush: 50 m\), reduce the"):
        run(mech, bd.Radau(), 1e-3)


@pytest.mark.slow(reason="runs of a flexible arm")
@pytest.mark.parametrize("coefficient", [1e-8, 1e-2, 0.5])
def test_friction_of_flexible_arms_restarts_at_breakpoints(coefficient):
    """Rounding of stiff beams was above the tolerance of reactions: "Painleve's paradox"."""
    mech = bd.Mechanism()
    aluminum = bd.Material(E=70e9, nu=0.33, rho=2700.0)
    strip = rectangle(0.0015, damping=2e-4, material=aluminum)
    upper = mech.add(bd.RigidBody.rod("upper", (0.0, 0.0), (0.4, 0.0), mass=0.4))
    lash = mech.add(bd.Beam("lash", bd.Line((0.4, 0.0), (1.0, 0.0)), strip))
    center, elbow = upper.at(0.0, 0.0), upper.at(0.4, 0.0)
    shoulder = mech.add(bd.Revolute("shoulder", mech.ground.at(0.0, 0.0), center))
    mech.add(bd.Friction("bearing", shoulder, coefficient, 1e-3, radius=0.01))
    mech.add(bd.Revolute("elbow", elbow, lash.start))
    mech.add(bd.TorsionSpring("wrist", elbow, lash.start, stiffness=2.0, damping=0.02))
    mech.add(bd.Moment("motor", center, bd.half_sine(2.0, 0.25) + bd.half_sine(-2.0, 0.25, 0.35)))
    assert bd.simulate(mech, t_end=0.7).status.success


@pytest.mark.parametrize("analyze", [bd.modes, bd.linearize])
def test_linear_models_about_rest_state_that_friction_is_a_damper(analyze):
    """Margins of a loop that diverges were those of a stable one."""
    mech = block(speed=0.0)
    joint = analyze(mech).warnings
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), mech.part("block").at(0.0, 0.0), 100.0))
    floor = bd.LineSurface(mech.ground.at(0.0, -1e-3), (1.0, 0.0))
    mech.add(
        bd.Contact(
            "rub", mech.part("block").at(0.0, 0.0), floor, 1e4, friction=0.2, friction_speed=1e-3
        )
    )
    both = analyze(mech).warnings
    assert sum(x.startswith("friction: about a state at rest") for x in joint) == 1
    assert sum(x.startswith("friction, rub: about a state at rest") for x in both) == 1


def test_linear_models_about_sliding_contain_its_friction():
    run = bd.simulate(block(speed=2.0), bd.Radau(1e-6), t_end=0.1)
    assert not any(
        "friction acts as a damper" in x for x in bd.modes(run.equations, run.at(0.1)).warnings
    )


@pytest.mark.slow(reason="one second")
def test_regression_equilibria_state_that_friction_does_not_hold():
    """A block on a slope "moved farthest", although its friction seemed to hold it."""
    mech, stone = free_ball(mass=MASS, name="stone", gravity=GRAVITY)
    slope = mech.add(bd.PointOnLine("slope", mech.ground.at(0.0, 0.0), stone.point, (1.0, -0.1)))
    words = "add a joint or a spring"
    assert bd.equilibrium(mech).status.sentence.partition(" (last")[0].endswith(words)
    mech.add(bd.Friction("rub", slope, 0.5, friction_speed=1e-3))
    words += ", because the friction of rub is zero at rest"
    assert bd.equilibrium(mech).status.sentence.partition(" (last")[0].endswith(words)


@pytest.mark.slow(reason="a fifth of a second")
def test_ida_converges_for_friction_in_guides_of_fully_driven_bodies():
    """Only Newton's iteration determines these reactions, and the friction depends on them.

    Regression: the reactions were 1e8 times too large, and three quarters of the energy was wrong.
    """
    mech = bd.Mechanism()
    center, pin = (0.0, 0.3), (0.0, 0.42)
    crank = mech.add(bd.RigidBody("crank", 12.0, 0.1, center=center))
    ram = mech.add(bd.RigidBody("ram", 25.0, 1.0, center=(0.7, 0.65)))
    link = mech.add(bd.RigidBody.rod("link", pin, (0.6, 0.65), mass=1.5))
    mech.add(bd.Revolute("bearing", mech.ground.at(*center), crank.at(*center)))
    law = bd.run_up(2.0 * np.pi, 0.5)
    mech.add(bd.Driver("motor", mech.ground.at(*center), crank.at(*center), law))
    mech.add(bd.Revolute("crank pin", crank.at(*pin), link.at(*pin)))
    mech.add(bd.Revolute("ram pin", link.at(0.6, 0.65), ram.at(0.6, 0.65)))
    guide = mech.add(bd.Prismatic("guide", mech.ground.at(0.0, 0.65), ram.at(0.7, 0.65)))
    mech.add(bd.Friction("rubbing", guide, 0.1, friction_speed=0.02, radius=0.2, smoothing=1.0))
    mech.observe("guide", guide.reaction)
    ida, radau = (bd.simulate(mech, i, t_end=3.0) for i in (bd.Ida(1e-5), bd.Radau(1e-8)))
    assert ida.quality.energy_imbalance < 1e-4
    assert ida.quality.max_residual < 1e-3
    exact = radau.observed["guide.F [N]"]
    # Rows between steps are interpolated by polynomials, across the reversal of friction.
    assert_allclose(ida.observed["guide.F [N]"], exact, rtol=0, atol=1e-2 * np.ptp(exact))


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(("frequency", "friction_speed"), [(1.0, 1e-3), (1.0, 1e-4), (4.0, 1e-3)])
def test_regression_friction_does_not_overshoot_in_the_torque_of_a_driver(
    frequency, friction_speed
):
    """The torque between steps exceeded its peak by 4 to 61 %, without a warning."""
    mech, hub = driven(bd.RigidBody("hub", 0.5, 3e-4), bd.sine(0.785, frequency))
    mech.add(bd.Force("side", hub.at(0.0, 0.0), (0.0, -500.0)))
    section = rectangle(4e-3, damping=5e-4)
    arm = mech.add(bd.Beam("arm", bd.Line((0.0, 0.0), (0.4, 0.0)), section, elements=4))
    mech.add(bd.Weld("weld", hub.at(0.0, 0.0), arm.start))
    mech.add(bd.Friction("friction", mech.part("hinge"), 0.2, friction_speed, radius=0.02))
    mech.observe("motor", mech.part("motor").drive)
    solution = run(mech, None, 2.0 / frequency, 1e-3 / frequency)
    # Runs with steps of 2e-6 s.
    expected = 2.429 if frequency == 1.0 else 9.281
    assert_allclose(np.max(np.abs(solution["motor.M"])), expected, rtol=5e-3)
