"""Singular positions of closed loops are found, with and without a change of branch."""

import numpy as np
import pytest
from mechanisms import rectangle
from slider_crank import slider_crank

import beamdae as bd
from beamdae.equations.equations_of_motion import State
from beamdae.equations.starts.dependent_constraints import (
    build_constraint_jacobian,
    has_closed_loops,
)
from beamdae.results.singular_positions import (
    find_singular_positions,
    singularity_warnings,
)
from beamdae.results.trajectory import Interval, Trajectory

SPEED = 6.0
# The cranks start upright. They are on the line of their pivots after a quarter of a turn, and
# after every half turn from then on.
FIRST, HALF_TURN = 0.5 * np.pi / SPEED, np.pi / SPEED


def rhombus(longer=0.0, floats=False, **settings):
    """Return a rhombus of bars of 1 m whose cranks rotate at a constant speed, without gravity.

    Its base is the ground, or a heavy body that floats.
    """
    mech = bd.Mechanism(**settings)
    base = mech.add(bd.RigidBody("base", 1e9, 1e9)) if floats else mech.ground
    bars = [((0.0, 0.0), (0.0, 1.0)), ((1.0, 0.0), (1.0, 1.0 + longer))]
    cranks = []
    for k, (pivot, tip) in enumerate(bars):
        arm = np.subtract(tip, pivot) / 2.0
        center, velocity = tuple(pivot + arm), (-SPEED * arm[1], SPEED * arm[0])
        body = bd.RigidBody(f"crank {k}", 1.0, 0.1, center, velocity, SPEED)
        cranks.append(mech.add(body))
        mech.add(bd.Revolute(f"pivot {k}", base.at(*pivot), body.at(*pivot)))
    middle = (0.5, 1.0 + longer / 2.0)
    coupler = mech.add(bd.RigidBody("coupler", 1.0, 0.1, middle, (-SPEED, 0.0)))
    for crank, (_, tip) in zip(cranks, bars, strict=True):
        mech.add(bd.Revolute(f"{crank.name} tip", crank.at(*tip), coupler.at(*tip)))
    return mech


def prescribed_trajectory(mech, motion, t_end, steps=5000):
    """Return equations and the trajectory of a motion(body name, t) -> (x, y, angle)."""
    equations = bd.equations_of_motion(mech)
    t = np.linspace(0.0, t_end, steps)
    q = np.concatenate([motion(name, t) for name in ("crank 0", "crank 1", "coupler")], axis=1)
    v = np.gradient(q, t, axis=0)
    a = np.gradient(v, t, axis=0)
    lam = np.zeros((steps, equations.m))
    return equations, Trajectory((Interval(t, State(q, v, a, lam), 0.5 * t_end),))


def rotated_bar(pivot, arm, angle):
    """Return center and angle of a bar that rotates about a pivot, upright at angle 0."""
    return np.stack([pivot[0] - arm * np.sin(angle), pivot[1] + arm * np.cos(angle), angle], -1)


def motion_on(branch):
    """Return a motion that stays straight or folds at the first singular position."""

    def motion(name, t):
        angle = SPEED * t
        folded = (t > FIRST) & (branch == "folded")
        if name == "crank 0":
            return rotated_bar((0.0, 0.0), 0.5, angle)
        if name == "crank 1":
            return rotated_bar((1.0, 0.0), 0.5, np.where(folded, 0.5 * np.pi, angle))
        translated = np.stack([0.5 - np.sin(angle), np.cos(angle), 0.0 * t], axis=-1)
        # Its right end is on the pivot of crank 0, and it rotates with that crank.
        folded_coupler = rotated_bar((0.0, 0.0), 0.5, angle) - [0.0, 0.0, 0.5 * np.pi]
        return np.where(folded[:, None], folded_coupler, translated)

    return motion


def test_positions_are_found_on_both_branches():
    mech = rhombus()
    (passed_position,) = find_singular_positions(
        *prescribed_trajectory(mech, motion_on("straight"), FIRST + 0.2)
    )
    assert passed_position.t == pytest.approx(FIRST, abs=1e-3)
    assert set(passed_position.joints) == {"pivot 0", "pivot 1", "crank 0 tip", "crank 1 tip"}
    (left_branch, *_) = find_singular_positions(
        *prescribed_trajectory(mech, motion_on("folded"), FIRST + 0.2)
    )
    (warning,) = singularity_warnings((left_branch,))
    assert "lose rank near t = 0.26" in warning


@pytest.mark.parametrize("floats", [False, True])
def test_singular_positions_are_reported_with_time_and_joints(floats):
    mech = rhombus(floats=floats)
    with pytest.warns(
        bd.BeamdaeWarning, match=r"pivot 0, .* lose rank near t = 0\.26.*the motion may branch"
    ):
        solution = bd.simulate(mech, bd.Radau(rtol=1e-6), t_end=FIRST + 1.5 * HALF_TURN)
    assert solution.status.success
    times = [position.t for position in solution.singular_positions]
    # At this tolerance, the run and the samples have errors of at most 1e-4.
    np.testing.assert_allclose(times, [FIRST, FIRST + HALF_TURN], atol=1e-3)
    assert len(solution.warnings) == 1


