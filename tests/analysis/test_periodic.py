"""Periodic motions, Floquet multipliers and response curves against independent solutions."""

import casadi as ca
import numpy as np
import pytest
from conformance import tuned
from mechanisms import ALLOY, EARTH, clamped_beam, driven, driven_blade, mass_on_rail, rectangle
from scipy.optimize import fsolve

import beamdae as bd
from beamdae.results.periodic_motion import PeriodicMotion

MASS, STIFFNESS, DAMPING = 2.0, 18.0, 1.0


def oscillator(load, cubic=0.0, stiffness=STIFFNESS, damping=DAMPING):
    """Return a mass on a rail with a spring and a damper."""
    mech, mass = mass_on_rail(MASS, 1.0)

    def pull(x, rate):
        return stiffness * x + cubic * x**3 + damping * rate

    # The spring is anchored far away, since its direction reverses at the anchor.
    mech.add(bd.Spring("spring", mech.ground.at(-9.0, 0.0), mass.point, law=pull))
    mech.add(bd.Force("load", mass.point, (load, 0.0)))
    mech.observe("mass", mass.point)
    return mech


def assert_same_multipliers(actual, expected, atol):
    np.testing.assert_allclose(
        np.sort_complex(np.round(actual, 12)), np.sort_complex(expected), rtol=0.0, atol=atol
    )


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("frequency", [0.2, 3.0])
def test_damped_oscillator_under_a_sine(frequency):
    motion = bd.periodic(oscillator(bd.sine(1.0, frequency)), 1.0 / frequency)
    omega = 2.0 * np.pi * frequency
    amplitude = 1.0 / np.hypot(STIFFNESS - MASS * omega**2, DAMPING * omega)
    assert motion.status.success
    assert motion.stable
    row = motion.amplitudes().loc["mass.x [m]"]
    # The accuracy of parabolas through 200 samples of a period.
    assert row["half range"] == pytest.approx(amplitude, rel=2e-6)
    assert row["mean"] == pytest.approx(1.0, abs=1e-6 * amplitude)
    rate = 0.5 * DAMPING / MASS
    multiplier = np.exp((-rate + 1j * np.sqrt(STIFFNESS / MASS - rate**2)) / frequency)
    assert_same_multipliers(motion.multipliers, [multiplier, multiplier.conj()], 1e-7)


def mathieu(a, q, damping=0.0):
    """Return the system x'' + damping x' + (a - 2 q cos 2 t) x = 0, at rest at x = 0."""
    t, x, v = (ca.SX.sym(name) for name in "txv")
    force = -(a - 2.0 * q * ca.cos(2.0 * t)) * x - damping * v
    return bd.ConstrainedSystem(t, x, v, mass=[1.0], force=force, q0=[0.0], v0=[0.0])


@pytest.mark.slow(reason="a quarter of a second")
def test_mathieu_equation_inside_its_stability_regions():
    # Below the first region of stability, between it and the second, and inside both.
    expected = {-0.5: "keep their sign", 1.0: "double", 0.5: "stable", 2.5: "stable"}
    for value, word in expected.items():
        assert word in bd.periodic(mathieu(value, 0.6), np.pi).stability


@pytest.mark.parametrize("name", ["ida", "radau", "alpha", "alpha adaptive"])
def test_all_integrators_agree(name):
    integrator = tuned(1e-7, 2e-3)[name]
    motion = bd.periodic(mathieu(1.7, 0.6, 0.1), np.pi, integrator)
    # Runs with adaptive steps are those of Radau.
    method = bd.GeneralizedAlpha if name == "alpha" else bd.Radau
    assert isinstance(motion.solution.made_by, method)
    # Liouville: damping determines the product of all multipliers.
    assert np.prod(motion.multipliers).real == pytest.approx(np.exp(-0.1 * np.pi), rel=1e-5)
    assert motion.multipliers[0].real == pytest.approx(-0.7095668, abs=1e-5)


