"""Reactions at change points, of prescribed motions, and outside the error test of Ida."""

import numpy as np
import pytest
from benchmarks.systems import knife_edge
from governor import governor
from mechanisms import EARTH, driven_slide, reaction_of_driven_slide, rectangle
from numpy.testing import assert_allclose
from parts.test_user_joints import GRAVITY, PULLED_MASS, pull_of, pulled_body
from quick_return import quick_return
from scipy.integrate import solve_ivp

import beamdae as bd

LENGTH, COUPLER, WEIGHT, SPEED, ANGLE = 0.2, 2.0, 9.81, 6.0, 0.5


def parallelogram(masses=(0.5, 0.5), redundant="refuse"):
    """Return parallel cranks on a coupler of 2 kg; the first one starts with 6 rad/s."""
    mech = bd.Mechanism(gravity=(0.0, -WEIGHT), redundant=redundant)
    arm = LENGTH * np.array([np.cos(ANGLE), np.sin(ANGLE)])

    def at(x, tip=0.0):
        return tuple(np.array([x, 0.0]) + tip * arm)

    coupler = mech.add(bd.RigidBody.rod("coupler", at(0.0, 1.0), at(0.4, 1.0), mass=COUPLER))
    for k, x in enumerate(np.linspace(0.0, 0.4, len(masses))):
        speed = None if k else SPEED
        ends = at(x), at(x, 1.0)
        crank = mech.add(
            bd.RigidBody.rod(f"crank {k}", *ends, mass=masses[k], angular_velocity=speed)
        )
        foot = mech.add(bd.Revolute(f"foot {k}", mech.ground.at(*ends[0]), crank.at(*ends[0])))
        mech.add(bd.Revolute(f"head {k}", crank.at(*ends[1]), coupler.at(*ends[1])))
        mech.observe(f"foot {k}", foot.reaction)
    return mech


def motion(masses, t):
    """Return angle, its rate and its acceleration of the cranks, which stay parallel."""
    total = sum(masses)
    pull = WEIGHT * (total / 2.0 + COUPLER) / ((total / 3.0 + COUPLER) * LENGTH)
    run = solve_ivp(
        lambda _, y: [y[1], -pull * np.cos(y[0])],
        (0.0, t[-1]),
        [ANGLE, SPEED],
        method="DOP853",
        rtol=1e-12,
        atol=1e-12,
        t_eval=t,
    )
    return *run.y, -pull * np.cos(run.y[0])


def horizontal_force(masses, t):
    """Return the sum of the horizontal reactions of all feet: the rate of the momentum."""
    angle, rate, acceleration = motion(masses, t)
    of_tip = -LENGTH * (rate**2 * np.cos(angle) + acceleration * np.sin(angle))
    return (sum(masses) / 2.0 + COUPLER) * of_tip


def error(actual, expected):
    """Return the largest error, relative to half the range."""
    return np.max(np.abs(actual - expected)) / (np.ptp(expected) / 2.0)


METHODS = [
    bd.Auto(),
    bd.Ida(1e-3),
    bd.Ida(1e-5),
    bd.Ida(1e-5, formulation="ggl"),
    bd.Radau(1e-4),
    bd.GeneralizedAlpha(1e-3),
]


@pytest.mark.slow(reason="runs of several methods")
@pytest.mark.parametrize("method", METHODS, ids=str)
def test_reactions_of_equal_cranks(method):
    run = bd.simulate(parallelogram(), method, t_end=3.0)
    expected = horizontal_force((0.5, 0.5), run.t) / 2.0
    for k in (0, 1):
        assert error(run[f"foot {k}.Fx"], expected) < 0.01


@pytest.mark.slow(reason="two runs")
@pytest.mark.parametrize("method", [bd.Ida(1e-5), bd.Radau(1e-5)], ids=str)
def test_reactions_of_a_redundant_crank(method):
    masses = (0.5, 0.5, 0.5)
    run = bd.simulate(parallelogram(masses, redundant="minimum norm"), method, t_end=1.5)
    feet = [run[f"foot {k}.Fx"].to_numpy() for k in range(3)]
    assert error(sum(feet), horizontal_force(masses, run.t)) < 0.01
    # By symmetry.
    assert np.abs(feet[0] - feet[2]).max() < 0.01 * np.ptp(feet[0])


