"""Fits with several experiments, long tables, CSV files and unknown properties of sensors."""

import re

import numpy as np
import pandas as pd
import pytest
from mechanisms import free_ball
from test_fit import METHOD, NOISE, TRUE, oscillator

import beamdae as bd
from beamdae.analysis.fit.data import read_fit_data, read_measurements
from beamdae.analysis.fit.problem import FitProblem
from beamdae.analysis.fit.sensors import read_sensors
from beamdae.analysis.sensitivities.observable_derivatives import differentiate_column
from beamdae.report.descriptions import describe

SLOW = pytest.mark.slow(reason="half a second and more")
TIMES = np.linspace(0.2, 2.0, 37)
SHIFT, SCALE, OFFSET = 0.013, 1.2, -0.7


def record(times=TIMES, shift=0.0, **parameters):
    run = bd.simulate(oscillator(**TRUE | parameters), METHOD, t_end=3.0).at_times(times - shift)
    return run["mass.x"].to_numpy(), run["mass.x_dot"].to_numpy()


def fit_sensors(data, columns, scale=(), shift=()):
    measured = read_measurements("fit", data, columns)
    fitted = read_fit_data(measured, {"": ["mass.x [m]", "mass.y [m]"]}, 1.0)
    return read_sensors(fitted, {"scale": scale, "shift": shift})


@pytest.fixture(scope="module")
def sensed():
    """Data of a position sensor with scale, offset and shift, and of an exact velocity sensor."""
    position, _ = record(shift=SHIFT)
    _, velocity = record()
    return {"t [s]": TIMES, "mass.x": SCALE * position + OFFSET, "mass.x_dot": velocity}


SENSOR = {"scale": "mass.x", "offset": ["mass.x [m]"], "shift": {"mass.x": (-0.1, 0.1)}}
SIGMA = {"mass.x": NOISE, "mass.x_dot": NOISE}


@SLOW
def test_sensors_are_estimated_with_the_parameters(sensed):
    fit = bd.fit(oscillator, sensed, list(TRUE), METHOD, sigma=SIGMA, **SENSOR)
    assert fit.parameters == pytest.approx(TRUE, rel=1e-6)
    assert fit.sensors == pytest.approx(
        {"shift of mass.x": SHIFT, "scale of mass.x": SCALE, "offset of mass.x [m]": OFFSET},
        rel=1e-5,
    )
    assert fit.names == (*TRUE, *fit.sensors)
    expected = {"shift": SHIFT, "clock": 1.0, "scale": SCALE, "offset": OFFSET}
    assert fit.sensor_of(0) == pytest.approx(expected, rel=1e-5)
    perfect = {"shift": 0.0, "clock": 1.0, "scale": 1.0, "offset": 0.0}
    assert fit.sensor_of(TIMES.size) == perfect


@SLOW
@pytest.mark.parametrize("bounds", [(0.0, 0.1), (-0.1, 0.0)], ids=["lower", "upper"])
def test_search_from_a_bound_of_a_shift_reaches_the_minimum(bounds):
    shift = SHIFT if bounds[1] else -SHIFT
    data = {"t [s]": TIMES, "mass.x": record(shift=shift)[0]}
    fit = bd.fit(
        oscillator, data, list(TRUE), METHOD, sigma=NOISE, log=list(TRUE), shift={"mass.x": bounds}
    )
    assert fit.status.success
    assert fit.parameters == pytest.approx(TRUE, rel=1e-5)
    assert fit.sensors["shift of mass.x"] == pytest.approx(shift, rel=1e-4)


@SLOW
@pytest.mark.parametrize("name", list(TRUE))
def test_search_from_a_bound_of_a_parameter_in_log_reaches_the_minimum(name):
    data = {"t [s]": TIMES, "mass.x": record()[0]}
    first = oscillator.parameters[name]
    bounds = {name: (first, 10.0 * first)}
    fit = bd.fit(oscillator, data, list(TRUE), METHOD, sigma=NOISE, log=list(TRUE), bounds=bounds)
    assert fit.status.success
    assert fit.parameters == pytest.approx(TRUE, rel=1e-5)


