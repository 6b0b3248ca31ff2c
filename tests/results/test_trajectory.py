"""Trajectories: dense output, and extremes at the steps of a run."""

import pickle
import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
from mechanisms import ALLOY, clamped_beam, free_ball, rectangle
from mechanisms import dropped_ball as ball
from mechanisms import peak_of_dropped_ball as peak
from numpy.polynomial import Polynomial
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.equations.equations_of_motion import State
from beamdae.integrators.radau.coefficients import C
from beamdae.live.session import summarize
from beamdae.report import tables
from beamdae.report.run_pages import build_run_page
from beamdae.results.trajectory import Interval, Trajectory
from beamdae.studies.run_values import MEASURES, measure_rows

STEPS = np.array([0.0, 0.1, 0.15, 0.4, 0.9, 1.0])


# Three nodes per step, as for Radau IIA.
STAGES = np.append((STEPS[:-1, None] + np.append(0.0, C[:-1]) * np.diff(STEPS)[:, None]).ravel(), 1)
BETWEEN = np.linspace(0.0, 1.0, 137)


def make_interval(nodes, functions, branch=0.5, nodes_per_step=1):
    """Return an interval of functions q, v, a and lam of time."""
    rows = State(*(np.stack([f(nodes)], axis=-1) for f in functions))
    return Interval(nodes, rows, branch, nodes_per_step)


def polynomial(degree, seed=0):
    return Polynomial(np.random.default_rng(seed).normal(size=degree + 1))


def largest_errors(state, functions, t):
    """Return the largest error of each of q, v, a and lam."""
    return np.array([np.max(np.abs(x[:, 0] - f(t))) for x, f in zip(state, functions, strict=True)])


@pytest.mark.parametrize(("nodes_per_step", "orders"), [(1, [5, 5, 4, 4]), (3, [5, 4, 4, 4])])
def test_orders_of_the_dense_output(nodes_per_step, orders):
    functions = np.sin, np.cos, lambda t: -np.sin(t), np.sin
    at = np.linspace(0.0, 4.0, 1001)
    errors = []
    for steps in (32, 64):
        ends = np.linspace(0.0, 4.0, steps + 1)
        inside = np.append(0.0, C[:-1])[:nodes_per_step]
        nodes = np.append((ends[:-1, None] + inside * (ends[1] - ends[0])).ravel(), 4.0)
        errors.append(
            largest_errors(
                make_interval(nodes, functions, nodes_per_step=nodes_per_step).at(at), functions, at
            )
        )
    assert_allclose(np.log2(np.divide(*errors)), orders, rtol=0.0, atol=0.2)


@pytest.mark.parametrize("nodes_per_step", [1, 3])
def test_regression_vibrations_too_fast_for_the_steps_are_not_amplified(nodes_per_step):
    """Interpolating h v and h^2 a of an axial vibration gave 4500 N between steps with 0.1 N."""
    nodes = np.linspace(0.0, 1.0, 31)
    signs = np.resize([1.0, -1.0, -1.0, 1.0, 1.0], 31)[:, None]
    amplitude, rate = 1e-9, 1e6
    rows = State(*(amplitude * rate**k * signs for k in (0, 1, 2)), signs)
    state = Interval(nodes, rows, 0.5, nodes_per_step).at(BETWEEN)
    if nodes_per_step == 1:
        # The Lebesgue constant of a polynomial of degree 4 over its last step is 2.2.
        assert np.max(np.abs(state.q)) < 2.3 * amplitude
    assert np.max(np.abs(state.v)) < 2.3 * amplitude * rate


@pytest.mark.parametrize(("nodes", "nodes_per_step"), [(STEPS, 1), (STAGES, 3)])
def test_regression_a_jump_at_the_start_does_not_cause_oscillations(nodes, nodes_per_step):
    """Reactions overshot in the steps after a start or breakpoint where sections are damped."""
    values = np.linspace(1.0, 2.0, len(nodes))[:, None]
    values[0] = -1e3
    state = Interval(nodes, State(values, values, values, values), 0.5, nodes_per_step).at(BETWEEN)
    count = np.searchsorted(BETWEEN, nodes[1], side="right")
    for x in (state.a, state.lam):
        assert (np.diff(x[:count, 0]) > 0.0).all()
        # With uneven nodes, linear values by index are not exactly a line.
        assert x[count:].min() > 0.9
        assert x[count:].max() < 2.1