@pytest.mark.slow(reason="a fifth of a second")
def test_invalid_arguments_are_rejected():
    oscillation = oscillator(bd.sine(1.0, 0.5))
    with pytest.raises(
        bd.BeamdaeError,
        match=r"^mass\S*: loads or drivers do not repeat after the period of 3 s",
    ):
        bd.periodic(oscillation, 3.0)
    # It never repeats, except after no time.
    with pytest.raises(
        bd.BeamdaeError,
        match=r"pass their period with period=, or t_start= from which on they repeat\.$",
    ):
        bd.periodic(oscillator(lambda t: t), 1.0)
    # Within these periods, a cosine changes by less than rounding errors.
    for period in (1e-6, 1e-9, 1e-12):
        with pytest.raises(bd.BeamdaeError, match=f"after the period of {period:g} s, they differ"):
            bd.periodic(oscillator(bd.sine(1.0, 1.0, phase=0.5 * np.pi)), period)
    oscillation.when("mass.x", crosses=1.0, do="stop")
    with pytest.raises(bd.BeamdaeError, match="inactive parts, impacts and events that stop a run"):
        bd.periodic(oscillation, 2.0)
    with pytest.raises(bd.BeamdaeError, match="model must be a model function"):
        bd.frequency_response(oscillation, "omega", (1.0, 2.0))
    with pytest.raises(bd.BeamdaeError, match="parameter names 'speed', which is not a numeric"):
        bd.frequency_response(duffing, "speed", (1.0, 2.0))
    with pytest.raises(bd.BeamdaeError, match="must be two different values"):
        bd.frequency_response(duffing, "omega", (1.0, 1.0))


@pytest.mark.parametrize(
    ("damping", "ratio", "load", "accuracy"),
    [
        (1e-4, 1.0, 1.0, 3e-6),
        (1e-6, 1.0, 1.0, 1e-4),
        (0.0, 1.0001, 1.0, 3e-5),
        (1e-2, 1.0, 1e3, 1e-6),
    ],
)
def test_regression_amplitudes_far_beyond_the_size_are_found(damping, ratio, load, accuracy):
    """Corrections of at most 3 times the size of the model failed after 25 iterations."""
    t, x, v = (ca.SX.sym(name) for name in "txv")
    force = load * ca.sin(ratio * t) - 2.0 * damping * v - x
    system = bd.ConstrainedSystem(t, x, v, mass=[1.0], force=force, q0=[0.0], v0=[0.0])
    motion = bd.periodic(system, 2.0 * np.pi / ratio)
    assert motion.status.success
    assert motion.stable
    amplitude = load / abs(1.0 - ratio**2 + 2.0j * damping * ratio)
    half = 0.5 * np.ptp(motion.solution.trajectory.intervals[0].state.q[:, 0])
    assert half == pytest.approx(amplitude, rel=accuracy)


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_columns_of_a_periodic_motion_are_selected_as_those_of_a_run():
    motion = bd.periodic(oscillator(bd.sine(1.0, 0.2)), 5.0, bd.Radau(1e-4))
    assert motion["mass.x"].equals(motion.solution["mass.x"])
    assert "mass.x" in motion
    assert "mass.z" not in motion


@pytest.mark.slow(reason="half a second and more")
def test_failed_search_is_a_result_with_a_reason():
    # Undamped at resonance, the amplitude grows without bound.
    resonant = oscillator(bd.sine(1.0, 3.0 / (2.0 * np.pi)), damping=0.0)
    message = r"differs from the start by .* or add damping, such as damping="
    with pytest.warns(bd.BeamdaeWarning, match=message):
        motion = bd.periodic(resonant, 2.0 * np.pi / 3.0, bd.Radau(1e-4), settle=0)
    assert motion.status.kind == "failed"
    assert not motion.stable
    assert motion.stability.startswith("not known: after")
    with pytest.warns(bd.BeamdaeWarning, match="run to settle was not finished"):
        motion = bd.periodic(oscillator(bd.sine(1.0, 0.5)), 2.0, bd.Radau(1e-8, max_steps=5))
    assert not motion.multipliers.size
    assert len(motion.amplitudes()) == len(motion.solution.columns)
    with pytest.warns(bd.BeamdaeWarning, match="omega = 1: .*not finished"):
        response = bd.frequency_response(
            duffing, "omega", (1.0, 2.0), lambda omega: 2.0 * np.pi / omega, bd.Ida(max_steps=5)
        )
    assert (response.points, response.folds, response.peaks("mass.x [m]")) == ((), [], [])
    assert response.table().empty
    with pytest.raises(bd.BeamdaeError, match=r"^plot: there is nothing to draw in .*failed"):
        response.plot("mass.x [m]")


