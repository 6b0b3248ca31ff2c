"""Periodic motions: monodromy matrices, amplitudes between output rows, and unknown periods."""

import re

import casadi as ca
import numpy as np
import pytest
from mechanisms import EARTH, STEEL, clamped_beam, hinged_beam, hinged_body, mass_on_rail, rectangle
from pages import read_page
from scipy.special import ellipk, ive

import beamdae as bd
from beamdae.analysis.periodic.monodromy import (
    EXACT_RANK,
    VariationalEquations,
    assemble_monodromy,
)
from beamdae.analysis.periodic.period_map import PeriodMap, PeriodRun, build_periodic_equations
from beamdae.linear.elimination import LANES


def test_low_rank_monodromy_matrix():
    random = np.random.default_rng(1)
    size, rank = 60, 4
    matrix = random.standard_normal((size, rank)) @ random.standard_normal((rank, size))
    matrix /= np.linalg.norm(matrix, 2)
    right = random.standard_normal((size, 2))
    columns = []

    def propagate(block):
        columns.append(block.shape[1])
        return matrix @ block

    assembled = assemble_monodromy(propagate, right)
    assert sum(columns) < 20
    # The eigenvalues and the solutions of Newton's equations are those of the full matrix.
    expected = np.linalg.solve(matrix - np.eye(size), right)
    np.testing.assert_allclose(
        np.linalg.solve(assembled - np.eye(size), right), expected, atol=1e-10
    )
    largest = [np.sort(np.abs(np.linalg.eigvals(m)))[-rank:] for m in (assembled, matrix)]
    np.testing.assert_allclose(*largest, atol=1e-10)


def pendulum(rate=0.8):
    """Return a rigid pendulum under a moment that oscillates at `rate` [Hz]."""
    mech, rod = hinged_body(1.0, 0.1, (0.0, -0.5), name="rod", gravity=9.81)
    mech.add(bd.Moment("motor", rod.at(0.0, -0.5), bd.sine(1.0, rate)))
    return mech


def period_run(mechanism, period, rtol):
    equations = build_periodic_equations("periodic", mechanism)
    period_map = PeriodMap.from_equations(equations, bd.Radau(rtol), 0.0, period)
    q, v = period_map.make_consistent(equations.q0, equations.v0)
    return PeriodRun(period_map, period_map.run(q, v))


@pytest.mark.slow(reason="half a second")
def test_monodromy_matrix_is_the_derivative_of_the_period_map():
    run = period_run(pendulum(), 1.25, 1e-11)
    monodromy = run.monodromy(tolerance=EXACT_RANK)
    for k in range(len(monodromy)):
        ends = []
        for sign in (1.0, -1.0):
            change = np.zeros(len(monodromy))
            change[k] = sign * 1e-4
            q, v = run.period_map.make_consistent(*np.split(run.state + run.basis @ change, 2))
            solution = run.period_map.run(q, v)
            last = solution.trajectory.intervals[-1].state
            ends.append(run.projection @ np.concatenate([last.q[-1], last.v[-1]]))
        difference = (ends[0] - ends[1]) / 2e-4
        # Errors of the difference quotient are of order 1e-8, those of the runs 1e-11 / 1e-4.
        np.testing.assert_allclose(monodromy[:, k], difference, atol=1e-6)


def test_interpreted_kernels_agree(monkeypatch):
    run = period_run(pendulum(), 1.25, 1e-4)
    compiled = run.monodromy(tolerance=EXACT_RANK)
    monkeypatch.setenv("BEAMDAE_NATIVE", "off")
    variational = VariationalEquations(run.period_map.equations)
    interpreted = variational.propagate(run.solution.trajectory, run.basis)
    np.testing.assert_allclose(run.projection @ interpreted, compiled, atol=1e-9)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("count", [1, LANES, LANES + 1])
def test_disturbances_do_not_depend_on_those_in_other_lanes(count):
    # Steps are so short that none is halved.
    run = period_run(swung_strip(0.01), 0.1, 1e-6)
    identity = np.eye(run.basis.shape[1])
    together = run.propagate(identity)
    # One of the disturbances is zero, the others have sizes of 1 to 1e-200.
    sizes = np.append(np.logspace(0.0, -200.0, count)[: count - 1], 0.0)
    some = run.propagate(identity[:, :count] * sizes)
    assert not np.any(some[:, -1])
    np.testing.assert_allclose(some[:, :-1] / sizes[:-1], together[:, : count - 1], atol=1e-6)