def test_a_trajectory_evaluates_each_time_in_its_interval():
    rising, falling = Polynomial([0.0, 1.0]), Polynomial([2.0, -1.0])
    still = Polynomial([0.0])
    t = np.linspace(0.0, 1.0, 5)
    first = make_interval(t, (rising, rising.deriv(), still, still), branch=0.5)
    # The reaction jumps at t = 1.
    second = make_interval(t + 1.0, (falling, falling.deriv(), still, still + 7.0), branch=1.5)
    times = np.array([0.0, 0.5, 1.0, 1.25, 2.0])
    rows, state = Trajectory((first, second)).at(times)
    assert_allclose(rows[:, 0], times, rtol=0.0, atol=0.0)
    # A breakpoint belongs to the interval that it ends.
    assert_allclose(rows[:, 1], [0.5, 0.5, 0.5, 1.5, 1.5], rtol=0.0, atol=0.0)
    assert_allclose(state.q[:, 0], [0.0, 0.5, 1.0, 0.75, 0.0], rtol=0.0, atol=1e-14)
    assert_allclose(state.lam[:, 0], [0.0, 0.0, 0.0, 7.0, 7.0], rtol=0.0, atol=1e-14)
    assert Trajectory((first, second)).end == 2.0


@pytest.mark.parametrize("nodes_per_step", [1, 3])
@pytest.mark.parametrize("steps", [1, 2, 5])
def test_polynomials_do_not_cross_jumps(nodes_per_step, steps):
    """At a sample of a controller, a step of length zero leads to the state after the jump."""
    fractions = C if nodes_per_step == 3 else [1.0]
    degree = min(steps, 3) if nodes_per_step == 1 else 3
    pieces = [[polynomial(degree, 4 * k + j) for j in range(4)] for k in range(3)]
    nodes, rows, starts = [], [], np.arange(3.0)
    for k, start in enumerate(starts):
        ends = np.linspace(0.0, 1.0, steps + 1)
        inner = [a + c * (b - a) for a, b in pairwise(ends) for c in fractions]
        t = start + np.concatenate([np.zeros(nodes_per_step if k else 1), inner])
        nodes.append(t)
        rows.append(np.stack([f(t) for f in pieces[k]]))
    q, v, a, lam = np.concatenate(rows, axis=1)[..., None]
    interval = Interval(np.concatenate(nodes), State(q, v, a, lam), 0.5, nodes_per_step)
    assert interval.step_count == 3 * steps
    for k, start in enumerate(starts):
        t = start + np.linspace(0.01, 1.0, 33)
        state = interval.at(t)
        for x, f in zip(state[1:], pieces[k][1:], strict=True):
            assert_allclose(x[:, 0], f(t), atol=1e-10)
        assert_allclose(interval.derivative_at(t).v[:, 0], pieces[k][1].deriv()(t), atol=1e-9)
        inside = start + (np.arange(steps) + 0.4) / steps
        after, before = (interval.at(inside + x).q for x in (1e-6, -1e-6))
        assert_allclose(interval.derivative_at(inside).q, (after - before) / 2e-6, atol=1e-7)
    # A state at the time of a jump is that before the jump.
    assert interval.at(np.array([1.0])).a[0, 0] == pytest.approx(pieces[0][2](1.0))
    works = interval.integrate_to_steps(interval.rows.a)
    integrals = [f[2].integ() for f in pieces]
    total = sum(f(k + 1.0) - f(float(k)) for k, f in enumerate(integrals))
    assert works[-1, 0] == pytest.approx(total)
    half = interval.integrate_to(np.array([1.5]), interval.rows.a, works)[0, 0]
    first, second = integrals[:2]
    assert half == pytest.approx(first(1.0) - first(0.0) + second(1.5) - second(1.0))


