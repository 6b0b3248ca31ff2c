"""Rolling disks and skates: closed forms and levels along motions."""

import numpy as np
import pytest
from conformance import IDA_FORMS, integrators, tuned
from numpy.testing import assert_allclose
from test_friction import run

import beamdae as bd

MASS, INERTIA = 1.3, 0.4

# Chaplygin's sleigh: the blade is ARM behind the center of mass. With J = I + m ARM^2 the speed
# along it is SPIN sqrt(J/m) tanh(k t), the angular velocity SPIN / cosh(k t), k = ARM SPIN
# sqrt(m/J), and the side force m (v w)(I/J).
ARM, SPIN = 0.3, 2.0
ROOTED = INERTIA + MASS * ARM**2


def sleigh(turn=0.0, at=(0.0, 0.0)):
    c, s = np.cos(turn), np.sin(turn)
    center = (at[0] + c * ARM, at[1] + s * ARM)
    speed = (-s * ARM * SPIN, c * ARM * SPIN)
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("sleigh", MASS, INERTIA, center, speed, SPIN))
    skate = mech.add(bd.Skate("skate", body.at(*at), direction=(c, s)))
    mech.observe("blade", body.at(*at))
    mech.observe("side", skate.reaction)
    return mech


def sleigh_motion(t):
    """Return angle, angular velocity and side force."""
    k = ARM * SPIN * np.sqrt(MASS / ROOTED)
    rate = SPIN / np.cosh(k * t)
    speed = SPIN * np.sqrt(ROOTED / MASS) * np.tanh(k * t)
    angle = 2.0 * SPIN / k * np.arctan(np.tanh(0.5 * k * t))
    return angle, rate, MASS * INERTIA / ROOTED * speed * rate


@pytest.mark.parametrize("formulation", ["index3", "stabilized-index2"])
@pytest.mark.parametrize("rho_inf", [0.9, 0.0])
def test_generalized_alpha_is_of_second_order(formulation, rho_inf):
    def errors(steps):
        step = 2.0 / steps
        integrator = bd.GeneralizedAlpha(
            step=step, newton_tolerance=1e-10, formulation=formulation, rho_inf=rho_inf
        )
        solution = run(sleigh(), integrator, 2.0, step)
        angle, rate, force = sleigh_motion(solution.t)
        off = solution.q[:, 2] - angle, solution.v[:, 2] - rate, -solution.lam[:, 0] - force
        return np.max(np.abs(off), axis=1)

    # Terms of the next order are visible for rho_inf = 0.
    assert_allclose(np.log2(errors(200) / errors(400)), 2.0, rtol=0.0, atol=0.05)


@pytest.mark.parametrize(
    "integrator",
    [pytest.param(x, id=name) for name, x in tuned(1e-7, 1e-3, also=IDA_FORMS).items()],
)
def test_chaplygin_sleigh(integrator):
    solution = run(sleigh(), integrator, 4.0, 0.1)
    angle, rate, force = sleigh_motion(solution.t)
    # Errors of Ida with error control of positions are 8e-6, 4e-6 and 5e-4; those of
    # generalized-alpha at this step are 8e-7, 4e-7 and 3e-5.
    assert_allclose(solution.q[:, 2], angle, rtol=0.0, atol=2e-5)
    assert_allclose(solution.v[:, 2], rate, rtol=0.0, atol=1e-5)
    assert_allclose(solution.columns["side.F [N]"], force, rtol=0.0, atol=1e-3)
    assert solution.quality.max_position_drift == 0.0


@integrators(1e-7, 1e-3)
def test_disk_rolls_down_an_incline(integrator):
    """a = g sin(slope) / (1 + I/(m r^2)), on either side of the line."""
    radius, slope_angle, gravity = 0.3, 0.4, 9.81
    direction = np.array([np.cos(slope_angle), -np.sin(slope_angle)])
    normal = np.array([np.sin(slope_angle), np.cos(slope_angle)])
    rate = gravity * np.sin(slope_angle) / (1.0 + INERTIA / (MASS * radius**2))
    for along in (1.0, -1.0):
        mech = bd.Mechanism(gravity=(0.0, -gravity))
        center = tuple((radius * normal + 0.7 * direction).tolist())
        disk = mech.add(bd.RigidBody("disk", MASS, INERTIA, center))
        rolling = bd.RollingOnLine(
            "r", mech.ground.at(0, 0), disk.at(*center), radius, tuple(along * direction)
        )
        mech.observe("r", mech.add(rolling).reaction)
        solution = run(mech, integrator, 1.0, 0.25)
        travel = 0.5 * rate * solution.t**2
        # Methods of all orders reproduce a parabola up to rtol.
        assert_allclose((solution.q[:, :2] - center) @ direction, travel, rtol=0.0, atol=1e-7)
        assert_allclose(solution.q[:, 2], -travel / radius, rtol=0.0, atol=1e-6)
        reactions = [MASS * gravity * np.cos(slope_angle), -INERTIA * rate / radius**2]
        forces = [solution.columns["r.Fn [N]"], solution.columns["r.Ft [N]"]]
        assert_allclose(along * np.array(forces).T, np.tile(reactions, (5, 1)), rtol=1e-5)


def test_two_perpendicular_skates_fix_a_point():
    mech = bd.Mechanism()
    body = mech.add(bd.RigidBody("body", 1.0, 0.1, velocity=(1.0, 1.0), angular_velocity=0.5))
    for name, direction in (("first", (1.0, 0.0)), ("second", (0.0, 1.0))):
        mech.add(bd.Skate(name, body.at(0.2, 0.0), direction))
    mech.observe("held", body.at(0.2, 0.0))
    solution = run(mech, bd.Radau(1e-6), 1.0, 0.5).columns
    # The form constrains the velocities of the point; its position is their integral.
    assert_allclose(solution["held.x [m]"], 0.2, rtol=0.0, atol=1e-6)
    assert_allclose(solution["held.y_dot [m/s]"], 0.0, rtol=0.0, atol=1e-8)
    mech.add(bd.Skate("third", body.at(0.2, 0.0), (1.0, 1.0)))
    with pytest.raises(bd.BeamdaeError, match="depend"):
        run(mech, bd.Radau(), 0.1, 0.1)
