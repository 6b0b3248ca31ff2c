"""Margins of loops against closed forms, polynomials and z-domain computations."""

import casadi as ca
import numpy as np
import pytest
from mechanisms import free_ball, mass_on_rail
from numpy.testing import assert_allclose
from scipy import signal

import beamdae as bd


def tank(outputs=("level",)):
    """Return the linear model of an integrator."""
    mech = bd.Mechanism()
    valve = mech.input("valve")
    mech.state("level", valve)
    return bd.linearize(mech, outputs=list(outputs))


def stage(stiffness=0.0, damping=0.0):
    """Return the linear model of 2 kg on a rail, with a spring and a damper, from force to x."""
    mech, mass = mass_on_rail(2.0, 1.0, spring=(stiffness, damping, 1.0))
    force = mech.input("force", unit="N")
    mech.add(bd.Force("push", mass.point, (force, 0.0)))
    for name in ("x", "x_dot"):
        mech.sensor(name, mass.point, name)
    return bd.linearize(mech, inputs=["force"], outputs=["x"])


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize(("gain", "delay"), [(2.0, 0.25), (0.5, 3.0), (2e3, 1e-5)])
def test_integrator_with_delay_has_the_margins_of_its_closed_form(gain, delay):
    loop = bd.margins(tank(), controller=gain, delay=delay)
    critical = 0.5 * np.pi / delay
    assert loop.stable
    assert loop.gain_margin == pytest.approx(critical / gain, rel=1e-9)
    assert loop.phase_crossover == pytest.approx(0.25 / delay, rel=1e-9)
    assert loop.gain_crossover == pytest.approx(gain / (2.0 * np.pi), rel=1e-9)
    assert loop.phase_margin == pytest.approx(90.0 - np.degrees(gain * delay), rel=1e-9)
    assert loop.delay_margin == pytest.approx(0.5 * np.pi / gain - delay, rel=1e-9)
    assert loop.gain_margin_db == pytest.approx(20.0 * np.log10(critical / gain), rel=1e-9)


@pytest.mark.parametrize("gain", [0.5, 3.0, -1.5, -4.0])
def test_poles_of_loops_with_a_direct_feedthrough(gain):
    # The acceleration of 2 kg on a spring and a damper is L = k s^2 / (2 s^2 + 3 s + 50).
    mech, mass = mass_on_rail(2.0, 1.0, spring=(50.0, 3.0, 1.0))
    mech.add(bd.Force("push", mass.point, (mech.input("force", unit="N"), 0.0)))
    mech.observe("mass", bd.acceleration(mass.point))
    model = bd.linearize(mech, inputs=["force"], outputs=["mass.ax"])
    loop = bd.margins(model, controller=gain)
    poles = np.roots([2.0 + gain, 3.0, 50.0])
    assert loop.unstable_poles == np.count_nonzero(poles.real > 0.0)
    assert loop.stable == (gain > -2.0)


@pytest.mark.parametrize(("delay", "count"), [(0.7, 0), (0.9, 2), (4.0, 4), (7.5, 6)])
def test_unstable_poles_with_delay_are_counted(delay, count, recwarn):
    """s + 2 exp(-s T) = 0: pairs cross at T = (pi / 2 + 2 pi k) / 2."""
    loop = bd.margins(tank(), controller=2.0, delay=delay)
    assert loop.unstable_poles == count
    assert loop.stable == (count == 0)
    assert np.isnan(loop.delay_margin) == (count > 0)
    assert len(recwarn) == bool(count)
    recwarn.clear()


def test_second_order_system_has_the_phase_margin_of_its_closed_form():
    """L = w^2 / (s (s + 2 z w)), the loop of a second-order system with the damping ratio z."""
    ratio, w = 0.3, 10.0
    loop = bd.margins(stage(0.0, 4.0 * ratio * w), controller=2.0 * w**2)
    root = np.sqrt(np.sqrt(1.0 + 4.0 * ratio**4) - 2.0 * ratio**2)
    assert loop.phase_margin == pytest.approx(np.degrees(np.arctan2(2.0 * ratio, root)), rel=1e-8)
    assert loop.gain_crossover == pytest.approx(w * root / (2.0 * np.pi), rel=1e-8)
    assert loop.gain_margin == np.inf
    assert np.isnan(loop.phase_crossover)
    assert loop.stable


