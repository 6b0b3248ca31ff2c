"""Peaks of contact forces between output rows: warnings, extremes, sweeps and refined runs."""

import pickle
import re
import tracemalloc
import warnings
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.live.session import summarize
from beamdae.report.run_page import build_run_page
from beamdae.report.terminal import text_tables
from beamdae.results import missed_peaks
from beamdae.results.missed_parts import MissedPart
from beamdae.studies.column_measures import MEASURES, measure_table

MISSED = "the output rows miss its largest value"


@bd.model(t_end=0.6)
def ball(stiffness=1e10):
    """Return a ball of 1 kg that falls by 1 m onto a stop."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    body = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 1.0)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    stop = mech.add(bd.Contact("stop", body.point, floor, stiffness))
    mech.observe("stop", stop.force)
    return mech


def peak(stiffness):
    """Return the force at which the energy of a Hertzian contact is that of the fall."""
    return stiffness * (1.25 * 2.0 * 9.81 / stiffness) ** 0.6


@pytest.mark.parametrize("integrator", [bd.Auto(), bd.Radau(1e-6), bd.GeneralizedAlpha(rtol=1e-5)])
def test_regression_a_contact_between_two_rows_is_reported(integrator):
    """The rows contain no contact force, and the run had no warning."""
    with pytest.warns(bd.BeamdaeWarning, match=f"stop.N: {MISSED}"):
        run = bd.simulate(ball, integrator)
    assert run["stop.N"].max() == 0.0
    assert_allclose(run.step_extremes["stop.N [N]"].max, peak(1e10), rtol=0.02)
    extremes = text_tables.column_extremes(run.columns, run.step_extremes)
    assert_allclose(extremes["stop.N [N]"]["max"], peak(1e10), rtol=0.02)
    (table,) = (x for x in build_run_page(run, "ball")["tables"] if x["title"] == "Observed")
    assert_allclose(float(table["rows"][0][2]), peak(1e10), rtol=0.02)
    live = summarize(run)["table"]["rows"]
    assert_allclose(float(live[0][2]), peak(1e10), rtol=0.02)


def stop_of_formula(body):
    """Return a stop with a force of 1e10 N/m^1.5 that is a formula."""
    return bd.ForceLaw(
        "stop", body.point, lambda p, t: (0.0, 1e10 * bd.positive_part(-p.position[1]) ** 1.5)
    )


def test_extremes_unpack_into_values_and_times():
    extremes = missed_peaks.StepExtremes(-1.0, 0.1, 10.0, 0.5, 5.0)
    low, low_time, high, high_time, rms = extremes
    assert (low, low_time, high, high_time, rms) == (-1.0, 0.1, 10.0, 0.5, 5.0)


def stop_of_table(body):
    """Return a stop whose force is a table of the penetration."""
    depths = np.linspace(0.0, 4e-4, 41)
    table = bd.table(depths, 1e10 * depths**1.5)
    return bd.ForceLaw("stop", body.point, lambda p, t: (0.0, table(-p.position[1])))


@pytest.mark.parametrize("stop", [stop_of_formula, stop_of_table])
@pytest.mark.parametrize("integrator", [bd.Auto(), bd.GeneralizedAlpha(step=1e-6)])
def test_regression_peaks_of_formulas_and_tables_between_rows_are_reported(stop, integrator):
    """Only the forces of contacts were evaluated at the steps."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    body = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0), velocity=(0.0, -4.43)))
    mech.observe("stop", mech.add(stop(body)).force)
    mech.observe("ball", body.point)
    with pytest.warns(bd.BeamdaeWarning, match=f"stop.Fy: {MISSED}"):
        run = bd.simulate(mech, integrator, t_end=1e-3, output_step=5e-4)
    extremes = run.step_extremes
    assert_allclose(extremes["stop.Fy [N]"].max, peak(1e10), rtol=0.01)


def test_regression_rounding_errors_of_moments_are_no_peaks():
    """A moment of 1e-16 N m beside a force of 10 N was reported."""
    extremes = {
        "load.F [N]": missed_peaks.StepExtremes(0.0, 0.0, 10.0, 0.5, 5.0),
        "load.M [N m]": missed_peaks.StepExtremes(0.0, 0.0, 2e-16, 0.5, 1e-16),
    }
    observed = {"load.F [N]": np.array([0.0, 10.0]), "load.M [N m]": np.array([0.0, 1e-16])}
    assert not missed_peaks.find_missed_peaks(observed, extremes, 1.0)
    observed["load.F [N]"][1] = 9.0
    assert list(missed_peaks.find_missed_peaks(observed, extremes, 1.0)) == ["load.F [N]"]