def forced_strip(ratio, height=0.002):
    """Return an undamped strip and the period of its load, at a multiple of the first frequency."""
    section = rectangle(height)
    rate = ratio * 1.8751041**2 * np.sqrt(section.EI / section.rhoA)
    mech, beam = clamped_beam(section, 4, formulation="exact")
    load = bd.sine(0.03 * section.EI, rate / (2.0 * np.pi))
    mech.add(bd.Force("load", beam.end, (0.0, load)))
    return mech, 2.0 * np.pi / rate


@pytest.mark.slow(reason="one second each")
@pytest.mark.parametrize("height", [0.002, 0.02, 0.05])
def test_errors_of_multipliers_that_long_steps_damp(height):
    """Multipliers of 3e-18 had an error of 1e-19, those of 0.18 one of 0.18."""
    motion = bd.periodic(*forced_strip(0.01, height), bd.Radau(1e-4))
    assert abs(np.abs(motion.multipliers[0]) - 1.0) < motion.multiplier_error
    assert motion.stability.startswith("not known")


def swung_beam(amplitude):
    """Return an undamped beam whose root turns by amplitude (1 - cos 2 pi t)."""
    mech, beam = hinged_beam(rectangle(0.01), 2, formulation="exact")
    root = mech.ground.at(0.0, 0.0), beam.start
    mech.add(bd.Driver("motor", *root, lambda t: amplitude * (1.0 - ca.cos(2.0 * np.pi * t))))
    mech.observe("tip", beam.deflection(1.0))
    return mech


@pytest.mark.slow(reason="two thousand steps in each of several periods")
def test_undamped_beam_converges_quadratically():
    # With four integrator steps in each step of Newton's matrix, 25 iterations did not suffice.
    motion = bd.periodic(swung_beam(0.02), 1.0, bd.Radau(1e-5), settle=0)
    assert motion.status.success
    assert motion.iterations <= 4
    # The first mode is resolved: its multipliers have the modulus 1 within a few rtol.
    np.testing.assert_allclose(np.abs(motion.multipliers[:2]), 1.0, atol=5e-5)
    # Quasistatic tip deflection of the clamped beam: inertia load rho A alpha x and
    # EI w = -rho A alpha (11/120) L^5, amplified by the first mode.
    beam = rectangle(0.01)
    acceleration = 0.02 * (2.0 * np.pi) ** 2
    deflection = 11.0 / 120.0 * beam.rhoA * acceleration / beam.EI
    first = 3.5160 * np.sqrt(beam.EI / beam.rhoA)
    amplified = deflection / (1.0 - (2.0 * np.pi / first) ** 2)
    half = motion.amplitudes().loc["tip.transverse [m]", "half range"]
    assert half == pytest.approx(amplified, rel=0.01)


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("ratio", [0.55, 0.97])
def test_regression_undamped_strip_has_the_harmonic_response(ratio):
    """Vibrations after the start took 100 periods at rtol 1e-8, and more next to a resonance."""
    length, load = 0.5, 1e-4
    section = rectangle(1e-3)
    wave_number = 1.8751041 * np.sqrt(ratio) / length
    frequency = wave_number**2 * np.sqrt(section.EI / section.rhoA) / (2.0 * np.pi)
    mech, beam = clamped_beam(section, 4, length, strain="exact")
    mech.add(bd.Force("load", beam.end, (0.0, bd.sine(load, frequency))))
    mech.observe("tip", beam.deflection(length))
    motion = bd.periodic(mech, 1.0 / frequency)
    assert motion.status.success
    # Harmonic response of a clamped Euler-Bernoulli beam to a force at its tip.
    x = wave_number * length
    gain = np.sin(x) * np.cosh(x) - np.cos(x) * np.sinh(x)
    stiffness = section.EI * wave_number**3 * (1.0 + np.cos(x) * np.cosh(x))
    half = motion.amplitudes().loc["tip.transverse [m]", "half range"]
    assert half == pytest.approx(load * gain / stiffness, rel=1e-3)


def swung_strip(damping_ratio):
    """Return a thin damped strip whose root turns by 0.2 sin 2 pi t."""
    rate = 1.8751041**2 * np.sqrt(STEEL.E * 1e-6 / 12.0 / STEEL.rho) / 0.5**2
    section = rectangle(1e-3, damping=2 * damping_ratio / rate)
    mech, beam = hinged_beam(section, 4, 0.5, formulation="exact")
    root = mech.ground.at(0.0, 0.0), beam.start
    mech.add(bd.Driver("motor", *root, lambda t: 0.2 * ca.sin(2.0 * np.pi * t)))
    mech.observe("tip", beam.end)
    return mech