def test_smallest_margins_of_several_crossovers():
    """A lightly damped resonance above the crossover of an integrator with a zero."""
    numerator, denominator = np.array([80.0, 400.0]), np.array([1.0, 0.4, 400.0, 0.0])
    law = signal.TransferFunction(numerator, denominator)
    with pytest.warns(bd.BeamdaeWarning, match=r"unstable \(2 unstable poles\)"):
        loop = bd.margins(tank(["valve"]), controller=law)
    # Roots of polynomials in w: |N|^2 = |D|^2, and Im(N conj(D)) = 0.
    powers = 1j ** np.arange(3, -1, -1)
    n, d = (np.poly1d(powers[-len(x) :] * x) for x in (numerator, denominator))
    n_conj, d_conj = (np.poly1d(np.conj(x.coeffs)) for x in (n, d))

    def positive(polynomial):
        roots = np.poly1d(polynomial).roots
        return np.sort(roots.real[(np.abs(roots.imag) < 1e-6) & (roots.real > 1e-6)])

    gains = positive((n * n_conj - d * d_conj).coeffs.real)
    phases = positive((n * d_conj).coeffs.imag)
    phases = phases[(n(phases) / d(phases)).real < 0.0]
    table = loop.table()
    found = {k: 2.0 * np.pi * x["frequency [Hz]"] for k, x in table.groupby("kind")}
    assert len(gains) == 3
    assert_allclose(found["gain"], gains, rtol=1e-8)
    assert_allclose(found["phase"], phases, rtol=1e-8)
    margin = np.degrees(np.angle(-n(gains) / d(gains)))
    assert loop.phase_margin == pytest.approx(margin[np.argmin(np.abs(margin))], rel=1e-7)
    assert loop.gain_margin == pytest.approx(np.abs(d(phases) / n(phases))[0], rel=1e-7)
    lags = np.angle(-n(gains) / d(gains)) % (2.0 * np.pi) / gains
    assert_allclose(table["delay margin [s]"].dropna(), lags, rtol=1e-7)
    roots = (np.poly1d(numerator) + np.poly1d(denominator)).roots
    assert loop.unstable_poles == np.sum(roots.real > 0.0) == 2


def test_gain_may_decrease_to_the_margin_of_an_unstable_plant():
    """An inverted pendulum, m (x'' - 9 x) = u: the gain of x must stay above 18 N/m."""
    mech = bd.Mechanism()
    force = mech.input("force")
    x, v = (mech.state(name) for name in ("x", "v"))
    x.follows(v)
    v.follows(9.0 * x + 0.5 * force)
    model = bd.linearize(mech, outputs=["x", "v"])
    loop = bd.margins(model, "force", [30.0, 8.0])
    assert loop.stable
    assert loop.gain_margin == pytest.approx(18.0 / 30.0, rel=1e-9)
    assert loop.phase_crossover == 0.0
    with pytest.warns(bd.BeamdaeWarning, match=r"the closed loop is unstable \(1 unstable pole\)"):
        loop = bd.margins(model, "force", [15.0, 8.0])
    assert not loop.stable
    assert "unstable" in loop.warnings[0]
    assert repr(loop).endswith("closed loop unstable>")


def pid_mechanism(factor=1.0, limits=None, offset=0.0):
    mech, mass = mass_on_rail(2.0, 1.0)
    x, v = (mech.sensor(name, mass.point, name) for name in ("x", "x_dot"))
    target = mech.input("target", default=1.0 + offset)
    gains = {"kp": 300.0, "ki": 400.0, "kd": 40.0, "rate": -v, "limits": limits}
    command = bd.pid(mech, "servo", target - x, **gains)
    # Another loop, which stays closed, and a factor that depends on the state.
    mech.add(bd.Force("motor", mass.point, (factor * command - 12.0 * x, 0.0)))
    return mech