def test_regression_noise_beside_a_constant_force_is_no_missed_peak():
    """In steady rotation of a ring, errors of the bending moment seemed to be peaks."""
    values = {"hoop.N [N]": (421.2, 421.2001), "hoop.M [N m]": (-1.024e-4, -1.023e-4)}
    extremes = {x: missed_peaks.StepExtremes(a, 0.0, b, 0.5, b) for x, (a, b) in values.items()}
    observed = {x: np.full(3, a) for x, (a, _) in values.items()}
    assert not missed_peaks.find_missed_peaks(observed, extremes, 0.6, rtol=1e-5)
    # Without the constant force, the moment is no noise.
    del observed["hoop.N [N]"], extremes["hoop.N [N]"]
    assert list(missed_peaks.find_missed_peaks(observed, extremes, 0.6, rtol=1e-5))


def test_regression_valleys_of_magnitudes_are_no_missed_peaks():
    """The smallest value of a largest stress was reported, which is near zero in vibrations."""
    extremes = {"stress.largest [Pa]": missed_peaks.StepExtremes(0.0, 0.1, 1e7, 0.5, 5e6)}
    observed = {"stress.largest [Pa]": np.array([2e6, 1e7])}
    assert list(missed_peaks.find_missed_peaks(observed, extremes, 1.0)) == list(observed)
    assert not missed_peaks.find_missed_peaks(observed, extremes, 1.0, magnitudes=observed)
    observed["stress.largest [Pa]"][1] = 9e6
    (missed,) = missed_peaks.find_missed_peaks(
        observed, extremes, 1.0, magnitudes=observed
    ).values()
    assert (missed.side, missed.value) == ("largest", 1e7)


@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_regression_only_largest_values_of_a_largest_stress_are_missed():
    """The rows of a vibrating strip missed the instants without stress."""
    mech = bd.Mechanism()
    steel = bd.Material.of("steel")
    section = bd.Section.rectangle(steel, width=0.02, height=0.004, damping=1e-3)
    strip = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), (0.5, 0.0)), section, elements=1))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), strip.start))
    mech.add(bd.Force("push", strip.end, (0.0, bd.sine(1.0, 5.0, 0.5 * np.pi))))
    mech.observe("stress", strip.largest_stress())
    # The rows are at the largest magnitudes of the force.
    run = bd.simulate(mech, bd.Radau(1e-5), t_end=0.2, output_step=0.1, start="equilibrium")
    assert {x.side for x in run.missed_peaks.values()} == {"largest"}


def test_regression_motions_that_vanish_by_symmetry_have_no_peaks():
    """Peaks of 1e-10 rad/s^2 beside an impact of 500 m/s^2 were reported as missed."""
    sizes = {
        "sensor.ay [m/s^2]": 500.0,
        "sensor.ax [m/s^2]": 1e-4,
        "sensor.angle_ddot [rad/s^2]": 2e-10,
        "small.ay [m/s^2]": 5e-4,
        "small.angle_ddot [rad/s^2]": 5e-3,
    }
    extremes = {x: missed_peaks.StepExtremes(0.0, 0.0, a, 0.5, a) for x, a in sizes.items()}
    observed = {x: np.array([0.0, 0.5 * a]) for x, a in sizes.items()}
    missed = missed_peaks.find_missed_peaks(observed, extremes, 0.1)
    real = {"sensor.ay [m/s^2]", "small.ay [m/s^2]", "small.angle_ddot [rad/s^2]"}
    assert set(missed) == real
    # Rotations are not compared to translations if these are not observed.
    observed = {"sensor.angle_ddot [rad/s^2]": np.array([0.0, 1e-10])}
    extremes = {x: extremes[x] for x in observed}
    assert set(missed_peaks.find_missed_peaks(observed, extremes, 0.1)) == set(observed)


def test_root_mean_squares_integrate_over_steps_between_rows():
    """An RMS of 0 N was that of the rows; its square is the integral of N^2 over the run."""
    with pytest.warns(bd.BeamdaeWarning, match=MISSED):
        run = bd.simulate(ball)
    times = np.unique(np.concatenate([run.t, np.linspace(0.4512, 0.4522, 4001)]))
    force = run.at_times(times)["stop.N"].to_numpy()
    expected = np.sqrt(np.trapezoid(force**2, times) / 0.6)
    assert_allclose(run.step_extremes["stop.N [N]"].rms, expected, rtol=0.01)
    (values,) = (
        x
        for header, x in measure_table(run.table(), run.step_extremes).items()
        if header == "stop.N [N]"
    )
    assert_allclose(values[list(MEASURES).index("RMS")], expected, rtol=0.01)


