"""Fits of parameters to synthetic data with known solutions, and interrupts of fits."""

import re
import warnings

import numpy as np
import pandas as pd
import pytest
from mechanisms import clamped_beam, free_ball, rectangle

import beamdae as bd
from beamdae.errors import warn_user
from beamdae.interrupts import Interrupted

METHOD = bd.GeneralizedAlpha(step=0.01)
TIMES = np.linspace(0.0, 2.0, 41)
TRUE = {"stiffness": 40.0, "damping": 0.8}
NOISE = 1e-3
SLOW = pytest.mark.slow(reason="half a second and more")


@bd.model(t_end=1.0)
def oscillator(stiffness=30.0, damping=0.5, mass=1.0, elements=3):
    mech, _body = free_ball(
        (1.0, 0.0), velocity=(0.2, 0.0), mass=mass, name="mass", spring=(stiffness, damping)
    )
    return mech


@pytest.fixture(scope="module")
def exact():
    run = bd.simulate(oscillator(**TRUE), METHOD, t_end=2.0).at_times(TIMES)
    return {"t [s]": TIMES, "mass.x": run["mass.x"].to_numpy(), "speed": run["mass.x_dot"]}


@SLOW
def test_exact_data_return_the_parameters(exact):
    data = pd.DataFrame({name: exact[name] for name in ("t [s]", "mass.x")})
    result = bd.fit(oscillator, data, list(TRUE), METHOD)
    assert result.status.success
    # The runs that are fitted have a smaller Newton tolerance than the run of the data.
    assert result.parameters == pytest.approx(TRUE, rel=1e-7)
    assert not result.undetermined
    assert not result.at_bounds


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize("log", [(), pytest.param(("stiffness", "damping"), marks=[SLOW])])
def test_covariance_agrees_with_differences_of_the_model(exact, log):
    noise = np.random.default_rng(1).normal(scale=NOISE, size=TIMES.size)
    data = {"t [s]": TIMES, "mass.x [m]": exact["mass.x"] + noise}
    data["mass.x [m]"][7] = np.nan
    result = bd.fit(oscillator, data, list(TRUE), METHOD, sigma=NOISE, log=log)
    columns = []
    for name, value in result.parameters.items():
        runs = [
            bd.simulate(oscillator(**{**result.parameters, name: value * (1 + k)}), METHOD, 2.0)
            for k in (-1e-4, 1e-4)
        ]
        low, high = (run.at_times(np.delete(TIMES, 7))["mass.x"].to_numpy() for run in runs)
        columns.append((high - low) / (2e-4 * value * NOISE))
    jacobian = np.stack(columns, axis=1)
    expected = np.linalg.inv(jacobian.T @ jacobian)
    np.testing.assert_allclose(result.covariance, expected, rtol=1e-5)
    assert result.degrees_of_freedom == TIMES.size - 1 - 2
    # Within five standard deviations of the chi-square distribution.
    assert abs(result.chi_square - 38) < 5 * np.sqrt(2 * 38)
    errors = np.array(list(result.parameters.values())) - list(TRUE.values())
    assert np.all(np.abs(errors) < 4 * result.standard_deviations)
    # The gradient of the sum of squares vanishes at the solution.
    assert np.abs(jacobian.T @ result.residuals).max() < 1e-4 * np.abs(jacobian).sum()


@SLOW
def test_unknown_sigma_is_estimated(exact):
    noise = np.random.default_rng(1).normal(scale=NOISE, size=TIMES.size)
    data = {"t [s]": TIMES, "mass.x": exact["mass.x"] + noise}
    known, unknown = (
        bd.fit(oscillator, data, list(TRUE), METHOD, sigma=sigma) for sigma in (NOISE, None)
    )
    assert unknown.sigma["mass.x [m]"] == pytest.approx(
        NOISE * np.sqrt(known.chi_square / known.degrees_of_freedom), rel=1e-6
    )
    assert unknown.chi_square == pytest.approx(unknown.degrees_of_freedom)
    assert unknown.parameters == pytest.approx(dict(known.parameters), rel=1e-6)


@SLOW
def test_sigma_of_exact_data_is_at_least_that_of_rounding(exact):
    data = {"t [s]": TIMES, "mass.x": exact["mass.x"]}
    first = bd.fit(oscillator, data, list(TRUE), METHOD)
    run = first.solution.columns["mass.x [m]"]
    data = {"t [s]": TIMES, "mass.x": run}
    fit = bd.fit(oscillator, data, list(TRUE), METHOD, parameters=first.parameters)
    assert 0.0 < fit.sigma["mass.x [m]"] < 1e-15
    assert np.all(fit.standard_deviations < 1e-10)