@bd.model(t_end=1.0)
def duffing(omega=1.0):
    """Return the Duffing oscillator M x'' + M 0.1 x' + M x + M 0.5 x^3 = M 0.3 sin omega t."""
    load = bd.sine(0.3 * MASS, omega / (2.0 * np.pi))
    return oscillator(load, 0.5 * MASS, MASS, 0.1 * MASS)


# Spectral differentiation matrix of an odd number of samples over a period.
SAMPLES = 67
_K = np.arange(SAMPLES)[:, None] - np.arange(SAMPLES)
RATE = np.where(_K == 0, 0.0, 0.5 * (-1.0) ** _K / np.sin(np.pi * _K / SAMPLES + (_K == 0)))


def collocation(omega, x):
    """Return the residual of Duffing's equation at samples of a period, and its derivative."""
    linear = omega**2 * RATE @ RATE + 0.1 * omega * RATE + np.eye(SAMPLES)
    load = 0.3 * np.sin(2.0 * np.pi * np.arange(SAMPLES) / SAMPLES)
    return linear @ x + 0.5 * x**3 - load, linear + np.diag(1.5 * x**2)


def nearest_periodic_solution(omega, x):
    """Return (omega, samples) of the nearest periodic solution, also at folds."""
    z = np.append(x, omega)
    for _ in range(6):
        x, omega = z[:SAMPLES], z[SAMPLES]
        residual, slope = collocation(omega, x)
        by_omega = (2.0 * omega * RATE @ RATE + 0.1 * RATE) @ x
        z = z - np.linalg.lstsq(np.column_stack([slope, by_omega]), residual)[0]
    return z[SAMPLES], z[:SAMPLES]


def find_fold(omega, x):
    """Return the omega at which the derivative is singular, near a periodic solution."""

    def fold_equations(z):
        residual, slope = collocation(z[SAMPLES], z[:SAMPLES])
        null = z[SAMPLES + 1 :]
        return np.concatenate([residual, slope @ null, [null @ null - 1.0]])

    null = np.linalg.svd(collocation(omega, x)[1])[2][-1]
    return fsolve(fold_equations, np.concatenate([x, [omega], null]), xtol=1e-9)[SAMPLES]


def sample_motion(point):
    """Return samples over the period of a point of the curve."""
    t = point.period * np.arange(SAMPLES) / SAMPLES
    return point.solution.trajectory.at(t)[1].q[:, 0]


@pytest.mark.slow(reason="seconds")
@pytest.mark.parametrize(("position", "amplitude"), [(1.0, 0.273), (-1.0, 1.813)])
def test_start_decides_which_branch_is_followed(position, amplitude):
    response = bd.frequency_response(
        duffing,
        "omega",
        (1.45, 1.46),
        lambda omega: 2.0 * np.pi / omega,
        start={"mass.x": position},
        step=0.5,
        max_step=1.0,
    )
    assert response.status.success
    for point, size in zip(response.points, response.curve("mass.x")[1], strict=True):
        x = sample_motion(point) - 1.0
        _, expected = nearest_periodic_solution(point.parameter, x)
        np.testing.assert_allclose(x, expected, rtol=0.0, atol=1e-5)
        # By collocation at omega = 1.455, as 1.651 of the unstable branch.
        assert size == pytest.approx(amplitude, abs=0.02)