@pytest.mark.slow(reason="ten periods")
def test_regression_turning_strips_have_accurate_multipliers():
    """Linearized steps in which the strip turned too far failed."""
    motion = bd.periodic(swung_strip(0.01), 1.0)
    assert motion.status.success
    assert np.abs(motion.multipliers[0]) == pytest.approx(0.810592, abs=2e-5)


@pytest.mark.slow(reason="several periods with thousands of steps")
@pytest.mark.parametrize("integrator", [bd.Ida(1e-6), bd.GeneralizedAlpha(rtol=1e-4)], ids=repr)
def test_undamped_strips_are_neutrally_stable_with_all_adaptive_methods(integrator):
    motion = bd.periodic(*forced_strip(0.5), integrator)
    assert motion.status.success
    # Undamped; half a period of the first mode in each period of the load.
    assert np.abs(motion.multipliers[:2]) == pytest.approx(1.0, abs=2e-4)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("frequency", [0.4, 0.05])
def test_multipliers_are_those_of_the_dense_matrix(frequency):
    motion = bd.periodic(pendulum(frequency), 1.0 / frequency, bd.Radau(1e-5))
    state = motion.solution.trajectory.intervals[0].state
    equations = motion.solution.equations
    period_map = PeriodMap.from_equations(equations, bd.Radau(1e-10), 0.0, motion.period)
    run = PeriodRun(period_map, period_map.run(state.q[0], state.v[0]))
    dense = run.propagate(np.eye(run.basis.shape[1]))
    expected = np.max(np.abs(np.linalg.eigvals(dense)))
    assert abs(np.abs(motion.multipliers[0]) - expected) < 1e-5 + 2.0 * motion.multiplier_error


@pytest.mark.parametrize("vibrations", [98.2, 100.3])
def test_regression_multipliers_of_modes_with_many_vibrations_per_period(vibrations):
    """With two steps per vibration, the multipliers of an undamped mode were 0, error 2e-20.

    If steps are halved, these multipliers grow or, with longer steps, become smaller.
    """
    t, x, v = (ca.SX.sym(name) for name in "txv")
    rate = 1.0 / vibrations
    force = -x + ca.sin(rate * t)
    system = bd.ConstrainedSystem(t, x, v, mass=[1.0], force=force, q0=[0.0], v0=[0.0])
    motion = bd.periodic(system, 2.0 * np.pi / rate, bd.Radau(1e-6), settle=0)
    assert motion.status.success
    error = abs(np.abs(motion.multipliers[0]) - 1.0)
    assert error < 1e-4 + motion.multiplier_error


# Amplitudes of periodic motions and responses do not depend on their output rows.

WIDTH = 0.005  # duration of the pulse relative to the period; rows are as far apart
PULSE = "pulse.Fx [N]"
SIZE = 100.0  # N
RIPPLE = 0.01  # N


@bd.model(t_end=1.0)
def pulsed_mass(size=SIZE):
    """Return a mass on a spring under a short pulse per second, right after its least value."""

    def force(t):
        phase = np.sin(np.pi * (t - 0.5137)) / (np.pi * WIDTH)
        return size * np.exp(-(phase**2)) + RIPPLE * (1.0 - np.cos(2.0 * np.pi * (t - 0.5)))

    mech, mass = mass_on_rail()
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), mass.point, 400.0, 4.0))
    pulse = mech.add(bd.Force("pulse", mass.point, (force, 0.0)))
    mech.observe("pulse", pulse.force)
    mech.observe("mass", mass.point)
    return mech


@pytest.fixture(scope="module")
def motion():
    with pytest.warns(bd.BeamdaeWarning, match="amplitudes include"):
        return bd.periodic(pulsed_mass(), period=1.0)


@pytest.fixture(scope="module")
def response():
    return bd.frequency_response(
        pulsed_mass, "size", (SIZE, 110.0), lambda size: 1.0, settle=5, max_points=2
    )


def test_regression_amplitudes_include_pulses_between_rows(motion):
    """Parabolas through 201 rows had a largest value of 95 N and a least one of -0.4 N."""
    row = motion.amplitudes().loc[PULSE]
    assert row["largest"] == pytest.approx(SIZE, rel=1e-5)
    assert 0.0 <= row["least"] < 1e-3
    assert row["half range"] == pytest.approx(0.5 * SIZE, rel=1e-4)
    exponent = 0.5 / (np.pi * WIDTH) ** 2
    assert row["mean"] == pytest.approx(SIZE * ive(0, exponent) + RIPPLE, rel=1e-4)
    rows = motion.solution.columns[PULSE]
    assert rows.max() < 0.95 * SIZE