def test_the_times_of_the_warning_contain_the_peak():
    with pytest.warns(bd.BeamdaeWarning, match=MISSED):
        run = bd.simulate(ball)
    (missed,) = run.missed_peaks.values()
    times = missed.time + np.linspace(-2e-4, 2e-4, 401)
    assert_allclose(run.at_times(times)["stop.N"].max(), peak(1e10), rtol=1e-3)


@pytest.mark.slow(reason="half a second and more")
def test_rows_that_contain_the_peak_issue_no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = bd.simulate(ball(stiffness=1e4), t_end=0.6)
        fine = bd.simulate(ball(), t_end=0.4525, output_step=1e-6)
    assert not run.missed_peaks
    assert not fine.missed_peaks
    # Peaks outside the rows are no peaks between them.
    assert not run.at_times([0.0, 0.1, 0.2]).missed_peaks


def test_regression_peaks_of_smooth_motions_between_rows_are_reported():
    """Only short peaks of forces were reported; rows missed 40 % of the range of a position."""
    mech = bd.Mechanism()
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.1, 0.0)))
    spring = bd.SpringDamper("spring", mech.ground.at(-1.0, 0.0), ball.point, 400.0, 0.0, 1.0)
    mech.observe("spring", mech.add(spring).load_on("b"))
    mech.observe("ball", ball.point)
    mech.observe("acceleration", bd.acceleration(ball.point))
    with pytest.warns(bd.BeamdaeWarning, match="the output rows miss its"):
        run = bd.simulate(mech, t_end=0.9, output_step=0.3)
    assert run["ball.x"].min() > 0.06
    columns = {"ball.x [m]", "ball.x_dot [m/s]", "acceleration.ax [m/s^2]", "spring.Fx [N]"}
    assert columns <= set(run.missed_peaks)
    # Names without units selected values, but were not `in` the dictionary.
    for values in (run.missed_peaks, run.step_extremes):
        assert "ball.x" in values
        assert "ball" not in values
        assert 3 not in values
        assert values.get("ball.x") is values["ball.x"] is values["ball.x [m]"]
        assert values.get("ball.z") is None
        with pytest.raises(bd.BeamdaeError, match="did you mean"):
            values["ball.x_dt"]
    assert pickle.loads(pickle.dumps(run.step_extremes)).get("ball.x").min < 0.06
    assert_allclose(run.step_extremes["ball.x [m]"].min, -0.1, rtol=0.05)
    assert_allclose(run.step_extremes["spring.Fx [N]"].min, -40.0, rtol=0.05)
    # Accelerations of models without beams were omitted.
    assert_allclose(run.step_extremes["acceleration.ax [m/s^2]"].min, -40.0, rtol=0.05)


@bd.model(t_end=0.5)
def loaded_leaf():
    """Return a steel leaf with a tip mass under a sudden load, with a first period of 64 ms."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.06, 0.012, damping=2e-4)
    leaf = mech.add(bd.Beam("leaf", bd.Line((0.0, 0.0), (0.5, 0.0)), section, elements=2))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), leaf.start))
    mech.add(bd.PointMass("payload", 10.0, on=leaf.end))
    mech.add(bd.Force("load", leaf.end, (0.0, -1000.0)))
    mech.observe("tip", leaf.end)
    mech.observe("root", leaf.stress(0.0, "top"))
    return mech


def test_regression_extremes_at_steps_accept_names_without_units():
    """Only headers with units were found, and `run["tip.y"]` works; others raised a KeyError."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    mech.observe("ball", mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0))).point)
    extremes = bd.simulate(mech, t_end=0.1).step_extremes
    assert extremes["ball.y"] is extremes["ball.y [m]"]
    assert pickle.loads(pickle.dumps(extremes))["ball.y"] == extremes["ball.y"]
    with pytest.raises(bd.BeamdaeError, match=r"results: column must be .*ball\.y \[m\].*'bal'"):
        extremes["bal"]


@pytest.mark.slow(reason="half a second and more")
def test_regression_stresses_under_constant_loads_between_rows_are_reported():
    """Rows contained 9 % of a stress, and the run had no warning."""
    with pytest.warns(bd.BeamdaeWarning, match=MISSED.replace("largest", r"\w+")) as caught:
        run = bd.simulate(loaded_leaf, output_step=0.1)
    (warning,) = [str(x.message) for x in caught]
    peak, seen = run.step_extremes["root [Pa]"].max, run["root"].max()
    assert peak > 1.01 * seen
    # One column of each kind has values.
    assert f"root ({peak:.5g} Pa, rows {seen:.5g} Pa)" in warning
    assert re.search(r"tip\.x_dot|tip\.y_dot|tip\.angle_dot", warning)
    with pytest.warns(bd.BeamdaeWarning, match="the output rows miss .* root "):
        refined = bd.refine_until(loaded_leaf, columns=["root"], output_step=0.1)
    # The largest stress is accurate, although it is not in a row.
    assert refined.step_extremes["root [Pa]"].max == pytest.approx(peak, rel=0.02)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        bd.simulate(loaded_leaf, output_step=0.001)