@pytest.mark.parametrize("factor", [1.0, 1.7])
@pytest.mark.parametrize("limits", [None, (-500.0, 500.0)])
def test_loop_of_a_pid_is_opened_at_its_command(factor, limits):
    """L = factor (kp + ki / s + kd s) / (m s^2 + k)."""
    mech = pid_mechanism(factor, limits)
    loop = bd.margins(bd.linearize(mech, "equilibrium"), "servo")
    assert loop.stable
    w = 2.0 * np.pi * loop.gain_crossover
    controller = factor * (300.0 + 400.0 / (1j * w) + 40.0j * w)
    open_loop = controller / (12.0 - 2.0 * w**2)
    assert abs(open_loop) == pytest.approx(1.0, rel=1e-6)
    assert loop.phase_margin == pytest.approx(np.degrees(np.angle(-open_loop)), rel=1e-6)
    # At the phase crossover, kp + ki / s + kd s is real.
    assert 2.0 * np.pi * loop.phase_crossover == pytest.approx(np.sqrt(10.0), rel=1e-6)
    # The gain g may decrease, by the Routh criterion, until k + kp g = m ki / kd.
    assert loop.gain_margin == pytest.approx(8.0 / (300.0 * factor), rel=1e-6)


@pytest.mark.slow(reason="a fifth of a second")
def test_command_in_a_formula_of_a_state_is_differentiated():
    """The drive y, T y' + y = (1 + 0.1 x) u, of a mass on a spring; the factor depends on x."""
    mech, mass = mass_on_rail(2.0, 1.0, spring=(50.0, 3.0, 0.9))
    x = mech.sensor("x", mass.point, "x")
    command = bd.pid(mech, "servo", 1.0 - x, 30.0, 40.0, 4.0, filter_time=0.01)
    drive = mech.state("drive", lambda y, t: ((1.0 + 0.1 * x) * command - y) / 0.02)
    mech.add(bd.Force("motor", mass.point, (drive, 0.0)))
    loop = bd.margins(bd.linearize(mech, "equilibrium"), "servo")
    assert loop.stable
    for kind, f, margin, *_ in loop.crossovers:
        s = 2j * np.pi * f
        # At rest, 1.1 u = 50 (1 - 0.9).
        inner = 2.0 * s**2 + 3.0 * s + 50.0 - 0.1 * (5.0 / 1.1) / (0.02 * s + 1.0)
        value = (30.0 + 40.0 / s + 4.0 * s / (0.01 * s + 1.0)) * 1.1 / (0.02 * s + 1.0) / inner
        if kind == "gain":
            assert abs(value) == pytest.approx(1.0, rel=1e-6)
        else:
            assert_allclose(value * margin, -1.0, atol=1e-6)
    assert {x.kind for x in loop.crossovers} == {"gain", "phase"}


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_sampled_loops_agree_with_their_z_transform(delay):
    """Zero-order hold of k / s and of 1 / (m s^2), with a delay of whole samples."""
    every, gain = 0.1, 2.0
    loop = bd.margins(tank(), controller=gain, every=every, delay=delay)
    # k T z^-d / (z - 1) has the phase -180 degrees at w T (d + 1/2) = pi / 2.
    angle = np.pi / (2.0 * delay + 1.0)
    limit = 2.0 * np.sin(0.5 * angle) / (gain * every)
    assert loop.stable
    assert loop.every == every
    assert loop.gain_margin == pytest.approx(limit, rel=1e-9)
    assert loop.phase_crossover == pytest.approx(angle / (2.0 * np.pi * every), rel=1e-9)
    crossing = 2.0 * np.arcsin(0.5 * gain * every)
    assert loop.gain_crossover == pytest.approx(crossing / (2.0 * np.pi * every), rel=1e-9)
    phase = 90.0 - np.degrees((delay + 0.5) * crossing)
    assert loop.phase_margin == pytest.approx(phase, rel=1e-8)
    # Gains beyond the margin are unstable.
    for factor, stable in ((0.999, True), (1.001, False)):
        z = np.poly1d([1.0, -1.0] + [0.0] * delay) + factor * limit * gain * every
        assert (np.max(np.abs(z.roots)) < 1.0) == stable