def test_regression_warnings_of_periodic_motions_have_no_options_of_rows(motion):
    """Warnings recommended output_step=, which `periodic` does not have."""
    (warning,) = motion.warnings
    assert "the output rows miss its largest value" in warning
    assert "output_step" not in warning
    assert warning.endswith("but curves and the table of the rows do not.")


def test_regression_the_page_of_a_motion_agrees_with_its_amplitudes(motion, tmp_path):
    """The page had the amplitudes of the rows beside the extremes of the steps."""
    page = read_page(motion.page(tmp_path / "pulse.html"))
    assert page["notes"] == list(motion.warnings)
    (table,) = (x for x in page["tables"] if x["title"] == "Amplitudes")
    (cells,) = (x for x in table["rows"] if PULSE.partition(" ")[0] in x[0])
    assert re.search(r"\b100\b", " ".join(cells))


def test_regression_responses_include_pulses_between_rows(response):
    """Tables of responses had the values of rows, and each motion had a warning."""
    table = response.table()
    sizes = table["size"].to_numpy()
    assert table["pulse.Fx largest magnitude [N]"].to_numpy() == pytest.approx(sizes, rel=1e-5)
    assert response.curve("pulse.Fx")[1] == pytest.approx(0.5 * sizes, rel=1e-4)
    (reason,) = response.warnings
    assert "maximum of 2 points" in reason


@pytest.mark.slow(reason="half a second")
def test_amplitudes_of_angles_with_full_revolutions_end_at_the_last_row():
    mech = bd.Mechanism()
    crank = mech.add(bd.RigidBody("crank", 1.0, 0.1))
    base = mech.ground.at(0.0, 0.0)
    mech.add(bd.Revolute("shaft", base, crank.at(0.0, 0.0)))
    mech.add(bd.Driver("motor", base, crank.at(0.0, 0.0), lambda t: 2.0 * np.pi * t))
    mech.observe("pin", crank.at(1.0, 0.0))
    table = bd.periodic(mech, period=1.0).amplitudes()
    angle = table.loc["pin.angle [rad]"]
    assert angle[["mean", "least", "largest"]].to_list() == pytest.approx(
        [np.pi, 0.0, 2.0 * np.pi], abs=1e-9
    )
    assert table.loc["pin.x [m]", "half range"] == pytest.approx(1.0, rel=1e-9)


# Periodic motions of unknown period: self-excited and free motions.

# Period of van der Pol's oscillator at mu = 1; also Andersen & Geer, SIAM J. Appl. Math. 42 (1982)
# 678. Digits of scipy's DOP853 at rtol = 1e-13.
VAN_DER_POL_PERIOD = 6.6632868593


def van_der_pol(mu, start=0.5):
    """Return x'' = mu (1 - x^2) x' - x as equations."""
    t, x, v = (ca.SX.sym(name) for name in "txv")
    force = mu * (1.0 - x**2) * v - x
    return bd.ConstrainedSystem(t, x, v, mass=[1.0], force=force, q0=[start], v0=[0.0])


@bd.model(t_end=40.0)
def self_excited(length=1.0):
    """Return a mass on a spring with negative damping at small elongations, in units of length."""
    mech, mass = mass_on_rail(2.0, velocity=(0.1 * length, 0.0))

    def pull(x, rate):
        return 2.0 * x + 2.0 * ((x / length) ** 2 - 1.0) * rate

    # The spring is anchored far away, since its direction reverses at the anchor.
    anchor = mech.ground.at(-10.0 * length, 0.0)
    mech.add(bd.Spring("spring", anchor, mass.point, law=pull))
    mech.observe("mass", mass.point)
    return mech


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("guess", [5.0, 6.8, 9.0])
def test_period_of_a_self_excited_motion_is_found(guess):
    motion = bd.periodic(van_der_pol(1.0), period_guess=guess)
    assert motion.status.success
    assert motion.stable
    assert motion.period == pytest.approx(VAN_DER_POL_PERIOD, rel=1e-8)
    # Disturbances along the motion persist; Liouville's formula determines the other multiplier.
    trajectory = motion.solution.trajectory
    t = np.linspace(0.0, motion.period, 2001)
    x = trajectory.at(t)[1].q[:, 0]
    expected = np.exp(motion.period * np.mean(1.0 - x[1:] ** 2))
    np.testing.assert_allclose(motion.multipliers.real, [1.0, expected], atol=1e-6)


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("length", [1.0, 1000.0])
def test_period_is_estimated_from_the_run_of_the_model(length):
    motion = bd.periodic(self_excited(length=length))
    assert motion.period == pytest.approx(VAN_DER_POL_PERIOD, rel=1e-7)
    # The amplitude 2.00862 of van der Pol's oscillator at mu = 1.
    half = motion.amplitudes().loc["mass.x [m]", "half range"]
    assert half == pytest.approx(2.00862 * length, rel=1e-5)