@pytest.mark.slow(reason="a hundred periodic motions")
def test_response_of_a_duffing_oscillator_passes_both_folds():
    response = bd.frequency_response(
        duffing, "omega", (1.0, 1.9), lambda omega: 2.0 * np.pi / omega, max_step=0.15
    )
    assert response.status.success
    # The branch between the folds is unstable, the others are stable.
    table = response.table()
    folds = np.flatnonzero(table["fold"])
    assert len(folds) == 2
    between = np.arange(len(table))
    between = (between >= folds[0]) & (between < folds[1])
    # At a fold a multiplier is 1.
    off_fold = np.abs(table["largest multiplier"] - 1.0) > 0.02
    assert np.array_equal(~table["stable"][off_fold], between[off_fold])
    for point in response.points[::5]:
        x = sample_motion(point) - 1.0
        omega, expected = nearest_periodic_solution(point.parameter, x)
        # The default tolerance of a period is 1e-6 of its amplitude.
        np.testing.assert_allclose(x, expected, rtol=0.0, atol=1e-5)
        assert omega == pytest.approx(point.parameter, abs=1e-5)
    assert response.peaks("mass.x") == response.peaks("mass.x [m]")
    lines = response.plot("mass.x").figure.axes[0].lines
    # Up to the first fold, between the folds, beyond the second one; and the peak.
    assert [line.get_linestyle() for line in lines] == ["-", "--", "-", "None"]
    (axis,) = response.plot("mass.x_dot", x="mass.x").figure.axes
    assert axis.get_xlabel() == "mass.x, half range [m]"
    np.testing.assert_array_equal(axis.lines[0].get_xdata(), lines[0].get_ydata())
    expected = [
        find_fold(response.points[k].parameter, sample_motion(response.points[k]) - 1.0)
        for k in folds
    ]
    np.testing.assert_allclose(response.folds, expected, rtol=1e-6)


# With this stiffness, vibrations are a thousand times as fast; the test takes ten seconds.
STIFF = pytest.param(1e6, marks=pytest.mark.slow(reason="thousands of vibrations in a period"))


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("size", [1e-6, STIFF])
def test_forces_of_any_size_are_checked(size):
    system = oscillator(bd.sine(size, 0.5), stiffness=size * STIFFNESS)
    with pytest.raises(bd.BeamdaeError, match="do not repeat after the period of 3 s"):
        bd.periodic(system, 3.0, settle=0)
    assert bd.periodic(system, 2.0, settle=0).status.success


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_the_mismatch_of_a_period_is_stated():
    """A period with six digits was rejected without the size of the difference, 2e-5 rad."""
    mech, crank = driven(bd.RigidBody("crank", 1.0, inertia=0.1), lambda t: 1.5 * np.pi * t)
    mech.observe("crank", crank.at(0.1, 0.0))
    message = (
        r"^motor\S*: loads or drivers do not repeat after the period of 1.33333 s, they differ by "
        r"1.57e-05 rad at t = .* s; pass their period with period="
    )
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.periodic(mech, 1.33333)
    assert bd.periodic(mech, 1.33333333).status.success


def message_about(law, period, monkeypatch):
    """Return the message about the period of a driver, without any run, or ""."""
    mech, crank = driven(bd.RigidBody("crank", 1.0, inertia=0.1), law)
    mech.observe("crank", crank.at(0.1, 0.0))

    def run(*_, **__):
        raise AssertionError("a run has begun")

    monkeypatch.setattr("beamdae.analysis.periodic.period_map.PeriodMap.run", run)
    try:
        bd.periodic(mech, period)
    except bd.BeamdaeError as problem:
        return str(problem)
    except AssertionError:
        return ""


@pytest.mark.parametrize(
    ("law", "period", "is_wrong"),
    [
        (lambda t: 4.0 * np.pi * t, 0.5, False),
        (lambda t: -4.0 * np.pi * t, 1.5, False),
        (lambda t: 4.0 * np.pi * t, 0.6, True),
        (lambda t: 0.1 * np.sin(4.0 * np.pi * t), 0.5, False),
        (lambda t: 0.1 * np.sin(4.0 * np.pi * t), 77.3, True),
        (lambda t: 4.0 * np.pi * t + 0.1 * np.sin(8.0 * np.pi * t), 0.5, False),
        (lambda t: 4.0 * np.pi * t + 0.1 * np.sin(9.0 * np.pi * t), 0.5, True),
        (bd.run_up(4.0 * np.pi, 0.2), 0.5, True),
    ],
)
def test_regression_wrong_periods_of_drivers_are_rejected_before_a_run(
    law, period, is_wrong, monkeypatch
):
    """A period in other units took minutes of steps before the message."""
    message = message_about(law, period, monkeypatch)
    assert message.startswith("motor: loads or drivers do not repeat") == is_wrong
    assert bool(message) == is_wrong


