"""Reactions of motions through change points, at which the constraints lose rank."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import beamdae as bd

LENGTH, COUPLER, GRAVITY, SPEED, ANGLE = 0.2, 2.0, 9.81, 6.0, 0.5


def parallelogram(masses=(0.5, 0.5), redundant="refuse"):
    """Return parallel cranks on a coupler of 2 kg; the first one starts with 6 rad/s."""
    mech = bd.Mechanism(gravity=(0.0, -GRAVITY), redundant=redundant)
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
    pull = GRAVITY * (total / 2.0 + COUPLER) / ((total / 3.0 + COUPLER) * LENGTH)
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
    head_y = -COUPLER * (tip_y + GRAVITY) / 2.0
    for k, mass in enumerate(masses):
        torque = mass * LENGTH * (LENGTH / 3.0 * acceleration + GRAVITY / 2.0 * np.cos(angle))
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