@SLOW
def test_projected_jacobian_agrees_with_differences(sensed):
    noise = np.random.default_rng(2).normal(scale=0.02, size=TIMES.size)
    data = {**sensed, "mass.x": sensed["mass.x"] + noise}
    problem = FitProblem(oscillator, data, list(TRUE), METHOD, SIGMA, sensors=SENSOR)
    # Away from the solution, where the term that vanishes with the residuals is large.
    values = np.array([43.0, 0.5, 0.0312])
    jacobian = problem.evaluate(values).projected_jacobian
    for k, size in enumerate(values):
        change = 1e-4 * size * np.eye(3)[k]
        low, high = (problem.evaluate(values + side * change).residuals for side in (-1.0, 1.0))
        expected = (high - low) / (2e-4 * size)
        np.testing.assert_allclose(
            jacobian[:, k], expected, atol=1e-6 * np.abs(expected).max(), rtol=0.0
        )


@pytest.mark.parametrize("method", [METHOD, bd.Radau(), bd.Ida()], ids=lambda x: x.method)
def test_rates_are_the_derivatives_of_the_dense_output(method):
    run = bd.simulate(oscillator(**TRUE), method, t_end=0.5)
    times, change = np.array([0.0333, 0.1234, 0.4321]), 1e-6
    low, high = run.at_times(times - change).columns, run.at_times(times + change).columns
    for name in ("mass.x [m]", "mass.x_dot [m/s]"):
        expected = (high[name] - low[name]) / (2.0 * change)
        # Rounding errors of the differences.
        rates = differentiate_column(run, name, times)
        np.testing.assert_allclose(rates, expected, rtol=1e-6, atol=1e-7)


@SLOW
def test_experiments_share_parameters_and_have_their_own_sensors():
    light, _ = record()
    heavy, _ = record(mass=2.0)
    rows = {"light": light + 0.3, "heavy": heavy - 0.2}
    data = {name: {"t [s]": TIMES, "mass.x": x} for name, x in rows.items()}
    offsets = [("light", "mass.x"), ("heavy", "mass.x")]
    fit = bd.fit(
        oscillator,
        data,
        list(TRUE),
        METHOD,
        sigma=NOISE,
        experiments={"heavy": {"mass": "2.0"}},
        offset=offsets,
    )
    assert fit.parameters == pytest.approx(TRUE, rel=1e-6)
    assert list(fit.sensors.values()) == pytest.approx([0.3, -0.2], abs=1e-7)
    assert fit.solutions["heavy"].model["parameters"]["mass"] == 2.0
    with pytest.raises(bd.BeamdaeError, match="several experiments"):
        _ = fit.solution
    table = fit.residual_table()
    assert list(table["experiment"].unique()) == ["light", "heavy"]
    np.testing.assert_allclose(table["model"], table["value"], atol=1e-6)


@SLOW
def test_long_csv_in_any_order_equals_the_wide_table(tmp_path, sensed):
    frame = pd.DataFrame(sensed)
    long = frame.melt("t [s]", var_name="observable").assign(sigma=NOISE, experiment=1)
    path = tmp_path / "long.csv"
    long.sample(frac=1.0, random_state=0).to_csv(path, index=False)
    wide = bd.fit(oscillator, frame, list(TRUE), METHOD, sigma=NOISE, **SENSOR)
    fit = bd.fit(oscillator, path, list(TRUE), METHOD, **SENSOR)
    assert fit.parameters == pytest.approx(dict(wide.parameters), rel=1e-12)
    assert list(fit.solutions) == ["1"]
    np.testing.assert_allclose(fit.covariance, wide.covariance, rtol=1e-6)
    assert fit.is_sigma_known