def test_regression_wrong_periods_of_loads_are_rejected_before_a_run(monkeypatch):
    monkeypatch.setattr("beamdae.analysis.periodic.period_map.PeriodMap.run", None)
    with pytest.raises(
        bd.BeamdaeError, match=r"^mass\S*: .* after the period of 120 s, they differ"
    ):
        bd.periodic(oscillator(bd.sine(1.0, 60.0 + 1.0 / 300.0)), 120.0)
    # A transient that has decayed, and a load that holds its last value.
    for law in (lambda t: np.exp(-50.0 * t), bd.piecewise((0.1, 1.0), 0.0)):
        with pytest.raises(TypeError, match="not callable"):
            bd.periodic(oscillator(law), 1.0, t_start=2.0)


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize(
    ("period", "message"),
    [
        (2.0, r"^motor: loads or drivers do not repeat after the period of 2 s"),
        (None, "^motor: loads or drivers depend on time; pass their period"),
    ],
)
def test_regression_loads_are_checked_although_the_first_period_cannot_be_run(period, message):
    """After settling, the driver of the next period starts half a turn away, and the run fails."""
    model = bd.load_model("example:slider_crank")
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.periodic(model(elements=2, speed=1.5), period, period_guess=None if period else 2.0)


def test_regression_half_turns_name_the_driver_and_the_angle():
    """Responses named a weld with a difference of "6.3 in SI units", and motions no period."""

    @bd.model(t_end=1.0)
    def rotor(speed=50.0):
        mech = bd.Mechanism()
        center = mech.ground.at(0.0, 0.0)
        hub = mech.add(bd.RigidBody.disk("hub", (0.0, 0.0), radius=0.1, mass=1.0))
        tip = mech.add(bd.RigidBody.disk("tip", (0.2, 0.0), radius=0.1, mass=1.0))
        mech.add(bd.Revolute("bearing", center, hub.at(0.0, 0.0)))
        mech.add(bd.Weld("clamp", hub.at(0.1, 0.0), tip.at(0.1, 0.0)))
        mech.add(bd.Driver("motor", center, hub.at(0.0, 0.0), lambda t: speed * t))
        mech.add(bd.Force("flow", tip.at(0.2, 0.0), (0.0, bd.sine(0.05, speed / np.pi))))
        return mech

    message = (
        r"^motor: loads or drivers do not repeat after the period of 0\.0628319 s, they differ by "
        r"3\.14 rad at t = .* s; pass their period with period=, "
    )
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.periodic(rotor(), np.pi / 50.0)
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.frequency_response(rotor, "speed", (50.0, 56.0), period=lambda speed: np.pi / speed)


def test_uncertain_multipliers_leave_the_stability_open():
    def motion(multiplier, error):
        return PeriodicMotion(None, 1.0, np.array([multiplier + 0.0j]), error)

    assert not motion(1.45, 0.6).stable
    assert motion(1.45, 0.6).stability.startswith("not known: the largest multiplier, 1.45, is unc")
    assert not motion(0.9, 0.2).stable
    assert motion(0.5, 0.2).stable
    assert "unstable" in motion(1.45, 0.2).stability
    assert motion(1.00005, 1e-5).stable


@pytest.mark.slow(reason="25 runs")
def test_regression_states_that_grow_in_each_period_are_named():
    """The advice was to change the start, which does not help the work of a damper."""
    mech, mass = mass_on_rail()
    wall = mech.ground.at(-1.0, 0.0)
    mech.add(bd.Spring("spring", wall, mass.point, 9.0))
    damper = mech.add(bd.Spring("damper", wall, mass.point, damping=0.5))
    mech.add(bd.Force("drive", mass.point, (bd.sine(1.0, 0.4), 0.0)))
    mech.state("work", mech.sensor("power", damper.power), unit="J")
    message = "times the amplitude, most in 'work"
    with pytest.warns(bd.BeamdaeWarning, match=message):
        bd.periodic(mech, 2.5, bd.Radau(1e-5))