@SLOW
def test_several_columns_are_weighted_by_sigma(exact):
    data = {"t [s]": TIMES, "mass.x": exact["mass.x"] + 1e-3, "mass.x_dot": exact["speed"]}
    sigma = {"mass.x": 1e3, "mass.x_dot": 1e-6}
    result = bd.fit(oscillator, data, list(TRUE), METHOD, sigma=sigma)
    assert result.parameters == pytest.approx(TRUE, rel=1e-6)
    with pytest.raises(bd.BeamdaeError, match="sigma is required for several columns"):
        bd.fit(oscillator, data, list(TRUE), METHOD)


@SLOW
def test_dependent_parameters_are_named(exact):
    # The motion depends on stiffness / mass and damping / mass only.
    data = {"t [s]": TIMES, "mass.x": exact["mass.x"]}
    result = bd.fit(oscillator, data, [*TRUE, "mass"], METHOD, sigma=NOISE)
    assert result.undetermined == (
        "Joint changes of stiffness by +1 %, damping by +1 %, mass by +1 % do not change the "
        "fitted columns.",
    )
    assert np.all(np.isinf(result.standard_deviations))
    assert result.undetermined[0] in repr(result)


@SLOW
def test_weakly_determined_parameter_is_named(exact):
    data = {"t [s]": TIMES, "mass.x": exact["mass.x"]}
    result = bd.fit(oscillator, data, list(TRUE), METHOD, sigma=0.2)
    (sentence,) = result.undetermined
    match = re.fullmatch(r"Changes of damping by \+(\d+) % lie within one standard .*", sentence)
    relative = result.standard_deviations[1] / result.parameters["damping"]
    # The direction contains a small share of the stiffness.
    assert float(match[1]) == pytest.approx(100.0 * relative, rel=0.01)


@SLOW
def test_estimate_at_a_bound(exact):
    data = {"t [s]": TIMES, "mass.x": exact["mass.x"]}
    with pytest.warns(bd.BeamdaeWarning, match="damping is at its upper bound 0.6 and has no"):
        result = bd.fit(oscillator, data, list(TRUE), METHOD, bounds={"damping": (0.0, 0.6)})
    assert result.parameters["damping"] == pytest.approx(0.6, rel=1e-6)
    assert result.at_bounds == ("damping",)
    assert "at a bound: damping" in repr(result)
    table = result.table()
    assert np.isnan(table.loc["damping", "standard deviation"])
    # One-sided.
    assert table.loc["damping", "upper 95 %"] == pytest.approx(0.6, rel=1e-6)
    assert 0.5 < table.loc["damping", "lower 95 %"] < 0.6
    assert table.loc["stiffness"].notna().all()


@pytest.mark.slow(reason="two seconds")
def test_regression_searches_that_leave_the_domain_of_a_parameter_advise_bounds():
    """The advice was a shift of the times, beside an interval of the value at the edge."""
    times = TIMES[:21]
    # Those of a spring with negative stiffness.
    data, by = {"t [s]": times, "mass.x": 1.0 + 0.1 * np.sinh(2.0 * times)}, ["stiffness"]
    first = {"stiffness": 3.0, "damping": 0.0}
    with pytest.warns(bd.BeamdaeWarning, match="stopped without progress"):
        result = bd.fit(oscillator, data, by, METHOD, parameters=first)
    assert not result.status.success
    assert result.evaluations <= 60  # all 100 with steps that become shorter and shorter
    assert result.table().iloc[:, 1:].isna().all(axis=None)
    assert "+-" not in repr(result)
    assert result.warnings == ()
    assert "stiffness" in result.status.sentence
    assert "pass bounds= that exclude such values" in result.status.sentence
    bounds = {"stiffness": (0.0, 100.0)}
    with pytest.warns(bd.BeamdaeWarning, match="stiffness is at its lower bound 0"):
        result = bd.fit(oscillator, data, by, METHOD, parameters=first, bounds=bounds)
    assert result.status.success