@pytest.mark.slow(reason="several fits")
def test_units_of_long_sigma_set_the_weights(sensed):
    rows = [("mass.x", 0.5, 1.1, 0.1), ("mass.x_dot", 0.7, 0.2, 10.0)]
    table = pd.DataFrame(rows, columns=["observable", "t [s]", "value", "sigma"])
    problem = FitProblem(oscillator, table, "stiffness", METHOD)
    evaluation = problem.evaluate(problem.first_values)
    run = evaluation.runs[""].solution
    model = [run["mass.x"].iloc[0], run["mass.x_dot"].iloc[1]]
    expected = [(model[0] - 1.1) / 0.1, (model[1] - 0.2) / 10.0]
    np.testing.assert_allclose(evaluation.residuals, expected, rtol=1e-12)


@SLOW
def test_intervals_use_the_t_distribution_if_sigma_is_estimated():
    noise = np.random.default_rng(5).normal(scale=NOISE, size=5)
    times = TIMES[::8]
    data = {"t [s]": times, "mass.x": record(times)[0] + noise}
    fit = bd.fit(oscillator, data, list(TRUE), METHOD)
    # Quantile 0.975 of the t distribution with three degrees of freedom, from tables.
    assert fit.quantile == pytest.approx(3.182446, rel=1e-6)
    table = fit.table()
    half_width = (table["upper 95 %"] - table["lower 95 %"]) / 2.0
    np.testing.assert_allclose(half_width, 3.182446 * fit.standard_deviations, rtol=1e-6)


@SLOW
def test_prediction_agrees_with_refitted_derivatives():
    position, _ = record()
    data = {"t [s]": TIMES, "mass.x": position}
    fit = bd.fit(oscillator, data, list(TRUE), METHOD, sigma=NOISE)
    band = fit.prediction("mass.x_dot")
    changes = []
    for name, value in fit.parameters.items():
        runs = [
            bd.simulate(oscillator(**{**fit.parameters, name: value * x}), METHOD, 2.0)
            for x in (1.0 - 1e-4, 1.0 + 1e-4)
        ]
        low, high = (run.at_times(TIMES)["mass.x_dot"].to_numpy() for run in runs)
        changes.append((high - low) / (2e-4 * value))
    gradient = np.array(changes)
    expected = np.sqrt(np.einsum("ij,ik,kj->j", gradient, fit.covariance, gradient))
    np.testing.assert_allclose(band["standard deviation"], expected, rtol=1e-4)
    np.testing.assert_allclose(band["upper 95 %"] - band["value"], 1.959964 * expected, rtol=1e-4)


@SLOW
def test_prediction_of_undetermined_columns_is_infinite():
    position, _ = record()
    data = {"t [s]": TIMES, "mass.x": position}
    # Only the ratios of stiffness and damping to mass are determined, and so is the motion.
    fit = bd.fit(oscillator, data, [*TRUE, "mass"], METHOD, sigma=NOISE)
    assert np.isfinite(fit.prediction("mass.x")["standard deviation"]).all()
    assert np.isinf(fit.standard_deviations).all()


@pytest.mark.slow(reason="ten fits")
def test_profile_of_an_almost_linear_parameter_agrees_with_the_covariance():
    position, _ = record()
    data = {"t [s]": TIMES, "mass.x": position}
    fit = bd.fit(oscillator, data, list(TRUE), METHOD, sigma=NOISE)
    profile = fit.profile("stiffness")
    table = fit.table().loc["stiffness"]
    # Deviations from linearity over an interval of 0.3 % of the stiffness.
    assert profile.interval == pytest.approx((table["lower 95 %"], table["upper 95 %"]), rel=1e-4)
    deviations = (profile.values - fit.parameters["stiffness"]) / fit.standard_deviations[0]
    np.testing.assert_allclose(profile.increases, deviations**2, atol=0.05)
    assert list(profile.table()) == ["stiffness", "increase of chi-square", "damping"]


