"""Periodic motions, their multipliers, and curves of them, against closed forms and other ways."""

import casadi as ca
import numpy as np
import pytest
from conformance import tuned
from scipy.optimize import fsolve
from scipy.special import mathieu_a, mathieu_b

import beamdae as bd

MASS, STIFFNESS, DAMPING = 2.0, 18.0, 1.0


def oscillator(load, cubic=0.0, stiffness=STIFFNESS, damping=DAMPING):
    """A mass on a rail, on a spring and a damper."""
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", MASS, at=(1.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(1.0, 0.0), mass.point, (1.0, 0.0)))

    def pull(x, rate):
        return stiffness * x + cubic * x**3 + damping * rate

    # Far from where it swings: at its other end a spring turns around.
    mech.add(bd.SpringDamper("spring", mech.ground.at(-9.0, 0.0), mass.point, law=pull))
    mech.add(bd.Force("load", mass.point, (load, 0.0)))
    mech.observe("mass", mass.point)
    return mech


def assert_same(found, expected, off):
    np.testing.assert_allclose(
        np.sort_complex(np.round(found, 12)), np.sort_complex(expected), rtol=0.0, atol=off
    )


@pytest.mark.parametrize("frequency", [0.2, 3.0])
def test_a_damped_oscillator_under_a_sine(frequency):
    motion = bd.periodic(oscillator(bd.sine(1.0, frequency)), 1.0 / frequency)
    omega = 2.0 * np.pi * frequency
    amplitude = 1.0 / np.hypot(STIFFNESS - MASS * omega**2, DAMPING * omega)
    assert motion.status.success
    assert motion.stable
    row = motion.amplitudes().loc["mass.x [m]"]
    # Of the parabolas through 200 samples of a period.
    assert row["half range"] == pytest.approx(amplitude, rel=2e-6)
    assert row["mean"] == pytest.approx(1.0, abs=1e-6 * amplitude)
    rate = 0.5 * DAMPING / MASS
    multiplier = np.exp((-rate + 1j * np.sqrt(STIFFNESS / MASS - rate**2)) / frequency)
    assert_same(motion.multipliers, [multiplier, multiplier.conj()], 1e-7)


def mathieu(a, q, damping=0.0):
    """x'' + damping x' + (a - 2 q cos 2 t) x = 0, and at rest."""
    t, x, v = (ca.SX.sym(name) for name in "txv")
    force = -(a - 2.0 * q * ca.cos(2.0 * t)) * x - damping * v
    return bd.ConstrainedSystem(t, x, v, mass=[1.0], force=force, q0=[0.0], v0=[0.0])


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("q", [0.2, 5.0])
def test_mathieu_s_equation_where_stability_changes(q):
    # At its characteristic values both multipliers are 1 or -1, a double root.
    for value, sign in ((mathieu_a(0, q), 1.0), (mathieu_b(1, q), -1.0), (mathieu_a(2, q), 1.0)):
        motion = bd.periodic(mathieu(value, q), np.pi)
        assert motion.multipliers.sum().real == pytest.approx(2.0 * sign, abs=2e-5)
        assert np.prod(motion.multipliers).real == pytest.approx(1.0, abs=1e-6)


def test_mathieu_s_equation_beside_it():
    # Below the first region of stability, between it and the second, and within them.
    said = {-0.5: "one side", 1.0: "double", 0.5: "stable", 2.5: "stable"}
    for value, word in said.items():
        assert word in bd.periodic(mathieu(value, 0.6), np.pi).stability


@pytest.mark.parametrize("name", ["ida", "radau", "alpha", "alpha adaptive"])
def test_all_integrators_agree(name):
    integrator = tuned(1e-7, 2e-3)[name]
    motion = bd.periodic(mathieu(1.7, 0.6, 0.1), np.pi, integrator)
    # Liouville: the product of all multipliers is that of what damping leaves.
    assert np.prod(motion.multipliers).real == pytest.approx(np.exp(-0.1 * np.pi), rel=1e-5)
    assert motion.multipliers[0].real == pytest.approx(-0.7095668, abs=1e-5)


def test_what_is_wrong_is_said():
    swing = oscillator(bd.sine(1.0, 0.5))
    with pytest.raises(
        bd.BeamdaeError, match=r"^mass\.x: what acts on it.*not the same a period of 3 s later"
    ):
        bd.periodic(swing, 3.0)
    swing.when("mass.x", crosses=1.0, do="stop")
    with pytest.raises(bd.BeamdaeError, match="events must not stop a run"):
        bd.periodic(swing, 2.0)
    with pytest.raises(bd.BeamdaeError, match="model must be a model function"):
        bd.frequency_response(swing, "omega", (1.0, 2.0))
    with pytest.raises(bd.BeamdaeError, match="parameter must be one of 'omega'"):
        bd.frequency_response(duffing, "speed", (1.0, 2.0))
    with pytest.raises(bd.BeamdaeError, match="must be two values that differ"):
        bd.frequency_response(duffing, "omega", (1.0, 1.0))