@pytest.mark.slow(reason="two runs")
@pytest.mark.parametrize("method", [bd.Auto(1e-4), bd.Radau(1e-5)], ids=str)
def test_unbounded_reactions_are_not_a_number(method):
    """At change points, only infinite forces keep gravity from turning unequal cranks apart."""
    masses = (0.5, 0.8)
    run = bd.simulate(parallelogram(masses), method, t_end=3.0)
    angle, rate, acceleration = motion(masses, run.t)
    # Numbers of steps between rows and the nearest change point, where sin(angle) is zero.
    steps = run.trajectory.intervals[0].t
    turns = np.diff(np.floor(motion(masses, steps)[0] / np.pi))
    change_points = np.flatnonzero(turns)
    rows = np.searchsorted(steps, run.t)
    distance = np.abs(rows[:, None] - change_points).min(axis=1)
    tip_x = -LENGTH * (rate**2 * np.cos(angle) + acceleration * np.sin(angle))
    tip_y = LENGTH * (acceleration * np.cos(angle) - rate**2 * np.sin(angle))
    head_y = -COUPLER * (tip_y + WEIGHT) / 2.0
    for k, mass in enumerate(masses):
        torque = mass * LENGTH * (LENGTH / 3.0 * acceleration + WEIGHT / 2.0 * np.cos(angle))
        head_x = (np.cos(angle) * head_y - torque / LENGTH) / np.sin(angle)
        expected, actual = mass * tip_x / 2.0 - head_x, run[f"foot {k}.Fx"].to_numpy()
        is_number = np.isfinite(actual)
        assert 0 < np.sum(~is_number) < 0.1 * len(actual)
        # Polynomials through the three steps on each side have up to five steps.
        assert np.all((np.abs(np.sin(angle)) < 0.2) | (distance <= 6) | is_number)
        size = np.maximum(np.abs(expected), np.ptp(expected[np.abs(np.sin(angle)) > 0.2]) / 2.0)
        assert np.max(np.abs(actual - expected)[is_number] / size[is_number]) < 0.01
        assert f"foot {k}.Fx" not in run.step_extremes
    (warning,) = (x for x in run.warnings if "grow without bounds" in x)
    assert warning.startswith("foot 0, head 0, foot 1, head 1: ")
    assert not any("not finite" in x or "residual" in x for x in run.warnings)


@pytest.mark.slow(reason="a run")
def test_unbounded_reactions_have_no_maximum():
    @bd.model(t_end=1.0)
    def unequal(mass=0.8):
        return parallelogram((0.5, mass))

    limit = bd.quantities.at_most(bd.quantities.SmoothMaximum("foot 0.Fx"), 100.0)
    with pytest.raises(bd.BeamdaeError, match=r"SmoothMaximum of foot 0\.Fx of unequal is nan"):
        bd.optimize(
            unequal, bd.quantities.Mass(), "mass", limit, {"mass": (0.6, 1.0)}, bd.Radau(1e-5)
        )


@pytest.mark.slow(reason="two fits")
def test_fits_leave_out_unbounded_reactions():
    """The estimate follows from the other data, whatever is recorded where forces are infinite."""

    @bd.model(t_end=1.0)
    def unequal(mass=0.8):
        return parallelogram((0.5, mass))

    column, method = "foot 0.Fx [N]", bd.GeneralizedAlpha(2e-3)
    run = bd.simulate(unequal(), method, t_end=1.0, output_step=0.01).table()
    is_unbounded = run[column].isna().to_numpy()
    assert 0 < is_unbounded.sum() < 0.2 * len(run)
    data = run[["t [s]", column]].fillna(1e3)
    fit = bd.fit(unequal, data, "mass", method, parameters={"mass": 0.79})
    assert fit.parameters["mass"] == pytest.approx(0.8, rel=1e-4)
    left_out = fit.residuals == 0.0
    assert left_out.any()
    # Rows beside the singular positions may have a value in one of both runs only.
    assert not np.any(left_out & ~is_unbounded)


# Reactions of mechanisms whose motion joints and drivers prescribe.


def simulate(mech, method, t_end=1.0):
    run = bd.simulate(mech, method, t_end)
    return run, [x for x in run.warnings if x.startswith("drive.F: the error")]