@pytest.mark.slow(reason="fits of an undetermined parameter")
def test_profile_of_an_undetermined_parameter_is_flat():
    position, _ = record()
    data = {"t [s]": TIMES, "mass.x": position}
    bounds = {"mass": (0.92, 1.08)}
    names = [*TRUE, "mass"]
    fit = bd.fit(oscillator, data, names, METHOD, sigma=NOISE, bounds=bounds)
    profile = fit.profile("mass")
    assert profile.interval == pytest.approx((0.92, 1.08))
    assert np.abs(profile.increases).max() < 1e-3
    # Without bounds, such a profile would not end.
    with pytest.raises(bd.BeamdaeError, match=r"^profile: max_points must be at most 1000, got 1e"):
        fit.profile("mass", max_points=1e12)


@SLOW
def test_files_and_figures(tmp_path, sensed):
    fit = bd.fit(oscillator, sensed, list(TRUE), METHOD, sigma=SIGMA, **SENSOR)
    table = pd.read_csv(fit.to_csv(tmp_path / "fit.csv"))
    assert list(table["parameter"]) == list(fit.names)
    np.testing.assert_allclose(table["value"], fit.values, rtol=1e-15)
    page = fit.page(tmp_path / "fit.html").read_text(encoding="utf-8")
    assert "offset of mass.x" in page
    assert "<td>1.2</td>" in fit._repr_html_()
    figure = fit.plot().figure
    assert len(figure.axes) == 4
    np.testing.assert_allclose(
        figure.axes[1].lines[-1].get_ydata(), fit.residual_table()["residual"][:37]
    )


@bd.model(t_end=1.0)
def ball(height=0.55, restitution=0.7, action="bounce"):
    """Ball that falls from rest and bounces, or stops the run at the floor."""
    mech, body = free_ball((0.0, height), gravity=9.81)
    gap = bd.LineSurface(mech.ground.at(0.0, 0.0)).gap(body.point)
    does = bd.impact(gap, restitution) if action == "bounce" else "stop"
    mech.when(gap, 0.0, "down", does, name="floor")
    return mech


@SLOW
@pytest.mark.parametrize("method", [bd.GeneralizedAlpha(step=0.01), bd.Radau()], ids=["alpha", "r"])
def test_restitution_and_delay_are_estimated_through_impacts(method):
    fall = np.sqrt(2.0 * 0.5 / 9.81)
    times = np.linspace(0.05, 0.8, 31)
    air = times - 0.01 - fall
    # Closed form of the first flight and of the flight after the first impact.
    height = np.where(
        air < 0.0, 0.5 - 0.5 * 9.81 * (times - 0.01) ** 2, 0.8 * 9.81 * fall * air - 4.905 * air**2
    )
    data = {"t [s]": times, "ball.y": height}
    fit = bd.fit(ball, data, ["height", "restitution"], method, sigma=1e-3, shift="ball.y")
    # Both methods are exact for parabolas; impact times have the tolerance of events.
    assert fit.values == pytest.approx([0.5, 0.8, 0.01], rel=1e-6)


def test_runs_that_stop_before_the_last_data_are_rejected():
    data = {"t [s]": [0.1, 0.6], "ball.y": [0.5, 0.0]}
    with pytest.raises(bd.BeamdaeError, match=r"before the last data at 0.6 s"):
        bd.fit(ball, data, "height", METHOD, sigma=1.0, parameters={"action": "stop"})