@SLOW
def test_regression_estimates_of_noisy_data_at_a_bound_are_reported(exact):
    # The search converges at a distance from the bound, which its own criterion does not see.
    noise = np.random.default_rng(1).normal(scale=NOISE, size=TIMES.size)
    data = {"t [s]": TIMES[:21], "mass.x": (exact["mass.x"] + noise)[:21]}
    bounds = {"stiffness": (25.0, 39.0), "damping": (0.0, 10.0)}
    with pytest.warns(
        bd.BeamdaeWarning, match="fit: stiffness is at its upper bound 39 and has no"
    ):
        result = bd.fit(oscillator, data, list(TRUE), METHOD, bounds=bounds)
    assert result.at_bounds == ("stiffness",)
    at_bound, alike = result.warnings
    assert "if larger values are possible" in at_bound
    assert "Residuals are alike" in alike
    bounds = {"stiffness": (25.0, 50.0), "damping": (0.0, 10.0)}
    assert bd.fit(oscillator, data, list(TRUE), METHOD, bounds=bounds).warnings == ()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"by": "stiffnes"}, "has no parameter 'stiffnes' .did you mean 'stiffness'"),
        ({"by": "elements"}, "elements of oscillator is not a float"),
        ({"data": {"mass.x": [1.0]}}, "must contain the column 't \\[s\\]'"),
        (
            {"data": {"t [s]": [0.0, 1.0, 1.0], "mass.x": [1.0] * 3}},
            "times of data must be finite, not negative and different",
        ),
        ({"data": {"t [s]": [0.0, 1.0], "mass.x": [1.0]}}, "data must be a table .* same length"),
        (
            {"data": {"t [s]": [0.0, 1.0], "mass.z": [1.0, 1.0]}},
            "got 'mass.z' .did you mean 'mass.y'",
        ),
        ({"data": {"t [s]": [0.0, 1.0], "mass": [1.0, 1.0]}}, "got 'mass' .name one of mass.x"),
        ({"data": {"t [s]": [1.0], "mass.x": [np.nan]}}, "data contains no values"),
        ({"data": {"t [s]": [1.0], "mass.x": [1.0]}, "by": list(TRUE)}, "1 data do not determine"),
        ({"data": 3.0}, "data must be a table"),
        ({"sigma": -1.0}, "sigma must be positive"),
        ({"sigma": {"other": 1.0}}, "sigma must name the observed columns of data, mass.x"),
        (
            {"bounds": {"stiffness": (50.0, 60.0)}},
            "around its first value 30.*pass another first value, parameters=",
        ),
        ({"bounds": {"mass": (0.5, 2.0)}}, "bounds contains 'mass', which is not in by"),
        (
            {"bounds": {"stiffness": (-1.0, 50.0)}, "log": ["stiffness"]},
            "its lower bound not negative",
        ),
        (
            {"data": {"t [s]": [0.0, 11.0], "mass.x": [1.0] * 2}},
            "the data end at 11 s, but must end .* before 10 s",
        ),
        (
            {"data": {"t [s]": [1.7e9, 1.7e9 + 1.0], "mass.x": [1.0] * 2}},
            "subtract the first time from all times",
        ),
        ({"log": ["mass"]}, "log contains 'mass', which is not in by"),
        ({"integrator": bd.Ida()}, "GeneralizedAlpha"),
        ({"by": [["stiffness"]]}, "by must be a list of names of parameters"),
        ({"bounds": {"stiffness": ("40", "50")}}, "around its first value 30"),
        ({"bounds": {"stiffness": (None, 20.0)}}, "around its first value 30"),
        ({"max_evaluations": 0}, "max_evaluations must be a whole number of at least 1"),
        # The search would never end.
        ({"max_evaluations": 2.5}, "max_evaluations must be a whole number of at least 1"),
        ({"max_evaluations": "5"}, "max_evaluations must be a number"),
    ],
)
def test_refusals(exact, changes, message):
    data = {"t [s]": TIMES, "mass.x": exact["mass.x"]}
    arguments = {"data": data, "by": ["stiffness"], "integrator": METHOD, **changes}
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.fit(oscillator, **arguments)


@pytest.mark.slow(reason="half a second and more")
def test_search_that_ends_early_is_reported(exact):
    data = {"t [s]": TIMES, "mass.x": exact["mass.x"]}
    with pytest.warns(bd.BeamdaeWarning, match=r"^fit: stopped after 1 evaluation; increase"):
        result = bd.fit(oscillator, data, list(TRUE), METHOD, max_evaluations=1)
    assert result.status.kind == "limited"
    assert "stopped after 1 evaluation" in repr(result)
    assert list(result.table().index) == list(TRUE)