def relative_error(run, **motion):
    exact = reaction_of_driven_slide(run.t, **motion)
    return np.max(np.abs(run["drive.F"].to_numpy() - exact)) / (0.5 * np.ptp(exact))


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("speed", [0.1, 0.01, 1e-3])
def test_regression_reactions_of_driven_mechanisms_are_resolved_by_radau(speed, rtol):
    """The reaction was wrong by 69 % of half its range at rtol = 1e-5, without a warning."""
    run, found = simulate(driven_slide(speed=speed), bd.Radau(rtol))
    assert relative_error(run, speed=speed) < 100.0 * rtol
    assert found == []


def test_regression_reactions_of_driven_mechanisms_have_a_warning_with_fixed_steps():
    """Torques of a press were 136 % too large with steps of 1 ms, without a warning."""
    run, found = simulate(driven_slide(), bd.GeneralizedAlpha(1e-2))
    assert relative_error(run) > 0.1
    (sentence,) = found
    assert sentence.startswith("drive.F: the error is ")
    assert "use step=" in sentence


@pytest.mark.slow(reason="half a second")
def test_accurate_reactions_of_driven_mechanisms_have_no_warning():
    smooth = {"speed": 1.0}
    for method in (bd.GeneralizedAlpha(1e-3), bd.Radau(1e-3), bd.Radau(), bd.Ida()):
        run, found = simulate(driven_slide(**smooth), method)
        assert relative_error(run, **smooth) < 0.01
        assert found == []


def test_jumps_of_reactions_of_driven_mechanisms_do_not_stop_radau():
    mech = driven_slide(speed=1e-9)
    run, _ = simulate(mech, bd.Radau(1e-8))
    assert run.status.kind == "ok"
    assert (
        np.median(np.abs(run["drive.F"].to_numpy() - reaction_of_driven_slide(run.t, speed=1e-9)))
        < 1.0
    )


@pytest.mark.slow(reason="half a second")
def test_regression_reactions_of_driven_mechanisms_have_accurate_derivatives():
    """Derivatives of a reaction with respect to the scale of the force were wrong by 28 %."""

    @bd.model(t_end=1.0)
    def slide(scale=1.0):
        return driven_slide(scale=scale)

    result = bd.sensitivities(slide, "scale")
    exact = reaction_of_driven_slide(result.t) - reaction_of_driven_slide(result.t, force=0.0)
    error = np.abs(result.sensitivity("drive.F", "scale").to_numpy() - exact)
    assert np.max(error) < 1e-3 * 0.5 * np.ptp(exact)


@pytest.mark.parametrize("method", [bd.Ida, bd.Radau])
@pytest.mark.parametrize("time_constant", [1e-2, 1e-4, 1e-6, 1e-1])
def test_regression_reactions_of_driven_mechanisms_with_filters_are_resolved(time_constant, method):
    """The reaction was wrong by up to 95 % of half its range.

    Short steps at peaks of rates of fast states were repeated without end.
    """
    mech = driven_slide(filter_time=time_constant)
    run, found = simulate(mech, method(1e-5))
    assert run.status.kind == "ok"
    assert relative_error(run) < 1e-3
    assert found == []


@pytest.mark.parametrize("time_constant", [None, 1e-3])
@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
@pytest.mark.parametrize("speed", [0.1, 0.01, 1e-3])
def test_regression_reactions_are_resolved_by_generalized_alpha(speed, rtol, time_constant):
    """The reaction was wrong by 5 to 87 % of half its range with adaptive steps, with a warning."""
    mech = driven_slide(speed=speed, filter_time=time_constant)
    run, found = simulate(mech, bd.GeneralizedAlpha(rtol=rtol))
    assert run.status.kind == "ok"
    assert relative_error(run, speed=speed) < 100.0 * rtol
    assert found == []


# Ida: reactions outside the error test, and position corrections of nearly fixed parts.

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
    mech = bd.Mechanism(gravity=EARTH)
    ground, center, pin = mech.ground, (0.0, 0.3), (0.0, 0.42)
    crank = mech.add(bd.RigidBody.disk("crank", center, radius=0.15, mass=12.0))
    block = mech.add(bd.RigidBody.plate("block", pin, width=0.04, height=0.06, mass=0.8))
    lever = mech.add(bd.RigidBody.rod("lever", (0.0, 0.0), (0.0, 0.6), mass=6.0))
    strip = rectangle(0.01, damping=1e-4)
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