@pytest.mark.parametrize("nodes_per_step", [1, 3])
@pytest.mark.parametrize("width", [1e-6, 0.01, 0.03, 0.1])
def test_regression_jumps_within_steps_do_not_overshoot(nodes_per_step, width):
    """Polynomials through a reaction that jumped within a step exceeded it by up to 30 %."""

    def step(t):
        return np.tanh((t - 0.5) / width)

    ends = np.linspace(0.0, 1.0, 11) + 0.03
    nodes = ends
    if nodes_per_step == 3:
        nodes = np.append((ends[:-1, None] + np.append(0.0, C[:-1]) * 0.1).ravel(), ends[-1])
    t = np.linspace(nodes[0], nodes[-1], 2001)
    state = make_interval(nodes, (np.sin, np.sin, step, step), nodes_per_step=nodes_per_step).at(
        t, limited=True
    )
    for values in (state.a, state.lam):
        assert np.max(np.abs(values)) < 1.01
    assert_allclose(state.v[:, 0], np.sin(t), rtol=0.0, atol=1e-5)


MISSED = "the output rows miss its largest value"
QUIETLY = pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")


@QUIETLY
@pytest.mark.parametrize("integrator", [bd.Auto(), bd.Radau(1e-6), bd.GeneralizedAlpha(rtol=1e-5)])
def test_regression_tables_and_pages_contain_contacts_between_two_rows(integrator):
    """The rows contain no contact force, and the run had no warning."""
    run = bd.simulate(ball, integrator)
    assert run["stop.N"].max() == 0.0
    assert_allclose(run.step_extremes["stop.N [N]"].max, peak(1e10), rtol=0.02)
    extremes = tables.column_extremes(run.columns, run.step_extremes)
    assert_allclose(extremes["stop.N [N]"]["max"], peak(1e10), rtol=0.02)
    (table,) = (x for x in build_run_page(run, "ball")["tables"] if x["title"] == "Observed")
    assert_allclose(float(table["rows"][0][-1]), peak(1e10), rtol=0.02)
    live = summarize(run)["table"]["rows"]
    assert_allclose(float(live[0][-1]), peak(1e10), rtol=0.02)


@QUIETLY
def test_extremes_have_values_times_and_root_mean_squares():
    """An RMS of 0 N was that of the rows; its square is the integral of N^2 over the run."""
    run = bd.simulate(ball)
    times = np.unique(np.concatenate([run.t, np.linspace(0.4512, 0.4522, 4001)]))
    force = run.at_times(times)["stop.N"].to_numpy()
    expected = np.sqrt(np.trapezoid(force**2, times) / 0.6)
    extremes = run.step_extremes["stop.N"]
    low, low_time, high, high_time, rms = extremes
    assert (low, low_time, extremes.half_range) == (0.0, 0.0, 0.5 * high)
    assert_allclose(
        [high, high_time, rms], [force.max(), times[force.argmax()], expected], rtol=0.01
    )
    table = run.table()
    numbers = np.column_stack([run.t, table[["stop.N [N]"]]])
    values = measure_rows(["stop.N [N]"], numbers, run.step_extremes)["stop.N [N]"]
    assert_allclose(values[list(MEASURES).index("RMS")], expected, rtol=0.01)
    # Names without units were not found, and are kept by copies.
    copy = pickle.loads(pickle.dumps(run.step_extremes))
    assert copy["stop.N"] == extremes is run.step_extremes["stop.N [N]"]
    with pytest.raises(bd.BeamdaeError, match=r"results: there is no column 'stp'.*stop"):
        run.step_extremes["stp"]