@pytest.mark.slow(reason="a fifth of a second")
def test_redundant_constraints_do_not_hide_singular_positions():
    """A third crank in the middle makes one constraint redundant in every position."""
    mech = rhombus(redundant="minimum norm")
    coupler = mech.part("coupler")
    middle = bd.RigidBody("crank 2", 1.0, 0.1, (0.5, 0.5), (-0.5 * SPEED, 0.0), SPEED)
    mech.add(middle)
    mech.add(bd.Revolute("pivot 2", mech.ground.at(0.5, 0.0), middle.at(0.5, 0.0)))
    mech.add(bd.Revolute("crank 2 tip", middle.at(0.5, 1.0), coupler.at(0.5, 1.0)))
    with pytest.warns(bd.BeamdaeWarning, match=r"pivot .* lose rank near t = 0\.26"):
        solution = bd.simulate(mech, bd.Radau(rtol=1e-6), t_end=2.0 * FIRST)
    assert solution.status.success
    (position,) = solution.singular_positions
    assert position.t == pytest.approx(FIRST, abs=1e-3)
    # A redundant constraint alone is not a singular position.
    assert bd.simulate(mech, bd.Radau(rtol=1e-6), t_end=0.9 * FIRST).singular_positions == ()


@pytest.mark.slow(reason="a fifth of a second")
def test_switched_parts_do_not_hide_singular_positions():
    """A brake is active for some time between the first and the second of them."""
    mech = rhombus()
    wheel = mech.part("crank 0")
    spring = mech.add(bd.TorsionSpring("brake", mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0), 1e-3))
    mech.deactivate(spring)
    mech.observe("crank", wheel.at(0.0, 0.0))
    for angle, do in ((2.5, bd.activate(spring)), (3.5, bd.deactivate(spring))):
        mech.when("crank.angle", crosses=angle, do=[do])
    with pytest.warns(bd.BeamdaeWarning, match=r"lose rank near t = 0\.26.*and at 1 later"):
        solution = bd.simulate(mech, bd.Radau(rtol=1e-6), t_end=FIRST + 1.5 * HALF_TURN)
    assert len(solution.event_records) == 2
    times = [position.t for position in solution.singular_positions]
    np.testing.assert_allclose(times, [FIRST, FIRST + HALF_TURN], atol=1e-3)


@pytest.mark.parametrize("longer", [1e-3, 0.05])
def test_near_singular_positions_are_not_reported(longer):
    solution = bd.simulate(rhombus(longer), bd.Radau(rtol=1e-4), t_end=2.0 * FIRST)
    assert has_closed_loops(solution.equations)
    assert solution.singular_positions == ()


def test_regular_loops_are_not_reported():
    solution = bd.simulate(slider_crank(elements=2), bd.GeneralizedAlpha(step=0.01), t_end=2.5)
    assert has_closed_loops(solution.equations)
    assert solution.singular_positions == ()


def test_open_chains_have_no_closed_loops():
    mech = bd.Mechanism()
    section = rectangle(0.01, 0.1, material=bd.Material(E=1e7, nu=0.3, rho=1e3))
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    first, last = bd.welded_beams(mech, "beam", line, section, bodies=2, elements=1)
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), first.start))
    equations = bd.equations_of_motion(mech)
    assert not has_closed_loops(equations)
    mech.add(bd.PointOnLine("guide", mech.ground.at(1.0, 0.0), last.end))
    assert has_closed_loops(bd.equations_of_motion(mech))


def test_smallest_singular_values_of_the_constraint_jacobian():
    equations = bd.equations_of_motion(rhombus())
    matrix = build_constraint_jacobian(equations)
    q = equations.q0[None]
    assert matrix.scaled(np.zeros((1, 2)), q)[0].shape == (1, equations.m, equations.n)
    straight = motion_on("straight")
    t = np.array([FIRST])
    flat = np.concatenate([straight(name, t) for name in ("crank 0", "crank 1", "coupler")], axis=1)
    upright, singular = matrix.smallest_singular_values(np.zeros((2, 2)), np.concatenate([q, flat]))
    # The squares of singular values have a rounding error of 1e-16.
    assert singular < 1e-7 < 0.1 < upright


def test_regression_singular_values_interpolate_positions_only(monkeypatch):
    """Velocities, accelerations and multipliers took half of the time of this check."""
    equations, trajectory = prescribed_trajectory(rhombus(), motion_on("straight"), 0.1)
    monkeypatch.setattr(Interval, "at", None)
    assert find_singular_positions(equations, trajectory) == ()