@pytest.mark.slow(reason="a second")
def test_regression_axial_vibrations_of_beams_do_not_limit_the_corrections():
    """Each correction was limited to 3 amplitudes of an axial vibration that decays at once."""
    frequency = 4.2
    strip = rectangle(0.006, damping=2e-4)
    mech, arm = clamped_beam(strip, 2, 0.4, name="arm")
    wheel = mech.add(bd.RigidBody.disk("wheel", (0.4, 0.0), radius=0.05, mass=0.4))
    rack = mech.add(bd.RigidBody("rack", mass=0.3, inertia=1e-3, center=(0.4, -0.05)))
    mech.add(bd.Revolute("axle", arm.end, wheel.at(0.4, 0.0)))
    mech.add(bd.Prismatic("guide", arm.end, rack.at(0.4, -0.05)))
    mech.add(bd.RackAndPinion("teeth", wheel.at(0.4, 0.0), rack.at(0.4, -0.05), radius=0.05))
    ends = (mech.ground.at(0.9, -0.05), rack.at(0.4, -0.05))
    mech.add(bd.Spring("spring", *ends, 400.0, 2.0, free_length=0.5))
    mech.add(bd.Moment("motor", wheel.at(0.4, 0.0), bd.sine(2e-3, frequency)))
    mech.observe("wheel", wheel.at(0.4, 0.0))
    motion = bd.periodic(mech, period=1.0 / frequency)
    assert motion.status.success
    assert motion.iterations < 10
    # The rack and half the wheel vibrate on the spring; the arm is 1000 times as stiff.
    w, mass = 2.0 * np.pi * frequency, 0.3 + 0.2
    amplitude = 2e-3 / 0.05 / abs(400.0 - mass * w**2 + 2.0j * w) / 0.05
    measured = 0.5 * np.ptp(motion.solution["wheel.angle"])
    np.testing.assert_allclose(measured, amplitude, rtol=0.02)


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_loads_of_the_twelfth_harmonic_are_periodic():
    """They are zero after each twelfth of a period, and then rounding errors of later times."""
    assert bd.periodic(oscillator(bd.sine(1.0, 6.0)), 2.0, settle=0).status.success


@pytest.mark.slow(reason="settles")
def test_regression_forces_in_axes_of_a_turning_blade_are_periodic():
    """They differed by 5e30 of the largest force, at times of 1e17 s at which sines overflow.

    The component of the force along the chord, 1e-7 of the largest force, seemed to be constant.
    """
    speed = 135.0
    section = rectangle(0.006, 0.04, damping=8e-5, material=ALLOY)
    mech = driven_blade(speed, elements=4, section=section)
    load = (0.0, lambda t: 0.3 * np.sin(2.0 * speed * t))
    mech.add(bd.Force("flow", mech.part("blade").end, load, axes="body"))
    assert bd.periodic(mech, 2.0 * np.pi / speed, settle=1).status.success


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(
    "law", [lambda t: 2.0 * np.pi * t, lambda t: 0.4 * np.cos(2.0 * np.pi * t)]
)
def test_regression_rounding_errors_at_dead_centers_are_no_lost_velocities(law):
    """The joints "did not allow" crank.y_dot = -1.6e-26 m/s of a crank at 6.3 rad/s or at rest."""
    mech = bd.Mechanism(gravity=EARTH)
    crank = mech.add(bd.RigidBody("crank", 10.0, 0.05))
    ram = mech.add(bd.RigidBody("ram", 20.0, 0.1, center=(0.0, -0.25)))
    base = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("shaft", base, crank.at(0.0, 0.0)))
    mech.add(bd.Driver("motor", base, crank.at(0.0, 0.0), law))
    mech.add(bd.Distance("rod", crank.at(0.0, 0.05), ram.at(0.0, -0.25)))
    guide = mech.ground.at(0.0, -0.25)
    mech.add(bd.Prismatic("guide", guide, ram.at(0.0, -0.25), direction=(0.0, 1.0)))
    assert bd.periodic(mech, period=1.0).warnings == ()