LONG = {"observable": ["mass.x"] * 3, "t [s]": [0.1, 0.2, 0.3], "value": [1.0, 1.1, 1.2]}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"data": {"t [s]": [1.0], "mass.x": [1.0], "mass.x [m]": [1.0]}}, "are the same column"),
        ({"data": {"t [s]": [1.0], "mass.x [kg]": [1.0]}}, "is in kg, but the model .* in m"),
        (
            {"data": {"t [m]": [1.0], "mass.x": [1.0]}},
            "times 't \\[m\\]' of data must be in a unit",
        ),
        ({"data": {"t [s]": [1.0], "t [ms]": [1.0], "mass.x": [1.0]}}, "are both times"),
        ({"data": {"t [s]": [1.0, 2.0], "mass.x": ["1", "a"]}}, "got 'a' in row 2"),
        ({"data": {"t [s]": [1.0], "mass.x": [np.inf]}}, "got inf in row 1"),
        ({"data": "missing.csv"}, "'missing.csv' cannot be read"),
        ({"data": LONG | {"t [s]": [0.1, 0.2, 0.2]}}, "got 0.2 s again in row 3"),
        (
            {"data": LONG | {"t [s]": [0.1, 0.2, np.nan]}},
            "must be finite, not negative and different",
        ),
        ({"data": LONG | {"sigma": [0.1, 0.0, 0.1]}, "sigma": None}, "must be positive.*row 2"),
        ({"data": LONG | {"sigma": [0.1, 0.1, 0.1]}}, "sigma is given twice"),
        ({"data": LONG | {"units": ["m"] * 3}}, "got columns .*'units'"),
        ({"data": LONG | {"observable": ["mass.x", None, "mass.x"]}}, "got (None|nan) in row 2"),
        (
            {"data": LONG | {"observable": np.sin}},
            "must contain names .*, got <ufunc 'sin'> in row 1",
        ),
        ({"data": {"a": LONG["value"], "value": LONG["value"]}}, "must contain the column"),
        ({"experiments": {"b": {}}}, "for which there are no data"),
        ({"experiments": {"": {"stiffness": 2.0}}}, "sets stiffness, which is in by"),
        ({"scale": ["mass.y"]}, "scale contains 'mass.y', which is not in the data"),
        ({"offset": [("a", "mass.x")]}, "is not in the data"),
        ({"offset": ["mass.x", ("", "mass.x")]}, "twice"),
        ({"scale": 3}, "scale must be a list of names"),
        ({"shift": {"mass.x": (0.2, 0.1)}}, "must be \\(lower, upper\\) in seconds"),
        ({"shift": {"mass.x": (0.2, 0.5)}}, "at most the first time of its data, 0.1 s"),
        ({"starts": 3}, "several starts need finite bounds of all parameters; pass those of stiff"),
        (
            {"starts": 3, "bounds": {"stiffness": (1.0, np.inf)}},
            "need finite bounds .* of stiffness",
        ),
        (
            {"starts": 3, "bounds": {"stiffness": (0.0, 90.0)}, "log": ["stiffness"]},
            "need finite bounds of all parameters, above 0 for those in log; pass those of stiff",
        ),
        ({"starts": 0}, "starts must be a whole number"),
    ],
)
def test_refusals(changes, message):
    arguments = {"data": LONG, "by": ["stiffness"], "integrator": METHOD, "sigma": 1.0, **changes}
    with pytest.raises(bd.BeamdaeError, match=message) as caught:
        bd.fit(oscillator, **arguments)
    assert len(re.findall(r"[.] [A-Z]", str(caught.value))) == 0


@pytest.mark.slow(reason="seconds")
def test_regression_bounds_of_shifts_after_the_first_data_are_reduced():
    """They were rejected, also after the advice to widen bounds that nobody had set."""
    times = np.linspace(0.05, 1.0, 77)
    run = bd.simulate(oscillator(stiffness=60.0), METHOD).at_times(times - 0.04)["mass.x"]
    data = {"t [s]": times, "mass.x": run.to_numpy()}
    options = {"integrator": METHOD, "sigma": 1e-4, "parameters": {"stiffness": 58.0}}
    with pytest.warns(bd.BeamdaeWarning, match=r"first time of its data, 0.05 s.*the bound 0.1 s"):
        result = bd.fit(oscillator, data, ["stiffness"], shift={"mass.x": (-0.1, 0.1)}, **options)
    assert result.parameters["stiffness"] == pytest.approx(60.0, rel=1e-3)
    assert result.sensors["shift of mass.x"] == pytest.approx(0.04, abs=1e-4)
    # The data begin before the delayed start.
    times = np.linspace(0.01, 1.0, 100)
    run = bd.simulate(oscillator(stiffness=60.0), METHOD)
    values = run.at_times(np.maximum(times - 0.03, 0.0)[2:])["mass.x"].to_numpy()
    data = {"t [s]": times, "mass.x": np.append(np.full(2, run["mass.x"].iloc[0]), values)}
    with pytest.warns(bd.BeamdaeWarning, match=r"shift of mass.x is at its .* omit earlier data"):
        bd.fit(oscillator, data, ["stiffness"], shift=["mass.x"], **options)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "\n\n",
        "a,b\n1,2,3\n",
        't [s],mass.x\n0.1,"1',
        "t [s],mass.x\n0.1,1;5\n",
        "observable,value\nmass.x,1\n",
        "t [s],mass.x\n0.2,1\n0.2,1\n",
        "t [s],mass.x\n0.1,inf\n",
        "t [s],mass.x,mass.x [m]\n0.1,1,1\n0.2,1,1\n",
        "t [s]\n0.1\n",
        "t [s],mass.x\n",
        "experiment,observable,t [s],value\n,mass.x,0.1,1\n",
        "\x00\x01\xff",
    ],
)
def test_bad_files_are_rejected_in_one_sentence(tmp_path, text):
    path = tmp_path / "data.csv"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(bd.BeamdaeError) as caught:
        bd.fit(oscillator, path, "stiffness", METHOD, sigma=1.0)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("fit: ")