@SLOW
def test_regression_steps_that_change_the_estimates_are_told():
    run = bd.simulate(oscillator(**TRUE), bd.Radau(rtol=1e-9), t_end=2.0).at_times(TIMES)
    data = {"t [s]": TIMES, "mass.x [m]": run["mass.x"].to_numpy()}
    coarse = bd.GeneralizedAlpha(step=0.1)
    with pytest.warns(bd.BeamdaeWarning, match="would change by up to"):
        result = bd.fit(oscillator, data, "stiffness", coarse, sigma=NOISE)
    (sentence,) = (x for x in result.warnings if "would change by up to" in x)
    assert "would change by up to" in repr(result)
    accurate = bd.fit(oscillator, data, "stiffness", bd.Radau(1e-7), sigma=NOISE)
    shift = accurate.parameters["stiffness"] - result.parameters["stiffness"]
    stated = float(sentence.split("up to ")[1].split(" standard")[0])
    # The fit is not linear in such changes.
    assert stated == pytest.approx(abs(shift) / result.standard_deviations[0], rel=0.3)
    # By default, errors are controlled.
    result = bd.fit(oscillator, data, list(TRUE), sigma=NOISE)
    assert not result.warnings
    errors = np.array(list(result.parameters.values())) - list(TRUE.values())
    assert np.all(np.abs(errors) < 0.1 * result.standard_deviations)


@SLOW
def test_regression_misfits_and_correlations_are_told(exact):
    data = {"t [s]": TIMES, "mass.x [m]": exact["mass.x"] + 0.02 * np.sin(30.0 * TIMES)}
    with pytest.warns(bd.BeamdaeWarning, match="does not explain the data"):
        result = bd.fit(oscillator, data, list(TRUE), METHOD, sigma=NOISE)
    assert any("does not explain" in x for x in result.warnings)
    assert not result.undetermined
    # The frequency fixes the ratio of stiffness and mass, with smaller errors than the decay.
    data = {"t [s]": TIMES, "mass.x [m]": exact["mass.x"]}
    options = {"sigma": NOISE, "parameters": {"damping": TRUE["damping"]}}
    result = bd.fit(oscillator, data, ["stiffness", "mass"], METHOD, **options)
    assert result.correlations().iloc[0, 1] > 0.99
    assert not result.undetermined


@bd.model(t_end=2.0)
def oscillator_with_unused_number(stiffness=30.0, unused=1.0):
    return oscillator(stiffness=stiffness)


@SLOW
@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_regression_fits_of_constant_data_cause_no_warning(noise):
    """The variance of the data is noise, or rounding, of which nothing can be explained."""
    generator = np.random.default_rng(3)
    at_rest = {"t [s]": TIMES, "mass.x": 1.0 + noise * generator.normal(size=TIMES.size)}
    start = {"mass.x_dot": 0.0}
    result = bd.fit(oscillator_with_unused_number, at_rest, "stiffness", METHOD, start=start)
    assert not any("variance" in sentence or "mean" in sentence for sentence in result.warnings)


@SLOW
def test_regression_parameters_without_effect_at_a_bad_start_are_fitted(exact):
    """Both moved to 1e12 in one step."""
    data = {"t [s]": TIMES, "mass.x": exact["mass.x"]}
    first = {"stiffness": 0.8, "damping": 0.016}
    # Overflow of logarithms.
    warnings.simplefilter("error", RuntimeWarning)
    result = bd.fit(oscillator, data, list(TRUE), METHOD, log=list(TRUE), parameters=first)
    assert result.status.success
    assert result.parameters == pytest.approx(TRUE, rel=1e-5)


@bd.model(t_end=2.0)
def oscillator_with_weak_part(stiffness=30.0, damping=0.5, weak=0.3):
    """Total stiffness of two springs, of which the second one must lie in (-1, 0.5)."""
    if not -1.0 < weak < 0.5:
        raise ValueError("weak must lie in (-1, 0.5)")
    return oscillator(stiffness=stiffness * (1.0 + 1e-5 * weak), damping=damping)


@pytest.fixture(scope="module")
def noisy(exact):
    noise = np.random.default_rng(1).normal(scale=NOISE, size=TIMES.size)
    return {"t [s]": TIMES, "mass.x": exact["mass.x"] + noise}