def test_discrete_controllers_of_scipy():
    """A PD law of backward differences, kp + kd (z - 1) / (T z), of a mass."""
    every, kp, kd = 0.01, 200.0, 30.0
    law = signal.TransferFunction([kp + kd / every, -kd / every], [1.0, 0.0], dt=every)
    loop = bd.margins(stage(), "force", law, delay=1)
    plant = np.poly1d([0.25 * every**2] * 2), np.poly1d([1.0, -2.0, 1.0])
    numerator = plant[0] * np.poly1d(law.num)
    denominator = plant[1] * np.poly1d([1.0, 0.0, 0.0])
    for f, margin in ((loop.phase_crossover, loop.gain_margin), (loop.gain_crossover, 1.0)):
        z = np.exp(2j * np.pi * f * every)
        assert abs(numerator(z) / denominator(z)) * margin == pytest.approx(1.0, rel=1e-6)
    z = np.exp(2j * np.pi * loop.gain_crossover * every)
    angle = np.degrees(np.angle(-numerator(z) / denominator(z)))
    assert loop.phase_margin == pytest.approx(angle, rel=1e-6)
    for factor, stable in ((0.999, True), (1.001, False)):
        roots = (denominator + factor * loop.gain_margin * numerator).roots
        assert (np.max(np.abs(roots)) < 1.0) == stable


def test_peaks_of_flexible_structures_above_the_magnitude_one_are_crossovers():
    """Two crossovers within the bandwidth of a resonance of 0.01 % damping."""
    model = stage(2.0e4, 2.0 * 2e-4 * 100.0 * 2.0 * 0.5)
    loop = bd.margins(model, controller=20.0)
    assert [x.kind for x in loop.crossovers] == ["gain", "gain"]
    assert loop.stable


def draw_roots(rng, count):
    """Return real roots and pairs at rates from 0.2 to 5 rad/s, a sixth of them unstable."""
    roots = []
    for w in 10.0 ** rng.uniform(-0.7, 0.7, count):
        sign = 1.0 if rng.random() < 1 / 6 else -1.0
        ratio = sign * 10.0 ** rng.uniform(-3.0, -0.5)
        pair = w * (ratio + 1j * np.sqrt(1.0 - ratio**2) * np.array([1.0, -1.0]))
        roots += pair.tolist() if rng.random() < 0.6 else [sign * w]
    return roots


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.filterwarnings("ignore:margins. the closed loop is unstable")
def test_crossovers_of_delayed_loops_are_those_of_a_densely_sampled_phase(seed):
    rng = np.random.default_rng(seed)
    poles = [0.0] * rng.integers(0, 2) + draw_roots(rng, rng.integers(2, 5))
    zeros = draw_roots(rng, 1) if len(poles) > 2 else []
    delay, size = 10.0 ** rng.uniform(-2.0, 1.3), 10.0 ** rng.uniform(-0.5, 0.5)
    f = np.geomspace(1e-3, 20.0, 400_000)
    s = 2j * np.pi * f
    values = np.prod([s - x for x in zeros], axis=0) / np.prod([s - x for x in poles], axis=0)
    gain = size / np.median(np.abs(values[(f > 0.1) & (f < 1.0)]))
    law = signal.ZerosPolesGain(zeros, poles, gain).to_ss()
    loop = bd.margins(tank(["valve"]), controller=law, delay=delay)
    magnitude = np.log(np.abs(gain * values))
    turns = (np.unwrap(np.angle(values)) - 2.0 * np.pi * f * delay + np.pi) / (2.0 * np.pi)
    found = {"phase": np.diff(np.floor(turns)), "gain": np.diff(np.sign(magnitude))}
    is_large = {"phase": magnitude[1:] > np.log(1.01e-3), "gain": True}
    table = loop.table()
    table = table[(table["frequency [Hz]"] > f[0]) & (table["frequency [Hz]"] < f[-1])]
    table = table[~(table["gain margin"] > 1.0 / 1.01e-3)]
    for kind, changes in found.items():
        expected = f[1:][(changes != 0.0) & is_large[kind]]
        own = table["frequency [Hz]"][table["kind"] == kind]
        assert_allclose(own, expected, rtol=3e-5)
    assert len(table) > 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"model": bd.Mechanism()}, "must be a result of linearize"),
        ({"at": "forse"}, "no input or pid 'forse' .did you mean 'force'"),
        ({"controller": [1.0, 2.0]}, r"one gain or input per output of the linear model \(1\)"),
        ({"controller": "PI"}, "controller must be"),
        (
            {"controller": signal.StateSpace(-1.0, [[1.0, 1.0]], 1.0, [[0.0, 0.0]])},
            "one command, and one gain or input per output",
        ),
        (
            {"controller": signal.dlti([1.0], [1.0, 0.5])},
            "got dt = True and every = None; pass a discrete controller with its interval dt",
        ),
        ({"controller": signal.lti([1.0], [1.0, 0.5]), "every": 0.1}, "equal to every"),
        ({"every": 0.0}, "every must be positive"),
        ({"every": 0.1, "delay": 0.5}, "delay must be a whole number"),
        ({"delay": -1.0}, "delay must not be negative"),
    ],
)
def test_invalid_arguments_are_rejected(arguments, message):
    with pytest.raises(bd.BeamdaeError, match=f"margins: .*{message}"):
        bd.margins(**({"model": stage()} | arguments))


