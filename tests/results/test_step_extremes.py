"""Extremes of observed columns at the steps of a run, in results, tables, pages and sweeps."""

import pickle
import tracemalloc

import numpy as np
import pytest
from mechanisms import ALLOY, clamped_beam, free_ball, rectangle
from mechanisms import dropped_ball as ball
from mechanisms import peak_of_dropped_ball as peak
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.live.session import summarize
from beamdae.report import tables
from beamdae.report.run_pages import build_run_page
from beamdae.studies.run_values import MEASURES, measure_rows

MISSED = "the output rows miss its largest value"

pytestmark = pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")


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


def test_regression_extremes_include_the_rows():
    """The largest force in the rows was larger than the one of `step_extremes`."""
    run = bd.simulate(ball(stiffness=1e6), bd.Radau(1e-4), output_step=2e-5)
    force, extremes = run["stop.N"], run.step_extremes["stop.N [N]"]
    assert extremes.max >= force.max()
    assert extremes.max_time == pytest.approx(run.t[np.argmax(force)], abs=2e-5)
    assert extremes.min == 0.0


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


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_sweeps_contain_contact_forces_between_rows(tmp_path):
    """The largest force of a sweep was that of the rows, 0 N."""
    stiffnesses = [1e9, 1e10]
    for _ in range(2):  # The second sweep reads the records of the first one.
        with pytest.warns(bd.BeamdaeWarning, match=MISSED):
            results = bd.sweep(ball, {"stiffness": stiffnesses}, folder=tmp_path)
        expected = [peak(stiffness) for stiffness in stiffnesses]
        assert_allclose(results.table["stop.N max [N]"], expected, rtol=0.01)


def test_regression_refined_runs_name_rows_without_the_peak():
    """A force that was 0 N in all rows had no warning."""
    with pytest.warns(bd.BeamdaeWarning, match=f"stop.N: {MISSED}"):
        run = bd.simulate(ball, bd.Radau(1e-3), accuracy=0.01)
    assert run.status.success
    assert_allclose(run.step_extremes["stop.N [N]"].max, peak(1e10), rtol=0.01)


@pytest.mark.parametrize("rows", [[0.0, 1.0], [0.0, 0.01, 1.0]])
def test_extremes_of_runs_with_few_rows_contain_peaks_between_steps(rows):
    mech, _ = free_ball(velocity=(1.0, 2.0), name="stone", gravity=9.81)
    solution = bd.Radau(1e-3).integrate(bd.equations_of_motion(mech), np.array(rows))
    assert_allclose(solution.step_extremes["stone.y"].max, 2.0**2 / (2.0 * 9.81), rtol=1e-6)


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


def test_root_mean_square_is_over_time_and_not_over_rows():
    t, x = np.array([0.0, 1.0, 1.0, 1.0, 3.0]), np.array([1.0, 1.0, 5.0, 1.0, 1.0])
    assert MEASURES["RMS"](t, x) == pytest.approx(1.0)
    assert MEASURES["RMS"](t[:1], -x[:1]) == 1.0