@QUIETLY
@pytest.mark.parametrize("shift", [0.0, 100.0, -1e4])
def test_root_mean_squares_of_few_and_many_rows_agree_with_the_closed_form(shift):
    """The mean square of x0 + A cos is x0^2 + A^2 / 2 over whole periods."""
    period = 2.0 * np.pi / 20.0
    mech, mass = free_ball((shift + 0.1, 0.0), name="mass")
    origin = mech.ground.at(shift - 1.0, 0.0)
    mech.add(bd.Spring("spring", origin, mass.point, 400.0, 0.0, 1.0))
    for step in (period / 3.0, period / 200.0):
        method = bd.GeneralizedAlpha(period / 500.0)
        run = bd.simulate(mech, method, t_end=5.0 * period, output_step=step)
        squares = np.array([run.step_extremes[x].rms ** 2 for x in ("mass.x", "mass.x_dot")])
        assert_allclose(squares, [shift**2 + 0.005, 2.0], rtol=1e-3)


@QUIETLY
def test_regression_extremes_include_the_rows():
    """The largest force in the rows was larger than the one of `step_extremes`."""
    run = bd.simulate(ball(stiffness=1e6), bd.Radau(1e-4), output_step=2e-5)
    force, extremes = run["stop.N"], run.step_extremes["stop.N [N]"]
    assert extremes.max >= force.max()
    assert extremes.max_time == pytest.approx(run.t[np.argmax(force)], abs=2e-5)
    assert extremes.min == 0.0


@QUIETLY
@pytest.mark.slow(reason="half a second")
def test_regression_extremes_of_many_steps_need_the_memory_of_a_block():
    """The columns of all steps were stored: 388 MB for 1e5 steps of 160 columns."""
    mech, mass = free_ball((1.1, 0.0), name="mass", spring=(400.0, 0.0, 1.0))
    for k in range(20):
        mech.observe(f"mass {k}", mass.point)
    steps, step = 50_000, 1e-4
    run = bd.simulate(mech, bd.GeneralizedAlpha(step), t_end=steps * step, output_step=0.1)
    assert len(run.columns) == 84
    tracemalloc.start()
    try:
        extremes = run.step_extremes
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 16e6  # 32 MB for the columns of all steps
    assert_allclose([extremes["mass 7.x"].min, extremes["mass 7.x"].max], [0.9, 1.1], atol=1e-6)


def all_kinds():
    """Return a controlled beam with a short pulse, with columns of all kinds."""
    section = rectangle(0.002, damping=1e-4)
    mech, beam = clamped_beam(section, 2, 0.3, gravity=9.81)
    clamp = mech.part("clamp")
    strain = mech.sensor("gauge", beam.strain(0.1, "top"))
    current = mech.state("current", unit="A")
    current.follows(1e3 * (200.0 * strain - current))
    coil = mech.add(bd.Moment("coil", beam.at(0.1), 10.0 * current))
    spring = bd.Spring("spring", mech.ground.at(0.3, -0.1), beam.end, 100.0, 1.0)
    mech.add(spring)
    pulse = bd.ForceLaw(
        "pulse", beam.end, lambda p, t: (0.0, -30.0 * np.maximum(t * (1e-3 - t) * 4e6, 0.0))
    )
    mech.add(pulse)
    mech.observe("end", beam.end)
    mech.observe("accelerometer", bd.acceleration(beam.end))
    mech.observe("middle", bd.relative_motion(beam.at(0.15), mech.ground.at(0.0, 0.0)))
    mech.observe("deflection", beam.deflection(0.15))
    mech.observe("stress", beam.stress(0.1, "top"))
    mech.observe("root", beam.section_forces(0.0))
    mech.observe("clamp", clamp.reaction)
    mech.observe("coil", coil.moment)
    mech.observe("coil power", coil.power)
    mech.observe("spring", spring.force)
    mech.observe("spring power", spring.power)
    mech.observe("elongation", spring.elongation)
    mech.observe("pulse", pulse.force)
    mech.observe("pulse power", pulse.power)
    return mech


