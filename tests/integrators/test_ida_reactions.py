"""Ida: reactions outside the error test, and position corrections of nearly fixed parts."""

import numpy as np
import pytest
from benchmarks.systems import knife_edge
from governor import governor
from numpy.testing import assert_allclose
from parts.test_user_joints import GRAVITY, PULLED_MASS, pull_of, pulled_body
from quick_return import quick_return

import beamdae as bd

slow = pytest.mark.slow(reason="the same law as in other tests")
# In the index-3 form, "auto" never tests velocities, whose error grows as the step shrinks.
FORMULATIONS = ("stabilized-index1", "ggl", "index2", "index1", "index3")
first, *others, _ = [(f, e) for f in FORMULATIONS for e in ("positions", "velocities")]


@pytest.mark.parametrize(
    ("formulation", "error_control"),
    [first, *(pytest.param(*other, marks=slow) for other in others)],
)
def test_regression_reactions_in_friction_are_iterated(formulation, error_control):
    """Energy was off by 27 to 100 %, reactions by up to 1e7 times their size where friction turns.

    Where modes are fast beside the motion "auto" tests positions alone, and so for other forms.
    """
    settings = bd.Ida(1e-5, formulation=formulation, error_control=error_control)
    solution = bd.simulate(quick_return, settings)
    # 100 rtol as documented; the largest reaction is 4328 N m by all integrators at 1e-7.
    assert solution.quality.energy_imbalance < 1e-3
    assert_allclose(np.max(np.abs(solution.lam)), 4328.0, rtol=1e-3)


@pytest.mark.slow(reason="a model with a beam of its own")
@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
def test_regression_friction_with_fast_modes(rtol):
    """A flexible link in quick_return: the energy was off by 59 % at 1e-3."""
    solution = bd.simulate(with_flexible_link(), bd.Ida(rtol), 3.0)
    assert solution.integrator["error_control"] == "rigid velocities"
    assert solution.quality.energy_imbalance < 100.0 * rtol
    assert solution.quality.max_residual < 0.02


def with_flexible_link():
    """quick_return with a steel strip as its link."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ground, center, pin = mech.ground, (0.0, 0.3), (0.0, 0.42)
    crank = mech.add(bd.RigidBody.disk("crank", center, radius=0.15, mass=12.0))
    block = mech.add(bd.RigidBody.plate("block", pin, width=0.04, height=0.06, mass=0.8))
    lever = mech.add(bd.RigidBody.rod("lever", (0.0, 0.0), (0.0, 0.6), mass=6.0))
    strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.01, damping=1e-4)
    link = mech.add(bd.Beam("link", bd.Line((0.0, 0.6), (0.25, 0.65)), strip, elements=2))
    ram = mech.add(bd.RigidBody.plate("ram", (0.45, 0.65), width=0.4, height=0.08, mass=25.0))
    shaft = (ground.at(*center), crank.at(*center))
    mech.add(bd.Revolute("crank bearing", *shaft))
    mech.add(bd.Driver("motor", *shaft, bd.run_up(2.0 * np.pi, 0.5)))
    mech.add(bd.Revolute("crank pin", crank.at(*pin), block.at(*pin)))
    mech.add(bd.Prismatic("slot", lever.at(0.0, 0.0), block.at(*pin), (0.0, 1.0)))
    mech.add(bd.Revolute("lever bearing", ground.at(0.0, 0.0), lever.at(0.0, 0.0)))
    mech.add(bd.Revolute("lever pin", lever.at(0.0, 0.6), link.start))
    mech.add(bd.Revolute("ram pin", link.end, ram.at(0.25, 0.65)))
    guide = mech.add(bd.Prismatic("guide", ground.at(0.0, 0.65), ram.at(0.45, 0.65)))
    rubs = {"friction_speed": 0.02, "radius": 0.2, "smoothing": 1.0}
    mech.add(bd.Friction("rubbing", guide, 0.1, **rubs))

    def cutting(tool, t):
        return -400.0 * (1.0 + np.tanh(tool.velocity[0] / 0.02)), 0.0

    mech.add(bd.ForceLaw("cutting", (ram.at(0.65, 0.61),), cutting))
    return mech


@pytest.mark.parametrize(
    ("formulation", "rtol"), [("index2", 1e-3), pytest.param("index1", 1e-8, marks=slow)]
)
def test_regression_the_reaction_of_a_driven_nonholonomic_row(formulation, rtol):
    """A pull of 30 N was off by 12 and 15 N where Newton's iteration ended at once."""
    solution = bd.simulate(pulled_body(), bd.Ida(rtol, formulation=formulation), 2.0, 0.25)
    # Bound on the error of the iteration: a thousandth of the force.
    bound = 1e-3 * PULLED_MASS * GRAVITY
    assert_allclose(solution.lam[:, 0], pull_of(solution.t), rtol=0.0, atol=bound)


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize(
    "integrator",
    [bd.GeneralizedAlpha, *(pytest.param(x, marks=slow) for x in (bd.Ida, bd.Radau))],
)
def test_regression_tolerances_do_not_grow_with_rotations(integrator):
    """Ten turns of the rotor: its weights were off by 800 rtol, and after 20 by 1700 rtol."""
    rtol = 1e-4
    exact, solution = (
        bd.simulate(governor, settings, 1.0, 0.01)
        for settings in (bd.Radau(1e-7), integrator(rtol=rtol))
    )
    lengths = [k for k, c in enumerate(exact.equations.coordinates) if c.unit == "m"]
    moves = [k for k in lengths if np.ptp(exact.q[:, k]) > 1e-3]
    error = np.max(np.abs(solution.q - exact.q)[:, moves], axis=0)
    assert np.max(error / (0.5 * np.ptp(exact.q[:, moves], axis=0))) < 100.0 * rtol


@pytest.mark.parametrize("formulation", ["stabilized-index1", pytest.param("ggl", marks=slow)])
def test_regression_rotation_errors_do_not_move_slow_parts(formulation):
    """Half of the correction went to the frame: every fifth step was rejected.

    In ring_mount that was every single one, at order 1.
    """
    mech = bd.Mechanism()
    frame = mech.add(bd.RigidBody.disk("frame", (0.0, 0.0), radius=0.1, mass=3.0))
    rotor = mech.add(bd.RigidBody("rotor", 0.4, inertia=2e-4, center=(5e-3, 0.0)))
    feet = {"kx": 6e4, "ky": 3e4, "ktheta": 4e3, "cx": 60.0, "cy": 40.0, "ctheta": 5.0}
    mech.add(bd.Bushing("feet", mech.ground.at(0.0, 0.0), frame.at(0.0, 0.0), **feet))
    hub = (frame.at(0.0, 0.0), rotor.at(0.0, 0.0))
    mech.add(bd.Revolute("bearing", *hub))
    mech.add(bd.Driver("drive", *hub, bd.run_up(200.0, 0.2)))
    counts = bd.simulate(mech, bd.Ida(1e-3, formulation=formulation), 0.6).statistics
    assert counts.rejected_steps < 0.05 * counts.steps
    assert counts.jacobian_calls < 0.1 * counts.steps


def test_regression_last_step_is_not_very_short():
    """A last step of 1e-4 of the one before left the reaction off by a fifth of its size."""
    model = knife_edge()
    for rtol in np.geomspace(1e-5, 1e-3, 9):
        solution = bd.simulate(model, bd.Ida(rtol, formulation="index2"), 4.0)
        steps = np.diff(solution.trajectory.intervals[-1].t)
        # The controller may shorten a step; the next step may then be as long as max_step.
        assert steps[-1] > 0.25 * steps[-2]