def test_loops_that_a_pid_closes_have_no_other_controller():
    model = bd.linearize(pid_mechanism(), "equilibrium")
    for arguments in ({"controller": [1.0, 2.0]}, {"controller": np.ones(3)}, {"every": 0.1}):
        with pytest.raises(bd.BeamdaeError, match="servo closes the loop itself"):
            bd.margins(model, "servo", **arguments)


@pytest.mark.slow(reason="half a second")
def test_loops_that_cannot_be_opened_are_named():
    mech = pid_mechanism(limits=(-30.0, 30.0), offset=1.0)
    with pytest.warns(bd.BeamdaeWarning, match="is beyond its limit"):
        model = bd.linearize(mech)
    with pytest.raises(bd.BeamdaeError, match=r"300 of servo is at or beyond its limit 30"):
        bd.margins(model, "servo")
    mech, mass = free_ball((1.0, 0.0), 2.0, name="mass")
    x = mech.sensor("x", mass.point, "x")
    command = bd.pid(mech, "servo", -x, kp=3.0)
    law = bd.table([-10.0, 10.0], [-1.0, 1.0], kind="linear")
    mech.add(bd.Force("motor", mass.point, (law(ca.SX(command)), 0.0)))
    with pytest.raises(bd.BeamdaeError, match="motor"):
        bd.margins(bd.linearize(mech), "servo")


@pytest.mark.parametrize("height", [0.02, 0.002, 0.0002])
@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e3])
def test_free_rotations_that_a_loop_does_not_see_are_not_unstable(unit, height):
    """The strain of a beam does not change with its rotation; `unit` is the unit of time [s]."""
    mech = bd.Mechanism()
    steel = bd.Material(E=2.1e11 * unit**2, nu=0.3, rho=7800.0)
    strip = bd.Section.rectangle(steel, width=0.02, height=height, damping=1e-4 / unit)
    hub = mech.add(bd.RigidBody("hub", 1.0, 0.01, center=(0.0, 0.0)))
    line = bd.Line((0.05, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("beam", line, strip, elements=6, formulation="exact"))
    mech.add(bd.Revolute("axis", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
    mech.add(bd.Weld("clamp", hub.at(0.05, 0.0), beam.start))
    mech.add(bd.Moment("motor", hub.at(0.0, 0.0), 0.0))
    mech.observe("gauge", beam.strain(s=0.05, offset=0.4 * height))
    plant = bd.linearize(mech, inputs=["motor"], outputs=["gauge"])
    assert np.count_nonzero(plant.poles == 0.0) == 2
    for every in (None, 1e-3 / unit):
        loop = bd.margins(plant, controller=1e-9 * unit**2, every=every)
        assert loop.unstable_poles == 0


def test_loops_are_opened_at_names():
    class Name:
        def __eq__(self, other):
            raise RuntimeError

    with pytest.raises(bd.BeamdaeError, match=r"^margins: there is no input or pid"):
        bd.margins(tank(), Name())