@pytest.mark.slow(reason="half a second and more")
def test_what_is_not_found_is_a_result_with_a_reason():
    # Undamped at resonance it swings ever further.
    hopeless = oscillator(bd.sine(1.0, 3.0 / (2.0 * np.pi)), damping=0.0)
    with pytest.warns(bd.BeamdaeWarning, match="misses its start by"):
        motion = bd.periodic(hopeless, 2.0 * np.pi / 3.0, bd.Radau(1e-4), settle=0)
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
    assert not response.plot("mass.x [m]").figure.axes[0].lines


@bd.model(t_end=1.0)
def duffing(omega=1.0):
    """M x'' + M 0.1 x' + M x + M 0.5 x^3 = M 0.3 sin omega t."""
    load = bd.sine(0.3 * MASS, omega / (2.0 * np.pi))
    return oscillator(load, 0.5 * MASS, MASS, 0.1 * MASS)


# Of an odd number of samples over a period: the rate of the trigonometric polynomial through them.
SAMPLES = 67
_K = np.arange(SAMPLES)[:, None] - np.arange(SAMPLES)
RATE = np.where(_K == 0, 0.0, 0.5 * (-1.0) ** _K / np.sin(np.pi * _K / SAMPLES + (_K == 0)))


def collocation(omega, x):
    """Residual of Duffing's equation at samples of a period, and its derivative."""
    linear = omega**2 * RATE @ RATE + 0.1 * omega * RATE + np.eye(SAMPLES)
    load = 0.3 * np.sin(2.0 * np.pi * np.arange(SAMPLES) / SAMPLES)
    return linear @ x + 0.5 * x**3 - load, linear + np.diag(1.5 * x**2)


def on_the_curve(omega, x):
    """(omega, samples) of the periodic solution nearest to these, also where the curve turns."""
    z = np.append(x, omega)
    for _ in range(6):
        x, omega = z[:SAMPLES], z[SAMPLES]
        off, slope = collocation(omega, x)
        by_omega = (2.0 * omega * RATE @ RATE + 0.1 * RATE) @ x
        z = z - np.linalg.lstsq(np.column_stack([slope, by_omega]), off)[0]
    return z[SAMPLES], z[:SAMPLES]


def fold(omega, x):
    """Where the derivative is singular: (x, omega, a vector it takes to zero)."""

    def off(z):
        missed, slope = collocation(z[SAMPLES], z[:SAMPLES])
        null = z[SAMPLES + 1 :]
        return np.concatenate([missed, slope @ null, [null @ null - 1.0]])

    null = np.linalg.svd(collocation(omega, x)[1])[2][-1]
    return fsolve(off, np.concatenate([x, [omega], null]), xtol=1e-12)[SAMPLES]


def sampled(point):
    """Samples of the motion of a point of the curve."""
    t = point.period * np.arange(SAMPLES) / SAMPLES
    return point.solution.trajectory.at(t)[1].q[:, 0]


@pytest.mark.slow(reason="a hundred periodic motions")
def test_response_of_duffing_s_oscillator_past_both_folds():
    response = bd.frequency_response(
        duffing, "omega", (1.0, 1.9), lambda omega: 2.0 * np.pi / omega, longest_step=0.2
    )
    assert response.status.success
    # The branch between both folds is not stable, the others are.
    table = response.table()
    turns = np.flatnonzero(table["fold"])
    assert len(turns) == 2
    between = np.arange(len(table))
    between = (between >= turns[0]) & (between < turns[1])
    # At a fold itself a multiplier is 1.
    clear = np.abs(table["largest multiplier"] - 1.0) > 0.02
    assert np.array_equal(~table["stable"][clear], between[clear])
    for point in response.points[::5]:
        x = sampled(point) - 1.0
        omega, known = on_the_curve(point.parameter, x)
        # A period may miss 1e-6 of its motion.
        np.testing.assert_allclose(x, known, rtol=0.0, atol=1e-5)
        assert omega == pytest.approx(point.parameter, abs=1e-5)
    lines = response.plot("mass.x [m]").figure.axes[0].lines
    # Up, back between the folds, on; and the peak.
    assert [line.get_linestyle() for line in lines] == ["-", "--", "-", "None"]
    known = [fold(response.points[k].parameter, sampled(response.points[k]) - 1.0) for k in turns]
    # Of parabolas through three points each, as far apart as a fifth of the range.
    np.testing.assert_allclose(response.folds, known, rtol=1e-3)


# What is stiff beside its mass vibrates a thousand times as fast: it takes ten seconds.
STIFF = pytest.param(1e6, marks=pytest.mark.slow(reason="thousands of vibrations in a period"))


@pytest.mark.parametrize("size", [1e-6, STIFF])
def test_forces_may_be_of_any_size(size):
    system = oscillator(bd.sine(size, 0.5), stiffness=size * STIFFNESS)
    with pytest.raises(bd.BeamdaeError, match="not the same a period of 3 s later"):
        bd.periodic(system, 3.0, settle=0)
    assert bd.periodic(system, 2.0, settle=0).status.success