@bd.model(t_end=0.8)
def ruler(E=1.8e11, damping=3e-4, nu=0.3):
    """Steel ruler with a tip mass, released from the horizontal; nu has a negligible effect."""
    steel = bd.Material(E=E, nu=nu, rho=7850.0)
    section = rectangle(0.003, 0.03, damping=damping, material=steel)
    mech, beam = clamped_beam(section, 2, 0.6, name="ruler", gravity=9.81, strain="exact")
    mech.add(bd.PointMass("tip mass", 0.1, on=beam.end))
    mech.observe("tip", beam.end)
    return mech


@pytest.fixture(scope="module")
def measured():
    times = np.linspace(0.004, 0.8, 200)
    run = bd.simulate(ruler(E=2.06e11, damping=8e-4), bd.Radau(1e-8)).at_times(times)
    noise = np.random.default_rng(11).normal(scale=2e-4, size=times.size)
    return {"t [s]": times, "tip.y": run["tip.y"].to_numpy() + noise}


@pytest.mark.slow(reason="fits of a beam")
@pytest.mark.parametrize("first", [{"E": 3e10}, {"E": 3e10, "damping": 1e-5}])
def test_regression_undetermined_parameters_are_released_at_the_estimates(measured, first):
    """Damping kept its first value, with the advice to omit it and the status converged."""
    by = ["E", "damping"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = bd.fit(ruler, measured, by, sigma=2e-4, log=by, parameters=first)
    assert result.status.success
    assert result.parameters["E"] == pytest.approx(2.06e11, rel=2e-3)
    assert result.parameters["damping"] == pytest.approx(8e-4, rel=0.05)


@pytest.mark.slow(reason="fits of a beam")
def test_regression_a_weak_parameter_does_not_keep_the_others_from_their_minimum(measured):
    """The search ended at the first values, because long steps of nu left its domain."""
    by = ["E", "damping"]
    alone = bd.fit(ruler, measured, by, sigma=2e-4, log=by)
    result = bd.fit(ruler, measured, [*by, "nu"], sigma=2e-4, log=by)
    assert result.status.success
    assert any("nu by" in sentence for sentence in result.undetermined)
    assert result.parameters["nu"] == pytest.approx(0.3, rel=0.5)
    for name, deviation in zip(by, alone.standard_deviations, strict=True):
        assert abs(result.parameters[name] - alone.parameters[name]) < 0.1 * deviation
    np.testing.assert_allclose(result.standard_deviations[:2], alone.standard_deviations, rtol=1e-2)


@SLOW
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_regression_intervals_beside_a_parameter_at_a_bound(noisy):
    """That of the stiffness was 150 times too wide beside an undetermined parameter at a bound."""
    alone = bd.fit(oscillator, noisy, list(TRUE), METHOD, sigma=NOISE)
    result = bd.fit(
        oscillator_with_weak_part,
        noisy,
        [*TRUE, "weak"],
        METHOD,
        sigma=NOISE,
        bounds={"weak": (0.2, 0.4)},
    )
    names = ["lower 95 %", "upper 95 %"]
    expected = alone.table().loc[list(TRUE), names]
    np.testing.assert_allclose(result.table().loc[list(TRUE), names], expected, rtol=1e-3)
    np.testing.assert_allclose(result.table().loc["weak", names], [0.2, 0.4], rtol=1e-6)
    np.testing.assert_allclose(result.standard_deviations[:2], alone.standard_deviations, rtol=1e-2)


# Interrupts of fits and derivatives: finished results are kept.

COARSE_METHOD = bd.GeneralizedAlpha(step=0.02)
FEW_TIMES = np.linspace(0.1, 1.0, 10)
DATA = {"t [s]": FEW_TIMES, "mass.x": 1.0 + 0.2 / 40.0**0.5 * np.sin(40.0**0.5 * FEW_TIMES)}


class Oscillator:
    """Model function that is interrupted when it is called for the time number `n`."""

    def __init__(self, n, interrupt=KeyboardInterrupt):
        self.calls, self.n, self.interrupt = 0, n, interrupt

    def build(self, stiffness):
        self.calls += 1
        if self.calls == self.n:
            raise self.interrupt
        mech, _body = free_ball((1.0, 0.0), velocity=(0.2, 0.0), name="mass", spring=(stiffness,))
        return mech


def model(n=0, interrupt=KeyboardInterrupt):
    """Return a model function whose call number `n` is interrupted."""
    oscillator = Oscillator(n, interrupt)

    @bd.model(t_end=1.0)
    def spring(stiffness=30.0):
        return oscillator.build(stiffness)

    return spring, oscillator


@pytest.mark.slow(reason="four fits")
def test_regression_an_interrupted_fit_has_its_best_estimates():
    """All evaluations were lost."""
    spring, oscillator = model()
    bd.fit(spring, DATA, "stiffness", COARSE_METHOD, sigma=1e-4)
    # The last calls belong to the check of the steps.
    total = oscillator.calls
    errors = []
    for n in (total // 2, total):
        with pytest.raises(Interrupted, match=r"^fit: interrupted") as caught:
            bd.fit(model(n)[0], DATA, "stiffness", COARSE_METHOD, sigma=1e-4)
        best = caught.value.partial
        assert isinstance(best, bd.results.Fit)
        assert best.status.kind == "interrupted"
        errors.append(abs(best.parameters["stiffness"] - 40.0))
    # The period of the discrete oscillator is longer by 0.1 %.
    assert errors[0] < 5.0
    assert errors[1] < 0.2
    result = bd.fit(
        model(total // 2)[0], DATA, "stiffness", COARSE_METHOD, sigma=1e-4, partial="return"
    )
    assert result.status.kind == "interrupted"
    assert "interrupted after" in repr(result)


@pytest.mark.slow(reason="up to forty fits")
@pytest.mark.parametrize(("stiffness", "step"), [(30.0, 1), (900.0, 7)])
def test_interrupts_of_any_run_of_a_fit_keep_the_best_estimates(stiffness, step):
    """From 900, the search begins again with parts of the data."""
    times = np.linspace(0.0, 2.0, 101)
    data = {"t [s]": times, "mass.x": 1.0 + 0.2 / 40.0**0.5 * np.sin(40.0**0.5 * times)}
    options = {"sigma": 1e-4, "parameters": {"stiffness": stiffness}}
    spring, oscillator = model()
    method = bd.GeneralizedAlpha(step=0.01)
    assert bd.fit(spring, data, "stiffness", method, **options).status.kind == "ok"
    errors = []
    for n in range(1, oscillator.calls + 1, step):
        # As raised by a run, whose partial result is not that of the fit.
        interrupt = Interrupted("interrupted at t = 0.3 s", object(), "simulate")
        with pytest.raises(Interrupted, match=r"^fit: interrupted") as caught:
            bd.fit(model(n, interrupt)[0], data, "stiffness", method, **options)
        best = caught.value.partial
        errors.append(np.inf if best is None else float(best.residuals @ best.residuals))
        assert best is None or best.residuals.size == times.size
    first = np.flatnonzero(np.isfinite(errors))[0]
    kept = np.array(errors[first:])
    assert first < len(errors) / 2
    # Other searches must reduce the sum of squares by more than one.
    assert (np.diff(kept) <= 1.0).all()
    assert kept[-1] < 1e-3 * kept[0]


def test_regression_the_first_run_of_a_fit_has_no_partial_result():
    with pytest.raises(Interrupted) as caught:
        bd.fit(model(3)[0], DATA, "stiffness", COARSE_METHOD)
    assert caught.value.partial is None


@pytest.mark.parametrize("call", ["sensitivities", "gradient"])
def test_regression_derivatives_of_interrupted_calls_list_warnings(call, monkeypatch):
    """The run with its derivatives was lost, or its warnings."""
    from beamdae.analysis.sensitivities import differentiable_run

    def interrupt(*_):
        warn_user("coarse: a message")
        raise KeyboardInterrupt

    monkeypatch.setattr(differentiable_run, "warn_of_errors", interrupt)
    spring, _ = model()
    objective = [bd.quantities.EndValue("mass.x")] * (call == "gradient")
    with (
        pytest.warns(bd.BeamdaeWarning, match="coarse"),
        pytest.raises(Interrupted, match="error of the derivatives was estimated") as caught,
    ):
        getattr(bd, call)(spring, *objective, "stiffness", COARSE_METHOD)
    assert isinstance(caught.value.partial, (bd.results.Gradient, bd.results.Sensitivities))
    assert caught.value.partial.warnings == ("coarse: a message",)