@pytest.mark.parametrize("seed", range(8))
def test_periods_of_free_motions_are_found_from_any_guess(seed):
    """Pendulums and Duffing oscillators of any amplitude, from guesses within 8 %."""
    rng = np.random.default_rng(seed)
    amplitude, settle = rng.uniform(0.05, 2.3), int(rng.integers(0, 6))
    t, x, v = (ca.SX.sym(name) for name in "txv")
    is_pendulum = seed % 2 == 0
    force = -ca.sin(x) if is_pendulum else -x - x**3

    def find_period(energy):
        """Return the period at an energy above the one at rest."""
        if is_pendulum:
            return 4.0 * ellipk(0.5 * energy)
        square = np.sqrt(1.0 + 4.0 * energy) - 1.0  # of the amplitude
        return 4.0 * ellipk(0.5 * square / (1.0 + square)) / np.sqrt(1.0 + square)

    def find_energy(x, v):
        return 0.5 * v**2 + (1.0 - np.cos(x) if is_pendulum else 0.5 * x**2 + 0.25 * x**4)

    system = bd.ConstrainedSystem(t, x, v, mass=[1.0], force=force, q0=[amplitude], v0=[0.0])
    guess = find_period(find_energy(amplitude, 0.0)) * rng.uniform(0.92, 1.08)
    rtol = 10.0 ** rng.uniform(-10.0, -6.0)
    motion = bd.periodic(system, period_guess=guess, settle=settle, integrator=bd.Radau(rtol))
    assert motion.status.success
    state = motion.solution.trajectory.at(np.array([0.0]))[1]
    energy = find_energy(state.q[0, 0], state.v[0, 0])
    assert motion.period == pytest.approx(find_period(energy), rel=max(1e-8, 30.0 * rtol))
    # The motion is one near the start.
    assert np.max(np.abs(motion.solution.q)) == pytest.approx(amplitude, rel=0.1)
    assert motion.stable


@pytest.mark.slow(reason="several searches")
def test_arguments_and_failures():
    with pytest.raises(bd.BeamdaeError, match="period and period_guess are mutually exclusive"):
        bd.periodic(van_der_pol(1.0), 6.0, period_guess=6.0)
    with pytest.raises(bd.BeamdaeError, match="no end time from which to estimate the period"):
        bd.periodic(van_der_pol(1.0))
    with pytest.raises(bd.BeamdaeError, match="period_guess must be positive"):
        bd.periodic(van_der_pol(1.0), period_guess=-1.0)
    t, x, v = (ca.SX.sym(name) for name in "txv")
    forced = bd.ConstrainedSystem(t, x, v, mass=[1.0], force=ca.sin(t) - x - v, q0=[1.0], v0=[0.0])
    with pytest.raises(bd.BeamdaeError, match="loads or drivers depend on time; pass their period"):
        bd.periodic(forced, period_guess=6.0)
    for damping in (0.05, 0.5):
        with pytest.warns(
            bd.BeamdaeWarning, match="state of rest; change start= or increase settle="
        ):
            bd.periodic(van_der_pol(-damping), period_guess=6.5, settle=0)
    # Motions near the limit cycle, and parts of motions that are far from it, are no rest.
    for start in (0.5, 30.0):
        with pytest.warns(bd.BeamdaeWarning, match="iterations the end of the period differs"):
            bd.periodic(van_der_pol(1.0, start), period_guess=6.5, settle=0)
    # A period given two per cent too long is kept, and the reason names the remedy.
    with pytest.warns(bd.BeamdaeWarning, match="omit period= to find the period"):
        bd.periodic(van_der_pol(1.0), 6.8)


def test_motion_that_does_not_recur():
    @bd.model(t_end=2.0)
    def falling():
        mech = bd.Mechanism(gravity=EARTH)
        mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
        return mech

    with pytest.raises(bd.BeamdaeError, match="does not recur within 2 s; pass period_guess="):
        bd.periodic(falling)