@pytest.mark.parametrize("is_sigma_known", [True, False])
def test_data_in_other_units_are_converted(is_sigma_known):
    values = np.array([1.0, 1.1, 1.3])
    data = {"t [ms]": 1e3 * TIMES[:3], "mass.x [mm]": 1e3 * values}
    sigma = 5.0 if is_sigma_known else None
    offset = "mass.x [mm]" if is_sigma_known else "mass.x"
    problem = FitProblem(
        oscillator, data, ["stiffness"], METHOD, sigma=sigma, sensors={"offset": offset}
    )
    table = problem.data.table
    np.testing.assert_allclose(table["t [s]"], TIMES[:3], rtol=1e-15)
    np.testing.assert_allclose(table["value"], values, rtol=1e-15)
    np.testing.assert_allclose(table["sigma"], 5e-3 if is_sigma_known else 1.0, rtol=1e-15)
    assert set(table["column"]) == {"mass.x [m]"}
    assert problem.sensors[0].unit == "m"
    long = {"observable": ["mass.x [mm]"] * 3, "time [us]": 1e6 * TIMES[:3], "value": 1e3 * values}
    other = FitProblem(oscillator, long, ["stiffness"], METHOD).data.table
    np.testing.assert_allclose(other["t [s]"], TIMES[:3], rtol=1e-15)
    np.testing.assert_allclose(other["value"], values, rtol=1e-15)


def test_regression_offsets_of_converted_columns_are_named_with_the_unit_of_the_estimate():
    """They were "offset of mass.x [mm]" in m, and "offset of mass.x [m] [m]" in tables."""
    times = TIMES[:4]
    data = {"t [ms]": 1e3 * times, "mass.x [mm]": 1e3 * (record(times)[0] + OFFSET)}
    options = {"parameters": TRUE, "sigma": 1.0, "offset": ["mass.x [mm]"]}
    fit = bd.fit(oscillator, data, "stiffness", METHOD, max_evaluations=2, **options)
    assert fit.sensors == pytest.approx({"offset of mass.x [m]": OFFSET}, rel=1e-4)
    description = describe(fit)
    assert description.tables["Estimates"]["estimate"].to_list()[-1] == "offset of mass.x [m]"
    assert description.data()["estimates"]["offset of mass.x [m]"]["unit"] == "m"


def test_regression_offsets_in_two_units_of_one_column_are_rejected():
    data = {
        "a": {"t [s]": TIMES, "mass.x [mm]": TIMES},
        "b": {"t [s]": TIMES, "mass.x [cm]": TIMES},
    }
    names = ["mass.x [mm]", "mass.x [cm]"]
    with pytest.raises(bd.BeamdaeError, match="twice; remove one, or name the exp"):
        FitProblem(oscillator, data, ["stiffness"], METHOD, sigma=1.0, sensors={"offset": names})
    pairs = list(zip("ab", names, strict=True))
    problem = FitProblem(
        oscillator, data, ["stiffness"], METHOD, sigma=1.0, sensors={"offset": pairs}
    )
    assert problem.estimated[1:] == ("offset of mass.x [m] in a", "offset of mass.x [m] in b")