@pytest.mark.slow(reason="a fifth of a second")
def test_regression_missed_extremes_come_before_notes_on_the_model():
    """The head of a page showed notes, and extremes that the rows miss were below them."""
    mech = loaded_leaf()
    late = bd.piecewise((5.0, lambda t: 0.0), lambda t: t - 5.0)
    mech.add(bd.Force("idle", mech.part("leaf").end, (0.0, late)))
    first, second = bd.simulate(mech, t_end=0.5, output_step=0.1).warnings
    assert "the output rows miss" in first
    assert second.startswith("idle: the part exerts no force")


@pytest.mark.slow(reason="half a second")
def test_regression_errors_of_constant_columns_are_no_peaks_and_no_vibrations():
    """The stress of a blade at constant speed varies by 3e-8; rows of 4 us were recommended."""
    speed = 314.0
    mech = bd.Mechanism()
    hub = mech.add(bd.RigidBody("hub", mass=4.0, inertia=0.02))
    mech.add(bd.Revolute("bearing", mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)))
    pair = mech.ground.at(0.0, 0.0), hub.at(0.0, 0.0)
    mech.add(bd.Driver("motor", *pair, law=lambda t: speed * t))
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.04, 0.006, damping=2e-5)
    blade = mech.add(
        bd.Beam("blade", bd.Line((0.12, 0.0), (0.47, 0.0)), section, strain="exact", elements=2)
    )
    mech.add(bd.Weld("clamp", hub.at(0.12, 0.0), blade.start))
    mech.observe("root", blade.stress(0.0, "top"))
    mech.observe("tip", blade.deflection(0.35))
    for rows in (5, 1000):
        settings = {"t_end": 0.05, "output_step": 0.05 / rows, "start": bd.rotation(speed)}
        run = bd.simulate(mech, bd.Auto(1e-5), **settings)
        assert 0.0 < np.ptp(run["root"]) < 1e-6 * run["root"].max()
        assert run.warnings == ()


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
        run = bd.refine_until(ball, accuracy=0.01)
    assert run.status.success
    assert_allclose(run.step_extremes["stop.N [N]"].max, peak(1e10), rtol=0.01)


def test_regression_extremes_include_the_rows():
    """The largest force in the rows was larger than the one of `step_extremes`."""
    run = bd.simulate(ball(stiffness=1e6), bd.Radau(1e-4), output_step=2e-5)
    force, extremes = run["stop.N"], run.step_extremes["stop.N [N]"]
    assert extremes.max >= force.max()
    assert extremes.max_time == pytest.approx(run.t[np.argmax(force)], abs=2e-5)
    assert extremes.min == 0.0