@QUIETLY
@pytest.mark.slow(reason="a model with all kinds of columns")
def test_regression_extremes_of_all_kinds_of_columns_include_the_steps():
    """Powers, strains and signals of controllers were neither corrected nor reported."""
    run = bd.simulate(all_kinds(), bd.Radau(), t_end=0.02, output_step=0.01)
    times = np.concatenate([x.t for x in run.trajectory.intervals])
    steps = run.at_times(times).columns
    dense = run.at_times(np.unique([*np.linspace(0.0, 0.02, 20_001), *times])).columns
    shown = tables.column_extremes(run.columns, run.step_extremes)
    reported = set(run.missed_peaks)
    units = set()
    for header, values in steps.items():
        unit, rows, size = header.partition(" [")[2][:-1], run.columns[header], np.ptp(values)
        if size < 1e-9:  # rounding errors
            continue
        low, high = shown[header]["min"], shown[header]["max"]
        assert dense[header].min() - 1e-3 * size <= low <= values.min() + 1e-3 * size
        assert values.max() - 1e-3 * size <= high <= dense[header].max() + 1e-3 * size
        if max(rows.min() - values.min(), values.max() - rows.max()) > 0.021 * size:
            units.add(unit)
            assert header in reported, header
    assert units >= {"N", "N m", "W", "Pa", "-", "A", "m", "m/s", "m/s^2", "rad/s^2"}


@QUIETLY
@pytest.mark.slow(reason="a fifth of a second")
def test_regression_sweeps_contain_contact_forces_between_rows(tmp_path):
    """The largest force of a sweep was that of the rows, 0 N."""
    stiffnesses = [1e9, 1e10]
    for _ in range(2):  # The second sweep reads the records of the first one.
        with pytest.warns(bd.BeamdaeWarning, match=MISSED):
            results = bd.sweep(ball, {"stiffness": stiffnesses}, folder=tmp_path)
        expected = [peak(stiffness) for stiffness in stiffnesses]
        assert_allclose(results.table["stop.N max [N]"], expected, rtol=0.01)


@QUIETLY
def test_regression_refined_runs_name_rows_without_the_peak():
    """A force that was 0 N in all rows had no warning."""
    with pytest.warns(bd.BeamdaeWarning, match=f"stop.N: {MISSED}"):
        run = bd.simulate(ball, bd.Radau(1e-3), accuracy=0.01)
    assert run.status.success
    assert_allclose(run.step_extremes["stop.N [N]"].max, peak(1e10), rtol=0.01)


@QUIETLY
@pytest.mark.parametrize("rows", [[0.0, 1.0], [0.0, 0.01, 1.0]])
def test_extremes_of_runs_with_few_rows_contain_peaks_between_steps(rows):
    mech, _ = free_ball(velocity=(1.0, 2.0), name="stone", gravity=9.81)
    solution = bd.Radau(1e-3).integrate(bd.equations_of_motion(mech), np.array(rows))
    assert_allclose(solution.step_extremes["stone.y"].max, 2.0**2 / (2.0 * 9.81), rtol=1e-6)


@QUIETLY
@pytest.mark.slow(reason="two runs of a falling frame")
def test_regression_extremes_contain_peaks_between_steps():
    """The largest force of a stiff contact was 2 % too small, because the steps missed it."""
    mech = bd.Mechanism()
    section = rectangle(0.006, damping=1e-6, material=ALLOY)
    line, velocity = bd.Line((0.0, 0.0), (0.0, 0.15)), (0.0, -5.0)
    post = mech.add(bd.Beam("post", line, section, 4, velocity=velocity))
    mech.add(bd.PointMass("foot", 0.005, on=post.start))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    contact = mech.add(bd.Contact("floor", post.start, floor, 1e10, exponent=1))
    mech.observe("floor", contact.force)
    forces = []
    for integrator in (bd.Radau(1e-3), bd.Radau(1e-8)):
        solution = bd.simulate(mech, integrator, t_end=0.05, output_step=1e-3)
        forces.append(solution.step_extremes["floor.N"].max)
    assert_allclose(forces[0], forces[1], rtol=3e-3)


@QUIETLY
def test_root_mean_square_is_over_time_and_not_over_rows():
    t, x = np.array([0.0, 1.0, 1.0, 1.0, 3.0]), np.array([1.0, 1.0, 5.0, 1.0, 1.0])
    assert MEASURES["RMS"](t, x) == pytest.approx(1.0)
    assert MEASURES["RMS"](t[:1], -x[:1]) == 1.0