def test_regression_one_column_in_two_units_needs_no_sigma():
    """The two names were counted as two columns, whose weights need sigma."""
    data = {
        "a": {"t [s]": TIMES, "mass.x [mm]": 1e3 * TIMES},
        "b": {"t [s]": TIMES, "mass.x": TIMES},
    }
    problem = FitProblem(oscillator, data, ["stiffness"], METHOD)
    table = problem.data.table
    np.testing.assert_allclose(table["value"], [*TIMES, *TIMES], rtol=1e-15)
    np.testing.assert_array_equal(table["sigma"], 1.0)
    data["b"]["mass.y"] = TIMES
    with pytest.raises(bd.BeamdaeError, match="sigma is required for several columns"):
        FitProblem(oscillator, data, ["stiffness"], METHOD)


@pytest.mark.parametrize(
    "times",
    [
        pd.to_timedelta(TIMES, unit="s"),
        [np.timedelta64(k, "s") for k in range(1, 1 + len(TIMES))],
    ],
)
def test_regression_durations_are_rejected(times):
    """They were read as numbers of nanoseconds."""
    data = pd.DataFrame({"t [s]": times, "mass.x": TIMES})
    for table in (data, {"t [s]": times, "mass.x": TIMES}):
        with pytest.raises(bd.BeamdaeError, match=r"'t .s.' of data must contain finite numbers"):
            FitProblem(oscillator, table, ["stiffness"], METHOD)


@pytest.mark.parametrize("name", ["t [N]", "time [N]", "time [furlong]"])
def test_regression_only_columns_with_a_unit_of_time_are_times(name):
    """The columns were "both times"."""
    table = {name: TIMES, "t [ms]": 1e3 * TIMES, "mass.x": TIMES}
    data = read_measurements("plot", table).table
    assert list(data["observable"].unique()) == [name, "mass.x"]
    np.testing.assert_allclose(data["t [s]"].unique(), TIMES, rtol=1e-15)


@SLOW
def test_regression_columns_have_their_names_in_the_data():
    """Warnings proposed offsets of columns by the names in the data, which were rejected."""
    position, _ = record()
    data = {"t [s]": TIMES, "Laser [mm]": 1e3 * (position + 0.5)}
    columns, first = {"Laser [mm]": "mass.x"}, {"stiffness": 39.0}
    fits = [
        bd.fit(
            oscillator,
            data,
            list(TRUE),
            METHOD,
            parameters=first,
            data_columns=columns,
            sigma={name: "1 mm"},
            offset=[name],
        )
        for name in ("Laser", "Laser [mm]", "mass.x")
    ]
    for fit in fits:
        assert fit.parameters == pytest.approx(TRUE, rel=1e-4)
    (offset,) = fits[0].sensors
    assert offset == "offset of mass.x [m]"
    assert fits[0].sensors == fits[1].sensors
    named = fit_sensors(data, columns, scale=["Laser"], shift={"Laser": (-0.1, 0.1)})
    assert [x.name for x in named] == ["shift of mass.x", "scale of mass.x"]
    with pytest.raises(bd.BeamdaeError, match=r"mass.x \[m\] \(Laser \[mm\]\)"):
        fit_sensors(data, columns, scale=["Lasr"])


def test_names_in_the_run_precede_those_in_the_data():
    data = {"t [s]": [0.1, 0.2], "mass.x": [1.0, 2.0], "mass.y": [3.0, 4.0]}
    columns = {"mass.x": "mass.y", "mass.y": "mass.x"}
    (scale,) = fit_sensors(data, columns, scale=["mass.x"])
    assert list(np.flatnonzero(scale.rows)) == [2, 3]