@pytest.mark.parametrize("rows", [60, 450, 600])
@pytest.mark.parametrize("integrator", [bd.GeneralizedAlpha(1e-3), bd.Radau(1e-4)])
def test_extremes_do_not_depend_on_the_steps_that_are_rows(integrator, rows, monkeypatch):
    """Columns at steps that are output rows are not evaluated again."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        run = bd.simulate(ball(stiffness=1e6), integrator, output_step=0.6 / rows)
    arguments = run.equations, run.trajectory, run.t, lambda: run.columns
    extremes = missed_peaks.measure_step_extremes(*arguments)
    assert len(extremes) > 0
    nothing_known = missed_peaks._KnownSteps(np.zeros(0, int), np.zeros((0, 1)))
    monkeypatch.setattr(missed_peaks, "_select_known_steps", lambda *_: nothing_known)
    assert extremes == missed_peaks.measure_step_extremes(*arguments)


def test_regression_extremes_of_many_steps_need_the_memory_of_a_block(monkeypatch):
    # The columns of all steps were stored: 388 MB for 1e5 steps of 160 columns.
    headers = [f"force {k} [N]" for k in range(80)]
    # One interval per event, and one with several blocks.
    limits = [0, 1, 2, 5, 50_000, 60_000]
    times = np.linspace(0.0, 2.0, limits[-1])
    shift = np.linspace(0.0, 1.0, len(headers))

    def evaluate(rows, q):
        columns = np.sin(rows[:, :1]) * np.ones(len(headers)) + shift
        columns[rows[:, 0] == times[30_000], :3] = np.nan, np.inf, -np.inf
        return columns

    monkeypatch.setattr(missed_peaks, "ObservedRows", lambda equations: evaluate)
    part = SimpleNamespace(gaps=(None,))
    mechanism = SimpleNamespace(parts={"stop": part})
    equations = SimpleNamespace(mechanism=mechanism, observed_headers=headers)
    equations.with_loads_of = lambda configuration: equations
    intervals = [
        SimpleNamespace(
            times=np.stack([times[a:b], times[a:b]], axis=1),
            nodes_per_step=1,
            state=(np.zeros((b - a, 1)),),
            configuration=None,
            t=times[a:b],
            find_steps=lambda t: None,
        )
        for a, b in pairwise(limits)
    ]
    tracemalloc.start()
    try:
        extremes = missed_peaks.measure_step_extremes(
            equations,
            SimpleNamespace(intervals=intervals, interval_index=lambda t: np.zeros(len(t), int)),
            np.array([0.0, 1.9]),
            lambda: dict(zip(headers, (np.sin([[0.0, 1.9]]) + shift[:, None]), strict=True)),
        )
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 16e6  # 38 MB for all steps
    assert list(extremes) == headers[3:]
    peak_time = times[np.argmax(np.sin(times))]
    for header, offset in zip(headers[3:], shift[3:], strict=True):
        x = extremes[header]
        assert_allclose([x.min, x.max], [offset, 1.0 + offset], atol=1e-8)
        assert x.min_time == 0.0
        assert x.max_time == pytest.approx(peak_time, abs=1e-4)


def all_kinds():
    """Return a controlled beam with a short pulse, with columns of all kinds."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.002, damping=1e-4)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (0.3, 0.0)), section, elements=2))
    clamp = mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    strain = mech.sensor("gauge", beam.strain(0.1, "top"))
    current = mech.state("current", unit="A")
    current.follows(1e3 * (200.0 * strain - current))
    coil = mech.add(bd.Moment("coil", beam.at(0.1), 10.0 * current))
    spring = bd.SpringDamper("spring", mech.ground.at(0.3, -0.1), beam.end, 100.0, 1.0)
    mech.add(spring)
    pulse = bd.ForceLaw(
        "pulse", beam.end, lambda p, t: (0.0, -30.0 * bd.positive_part(t * (1e-3 - t) * 4e6))
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
    with pytest.warns(bd.BeamdaeWarning, match="the output rows miss"):
        run = bd.simulate(all_kinds(), bd.Radau(), t_end=0.02, output_step=0.01)
    times = np.concatenate([x.t for x in run.trajectory.intervals])
    steps = run.at_times(times).columns
    dense = run.at_times(np.unique([*np.linspace(0.0, 0.02, 20_001), *times])).columns
    shown = text_tables.column_extremes(run.columns, run.step_extremes)
    reported = set(run.missed_peaks)
    units = set()
    for header, values in steps.items():
        unit, rows, size = header.partition(" [")[2][:-1], run.columns[header], np.ptp(values)
        if size < 1e-9:  # rounding errors
            continue
        low, high = shown[header]["min"], shown[header]["max"]
        assert dense[header].min() - 1e-3 * size <= low <= values.min() + 1e-3 * size
        assert values.max() - 1e-3 * size <= high <= dense[header].max() + 1e-3 * size
        if max(rows.min() - values.min(), values.max() - rows.max()) > 0.011 * size:
            units.add(unit)
            assert header in reported, header
    assert units >= {"N", "N m", "W", "Pa", "-", "A", "m", "m/s", "m/s^2", "rad/s^2"}


@pytest.mark.parametrize(("unit", "text"), [("-", "0.0002 at t"), ("m", "0.0002 m at t")])
def test_regression_dimensionless_peaks_have_no_unit(unit, text):
    """Messages showed 2.8e-05 - at t = 0.1 s."""
    missed = missed_peaks.MissedPeak(f"gauge [{unit}]", 0.1, "largest", 2e-4, 1e-4, 1e-4, 1e-4)
    assert text in missed.description


def test_regression_the_most_important_column_is_named_first():
    """The warning began with a column a thousand times smaller than others of its kind."""
    t = np.linspace(0.0, 1.0, 5)
    observed = {"pin.Fx [N]": 1e3 * t, "pin.Fy [N]": t, "tip.x [m]": t}
    peaks = {"pin.Fx [N]": 1200.0, "pin.Fy [N]": 5.0, "tip.x [m]": 1.1}
    extremes = {
        header: missed_peaks.StepExtremes(0.0, 0.0, value, 0.9, 1.0)
        for header, value in peaks.items()
    }
    missed = missed_peaks.find_missed_peaks(observed, extremes, 1.0)
    assert max(missed.values(), key=lambda peak: peak.error).column == "pin.Fy [N]"
    (message,) = missed_peaks.missed_peak_warnings(missed, 5)
    assert message.startswith("pin.Fx: the output rows miss its largest value, 1200 N at t = 0.9 s")
    assert "also in tip.x (1.1 m, rows 1 m), pin.Fy;" in message


@pytest.mark.parametrize(
    ("rotation", "rate", "is_reported"),
    [
        # A flexure stage: 3e-5 m/s at a length of 0.1 m.
        ("stage.angle_dot [rad/s]", 4e-4, False),
        ("stage.angle_dot [rad/s]", 0.03, True),
        # Translations of the center of a shaft are small beside its rotation.
        ("stage.angle_dot [rad/s]", 1e6, True),
        ("mirror.angle_dot [rad/s]", 4e-4, True),
        ("stage.angle_ddot [rad/s^2]", 4e-4, True),
        ("stage.angle [rad]", 4e-4, True),
        # 3e-9 m at this length, beside 0.2 mm.
        ("stage.angle [rad]", 3e-8, False),
        ("stage.angle [rad]", 3e-6, True),
        ("mirror.angle [rad]", 3e-8, True),
    ],
)
def test_regression_rates_that_are_small_beside_those_of_the_point_have_no_warning(
    rotation, rate, is_reported
):
    """Nearly each run of a flexure stage warned of its angular rate."""
    largest = {"stage.x_dot [m/s]": 0.1, "stage.x [m]": 2e-4, rotation: rate}
    t = np.linspace(0.0, 1.0, 5)
    observed = {header: 0.5 * x * t for header, x in largest.items()}
    extremes = {
        header: missed_peaks.StepExtremes(0.0, 0.0, x, 0.9, x) for header, x in largest.items()
    }
    missed = missed_peaks.find_missed_peaks(observed, extremes, 0.1)
    assert list(missed) == list(largest)
    remaining = missed_peaks.remove_minor_peaks(missed, extremes, 0.1)
    assert "stage.x_dot [m/s]" in remaining
    assert (rotation in remaining) == is_reported


@pytest.mark.parametrize(
    ("column", "companion", "miss", "is_reported"),
    [
        ("edge.y_dot [m/s]", "edge.y [m]", 0.08, False),
        ("edge.y_dot [m/s]", "edge.y [m]", 0.12, True),
        ("edge.angle_dot [rad/s]", "edge.angle [rad]", 0.08, False),
        ("shock.angle_ddot [rad/s^2]", "shock.ax [m/s^2]", 0.08, False),
        ("shock.ax [m/s^2]", "shock.ay [m/s^2]", 0.08, True),
        # Observed on its own.
        ("speed [m/s]", "edge.y [m]", 0.08, True),
    ],
)
def test_regression_small_misses_of_rates_of_points_have_no_warning(
    column, companion, miss, is_reported
):
    """Most runs of a wiper warned of velocities of its edge, whose position was observed."""
    t = np.linspace(0.0, 1.0, 5)
    observed = {column: 2.0 * t * (1.0 - 0.5 * miss), companion: t}
    extremes = {
        column: missed_peaks.StepExtremes(0.0, 0.0, 2.0, 0.9, 1.0),
        companion: missed_peaks.StepExtremes(0.0, 0.0, 1.0, 1.0, 1.0),
    }
    missed = missed_peaks.find_missed_peaks(observed, extremes, 1.0)
    assert list(missed) == [column]
    assert (column in missed_peaks.remove_minor_peaks(missed, extremes, 1.0)) == is_reported


@pytest.mark.parametrize(
    ("position", "miss", "is_reported"),
    [
        ("tip.y [m]", 0.2, False),
        ("tip.y [m]", 0.35, True),
        ("other.y [m]", 0.2, True),
    ],
)
def test_small_misses_of_rates_of_points_in_parts_of_a_run_have_no_warning(
    position, miss, is_reported
):
    part = MissedPart(0.1, 0.2, 1, 0.5, 0.5 - miss)
    extremes = {
        "tip.y_dot [m/s]": missed_peaks.StepExtremes(-1.0, 0.0, 1.0, 1.0, 1.0, (part,)),
        position: missed_peaks.StepExtremes(-1.0, 0.0, 1.0, 1.0, 1.0),
    }
    observed = dict.fromkeys(extremes, np.linspace(-1.0, 1.0, 5))
    missed = missed_peaks.find_missed_parts(
        {}, observed, extremes, 1.0, 0.0, lambda: (0.0, 0.0), ()
    )
    assert bool(missed) == is_reported


def test_regression_peaks_that_hardly_differ_from_the_rows_have_no_warning():
    """A force of -131.272 N, of which the rows reached -131.265 N, had a warning."""
    t = np.linspace(0.0, 1.0, 5)
    observed = {"root.N [N]": 131.265 - 0.1 * t, "tip.x [m]": 131.265 - 0.1 * t}
    extremes = {
        header: missed_peaks.StepExtremes(131.165, 1.0, 131.272, 0.1, 131.0) for header in observed
    }
    missed = missed_peaks.find_missed_peaks(observed, extremes, 1.0)
    assert set(missed) == set(observed)
    (message,) = missed_peaks.missed_peak_warnings(missed, 5)
    # Positions depend on an origin.
    assert message.startswith("tip.x: ")
    assert "root.N" not in message


def test_regression_runs_of_two_rows_have_no_missed_peaks():
    """A run whose rows were its start and end warned of all extremes of the motion."""
    t = np.array([0.0, 1.0])
    missed = missed_peaks.find_missed_peaks(
        {"tip.x [m]": t}, {"tip.x [m]": missed_peaks.StepExtremes(0.0, 0.0, 2.0, 0.5, 1.0)}, 1.0
    )
    assert missed
    assert not list(missed_peaks.missed_peak_warnings(missed, 2))


def test_small_deflections_of_large_motions_have_missed_peaks():
    """Deflections of 0.1 mm of a crane that travels by 10 m are accurate with rtol=1e-3."""
    t = np.linspace(0.0, 1.0, 5)
    observed = {"trolley.x [m]": 10.0 * t, "jib.transverse [m]": 1e-4 * t}
    extremes = {
        "trolley.x [m]": missed_peaks.StepExtremes(0.0, 0.0, 10.0, 1.0, 1.0),
        "jib.transverse [m]": missed_peaks.StepExtremes(0.0, 0.0, 2e-4, 0.9, 1e-4),
    }
    missed = missed_peaks.find_missed_peaks(observed, extremes, 10.0, rtol=1e-3)
    assert list(missed) == ["jib.transverse [m]"]


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("elements", [4, 8])
def test_regression_stresses_of_damping_at_an_impact_are_no_peaks(elements):
    """Stresses just after an impact grew with the number of elements, and were recommended."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    steel = bd.Material.of("steel")
    section = bd.Section.rectangle(steel, width=0.012, height=0.0012, damping=3e-5)
    leaf = mech.add(bd.Beam("leaf", bd.Line((0.0, 0.0), (0.12, 0.0)), section, elements=elements))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), leaf.start))
    mech.add(bd.PointMass("hammer", 0.03, on=leaf.end))
    mech.add(bd.Force("magnet", leaf.end, (0.0, -20.0)))
    gap = bd.LineSurface(mech.ground.at(0.0, -0.002), (1.0, 0.0)).gap(leaf.end)
    mech.when(gap, direction="down", do=bd.impact(gap, restitution=0.6), name="hit")
    mech.observe("stress", leaf.largest_stress())
    run = bd.simulate(mech, t_end=4e-3, output_step=1e-4)
    assert run.step_extremes["stress.largest"].max > 2.0 * run["stress.largest"].max()
    about_stress = [x for x in run.model_warnings if x.startswith("stress.largest")]
    assert len(about_stress) == 1
    assert "that of the damping of the section at a jump of the velocities" in about_stress[0]
    assert not any("stress" in x for x in run.warnings if "read these values" in x)


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_stresses_of_small_damping_that_peak_late_are_no_peaks():
    """Beside a mass, the stress peaks after the element has turned: it was a peak to be used."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("steel"), 0.03, 0.008, damping=5e-6)
    curve = bd.Line((0.0, 0.0), (0.4, 0.0))
    beam = mech.add(bd.Beam("beam", curve, section, elements=16, velocity=(0.0, -2.4)))
    mech.add(bd.PointMass("mass", 2.0, on=beam.end))
    gap = bd.LineSurface(mech.ground.at(0.4, -1e-5)).gap(beam.end)
    mech.when(gap, 0.0, "down", bd.impact(gap, restitution=0.6), name="hit")
    mech.observe("stress", beam.largest_stress())
    texts = [x for x in bd.simulate(mech, t_end=1e-4).warnings if x.startswith("stress.largest")]
    assert any("that of the damping of the section" in x for x in texts)
    assert not any("read these values from step_extremes" in x for x in texts)


@pytest.mark.parametrize(
    ("later", "row_value", "words"),
    [
        (0.1, 1.4, "use the rows (1.4 N), or"),
        (2.5, 1.4, "use the value after it (2.5 N at t = 1.0001 s), or"),
        (1.5, 1.4, "use the value after it (1.5 N at t = 1.0001 s), or"),
        (7.2, 5.8, None),
        (7.2, 7.1, None),
    ],
    ids=["damping", "damping and structure", "little more", "structure", "structure, near rows"],
)
def test_regression_forces_that_last_after_a_jump_are_not_those_of_damping(later, row_value, words):
    """The rows, 20 % too low, were advised for the converged force of a latch."""
    peak = missed_peaks.MissedPeak(
        "latch.Fx [N]", 1.0, "largest", 7.3, row_value, half_range=6.0, largest_half_range=6.0
    )
    peaks, asked = {peak.column: peak}, []

    def observe_at(times):
        asked.extend(times)
        return {peak.column: np.full(len(times), later)}

    of_damping = missed_peaks.select_peaks_of_damping(peaks, [1.0], 1e-4, 2.0, observe_at)
    assert asked == [1.0001]
    texts = list(missed_peaks.damping_peak_warnings(of_damping, True))
    assert [words in x for x in texts] == ([] if words is None else [True])
    assert not missed_peaks.select_peaks_of_damping(peaks, [0.9], 1e-4, 2.0, observe_at)


@pytest.mark.slow(reason="a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_regression_a_latch_between_panels_names_the_force_without_damping():
    """The axial force is 4.5 N with 4 to 16 elements, its peak 6.9 to 16 N, and the rows 2.9 N."""
    mech = bd.Mechanism()
    carbon = bd.Material(E=70e9, nu=0.3, rho=1600.0)
    section = bd.Section.rectangle(carbon, width=0.05, height=2e-3, damping=1e-4)
    corners = (0.0, 0.0), (1.0, 0.0), (1.0 + np.cos(0.3), np.sin(0.3))
    inner, outer = (
        mech.add(bd.Beam(name, bd.Line(*ends), section, elements=8, formulation="exact"))
        for name, ends in (("inner", corners[:2]), ("outer", corners[1:]))
    )
    mech.add(bd.Weld("root", mech.ground.at(0.0, 0.0), inner.start))
    mech.add(bd.PointMass("tip", 0.1, on=outer.end))
    points = inner.end, outer.start
    hinge, latch = mech.add(bd.Revolute("hinge", *points)), mech.add(bd.Weld("latch", *points))
    mech.add(bd.TorsionSpring("spring", *points, 0.5, free_angle=-1.5))
    mech.deactivate(latch)
    mech.observe("panel", bd.relative_motion(outer.start, inner.end))
    mech.observe("latch", latch.reaction)
    actions = [bd.deactivate(hinge), bd.activate(latch, as_is=True)]
    mech.when("panel.angle", crosses=0.0, do=actions, name="latched")
    run = bd.simulate(mech, t_end=0.045, output_step=5e-3)
    (text,) = (x for x in run.warnings if "at a jump of the velocities" in x)
    value = float(text.split("use the value after it (")[1].split()[0])
    assert run.step_extremes["latch.Fx"].min < -9.0
    assert "bd.impact" not in text
    np.testing.assert_allclose(value, -4.3, rtol=0.05)


@pytest.mark.parametrize("rows", [[0.0, 1.0], [0.0, 0.01, 1.0]])
def test_extremes_of_runs_with_few_rows_contain_peaks_between_steps(rows):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    stone = mech.add(bd.PointMass("stone", 1.0, at=(0.0, 0.0), velocity=(1.0, 2.0)))
    mech.observe("stone", stone.point)
    solution = bd.Radau(1e-3).integrate(bd.equations_of_motion(mech), np.array(rows))
    assert_allclose(solution.step_extremes["stone.y"].max, 2.0**2 / (2.0 * 9.81), rtol=1e-6)


@pytest.mark.slow(reason="two runs of a falling frame")
def test_regression_extremes_contain_peaks_between_steps():
    """The largest force of a stiff contact was 2 % too small, because the steps missed it."""
    mech = bd.Mechanism()
    section = bd.Section.rectangle(bd.Material.of("aluminum"), 0.02, 0.006, damping=1e-6)
    line, velocity = bd.Line((0.0, 0.0), (0.0, 0.15)), (0.0, -5.0)
    post = mech.add(bd.Beam("post", line, section, 4, velocity=velocity))
    mech.add(bd.PointMass("foot", 0.005, on=post.start))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    contact = mech.add(bd.Contact("floor", post.start, floor, 1e10, exponent=1))
    mech.observe("floor", contact.force)
    forces = []
    for integrator in (bd.Radau(1e-3), bd.Radau(1e-8)):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", bd.BeamdaeWarning)
            solution = bd.simulate(mech, integrator, t_end=0.05, output_step=1e-3)
        forces.append(solution.step_extremes["floor.N"].max)
    assert_allclose(forces[0], forces[1], rtol=3e-3)
