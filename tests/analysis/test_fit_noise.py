"""Fits to data whose noise is not white: outliers, correlated errors, unequal scatter."""

import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from mechanisms import free_ball, mass_on_rail
from scipy.special import chdtrc
from test_fit import oscillator as build_oscillator

import beamdae as bd

METHOD = bd.GeneralizedAlpha(step=0.01)
TIMES = np.linspace(0.0, 2.0, 101)
TRUE = {"stiffness": 40.0, "damping": 0.8}
pytestmark = pytest.mark.slow(reason="fits")


@bd.model(t_end=2.0)
def oscillator(stiffness=30.0, damping=0.5, mass=1.0):
    return build_oscillator(stiffness=stiffness, damping=damping, mass=mass)


@pytest.fixture(scope="module")
def exact():
    run = bd.simulate(oscillator(**TRUE), METHOD, t_end=2.0).at_times(TIMES)
    return run["mass.x"].to_numpy()


def white(scale=1e-3):
    return np.random.default_rng(0).normal(scale=scale, size=TIMES.size)


def fit(values, **options):
    return bd.fit(oscillator, {"t [s]": TIMES, "mass.x": values}, list(TRUE), METHOD, **options)


def test_white_noise_has_no_warning(exact):
    assert fit(exact + white()).warnings == ()


def test_regression_outliers_are_named(exact):
    """Damping was 24 % off, without a word."""
    values = exact + white()
    values[[20, 55]] += 0.05
    with pytest.warns(bd.BeamdaeWarning, match=r"mass.x has outliers at t = 0.4 s, 1.1 s, more"):
        result = fit(values)
    assert len(result.warnings) == 1
    values[[20, 55]] = np.nan
    assert fit(values).warnings == ()


def test_regression_improbable_chi_square_is_stated(exact):
    """A parameter was 28 % off with a probability of 7e-4 and no message."""
    noise = white() / np.std(white())
    result = fit(exact + 1e-3 * noise, sigma=1e-3)
    assert 0.1 < result.probability < 0.9
    assert f"(probability {result.probability:.2g})" in repr(result)
    # 1.28^2 * 101 residuals against 99 degrees of freedom.
    doubtful = fit(exact + 1.28e-3 * noise, sigma=1e-3)
    assert doubtful.probability == pytest.approx(
        chdtrc(doubtful.degrees_of_freedom, doubtful.chi_square), rel=1e-9
    )
    assert 1e-6 < doubtful.probability < 1e-3
    estimated = fit(exact + 1e-3 * noise)
    assert np.isnan(estimated.probability)
    assert "chi-square" not in repr(estimated)


# Errors of the data: values at the times of a vibration x(t), the property of the sensor that the
# message states, and its true value. Delayed data begin after the start.
ERRORS = {
    "mirrored": (lambda x, t: 2.0 - x(t), "scale", -1.0),
    "inches": (lambda x, t: 1.0 + (x(t) - 1.0) / 25.4, "scale", 1 / 25.4),
    "three times": (lambda x, t: 3.0 * x(t) - 2.0, "scale", 3.0),
    "millimeters": (lambda x, t: 1e3 * x(t) - 999.0, "scale", 1e3),
    "offset": (lambda x, t: x(t) + 0.75, "offset", 0.75),
    "late": (lambda x, t: x(t - 0.02), "shift", 0.02),
    "early": (lambda x, t: x(t + 0.02), "shift", -0.02),
}


@pytest.mark.parametrize("sigma", [1e-4, None])
@pytest.mark.parametrize("stiffness", [40.0, 38.0])
@pytest.mark.parametrize("error", ERRORS)
def test_regression_errors_of_the_data_are_named_with_their_size(error, stiffness, sigma):
    """Searches took up to 231 s, some without naming the error or with another one."""
    change, kind, size = ERRORS[error]
    times = TIMES + 0.6 * (kind == "shift")
    run = bd.simulate(oscillator(**TRUE), METHOD, t_end=4.0)
    values = change(lambda t: run.at_times(t)["mass.x"].to_numpy() + white(1e-4), times)
    options = {"parameters": {"stiffness": stiffness, "damping": 0.7}}
    if sigma:
        options["sigma"] = sigma * (abs(size) if kind == "scale" else 1.0)
    data = {"t [s]": times, "mass.x": values}
    with pytest.warns(bd.BeamdaeWarning, match=rf"a fit with .*{kind}=\['mass.x'\]"):
        result = bd.fit(oscillator, data, list(TRUE), METHOD, **options)
    # Short delays change the estimates little.
    assert result.status.kind == ("ok" if kind == "shift" else "limited")
    assert result.evaluations <= 40
    sentences = " ".join([result.status.sentence, *result.warnings])
    named = re.search(rf"{kind} of mass.x = ([-\d.e+]+)", sentences)[1]
    assert float(named) == pytest.approx(size, rel=0.1)
    sensor = {"shift": "mass.x"} if kind == "shift" else {"scale": "mass.x", "offset": "mass.x"}
    right = bd.fit(oscillator, data, list(TRUE), METHOD, **sensor, **options)
    assert right.parameters == pytest.approx(TRUE, rel=0.02)


def test_loads_far_from_their_first_values_are_fitted():
    """Loads scale the model, so that ranges that differ by 3000 are no error."""

    @bd.model(t_end=2.0)
    def pushed(load=1.0):
        mech, body = free_ball((1.0, 0.0), name="mass", spring=(40.0, 2.0))
        mech.add(bd.Force("push", body.point, (load, 0.0)))
        return mech

    run = bd.simulate(pushed(load=3e3), METHOD, t_end=2.0).at_times(TIMES)
    data = {"t [s]": TIMES, "mass.x": run["mass.x"].to_numpy()}
    result = bd.fit(pushed, data, "load", METHOD)
    assert result.parameters["load"] == pytest.approx(3e3, rel=1e-6)


@pytest.mark.parametrize("starts", [1, 2])
def test_mirrored_data_within_bounds_are_named(exact, starts):
    """NumPy warned of an invalid product of a lower bound of zero."""
    bounds = {"stiffness": (0.0, 90.0), "damping": (0.0, 2.0)}
    first = {"stiffness": 39.0, "damping": 0.7}
    with pytest.warns(bd.BeamdaeWarning, match="scale of mass.x = -1,"):
        result = fit(2.0 - exact, bounds=bounds, starts=starts, parameters=first)
    assert result.status.kind == "limited"
    assert result.evaluations <= 30


@bd.model(t_end=1.2)
def plucked(stiffness=4870.0, damping=1.0):
    mech = bd.Mechanism()
    body, ground = mech.add(bd.PointMass("mass", 1.0, at=(1.02, 0.0))), mech.ground.at(0.0, 0.0)
    mech.add(bd.Spring("spring", ground, body.point, stiffness, damping, free_length=1.0))
    mech.observe("mass", body.point)
    return mech


def test_regression_smallest_of_equivalent_delays_is_named():
    """A wrong damping compensated periods: data late by 0.015 s looked early by 0.436 s."""
    times = np.linspace(0.015, 1.015, 201)
    method = bd.GeneralizedAlpha(step=0.002)
    run = bd.simulate(plucked(damping=3.0), method).at_times(times - 0.015)
    noise = np.random.default_rng(0).normal(scale=1e-4, size=times.size)
    data = {"t [s]": times, "mass.x": run["mass.x"].to_numpy() + noise}
    with pytest.warns(bd.BeamdaeWarning, match="shift of mass.x = 0.015 s"):
        bd.fit(plucked, data, "damping", method)


@pytest.mark.parametrize("delay", [0.01, 0.02])
def test_regression_delays_of_data_that_begin_at_the_start_are_named(delay):
    """Data could not be later than their first time: the fit had other causes, or none."""
    method, times = bd.GeneralizedAlpha(step=0.002), np.linspace(0.0, 1.0, 201)
    run = bd.simulate(plucked(damping=3.0), method).at_times(times)["mass.x"]
    noise = np.random.default_rng(0).normal(scale=1e-4, size=times.size)
    data = {"t [s]": times, "mass.x": np.interp(times - delay, times, run) + noise}
    with pytest.warns(bd.BeamdaeWarning, match="shift of mass.x = ") as caught:
        bd.fit(plucked, data, ["stiffness", "damping"], method)
    named = [x for x in caught if "shift of mass.x = " in str(x.message)]
    number = re.search(r"shift of mass.x = ([\d.]+) s", str(named[0].message))[1]
    assert float(number) == pytest.approx(delay, rel=0.1)


@pytest.mark.parametrize("delay", [0.02, 0.15])
def test_regression_delays_of_one_column_are_named(delay):
    """Only delays of all data were."""
    method, times = bd.GeneralizedAlpha(step=0.015), np.linspace(0.3, 3.0, 91)
    exact, sigma = noisy_chain(times, method, 3.5, 0.005, seed=3)
    moved, _ = noisy_chain(times - delay, method, 3.5, 0.005, seed=4)
    data = exact | {"two.x": moved["two.x"]}
    first = {"k1": 57.0, "k2": 85.0, "damping": 0.4}
    options = {"sigma": sigma, "parameters": first, "log": list(first)}
    message = rf"shift=\['two.x'\] .*shift of two.x = {delay:g}"
    with pytest.warns(bd.BeamdaeWarning, match=message):
        bd.fit(chain, data, list(first), method, **options)


def test_regression_searches_that_fail_have_no_warnings_of_their_last_runs():
    """Absurd values had advice on steps and elements."""
    run = bd.simulate(oscillator(stiffness=600.0), METHOD).at_times(TIMES)
    values = np.append(run["mass.x"].to_numpy()[:12], 1.0)
    data = {"t [s]": np.append(TIMES[:12], 2.0), "mass.x": values}
    options = {"parameters": {"stiffness": 400.0}, "max_evaluations": 2}
    with pytest.warns(bd.BeamdaeWarning, match="stopped after 2 evaluations"):
        result = bd.fit(oscillator, data, "stiffness", METHOD, sigma=1e-4, **options)
    assert any("short steps of Radau" in x for x in result.solution.warnings)
    assert result.run_warnings == ()


def test_regression_antiphase_starts_are_fitted():
    """Beyond the resonance, the response to a load is mirrored."""

    @bd.model(t_end=4.0)
    def driven(stiffness=25.0, damping=0.8):
        mech, body = free_ball((1.0, 0.0), name="mass")
        ground = mech.ground.at(0.0, 0.0)
        mech.add(bd.Spring("spring", ground, body.point, stiffness, damping))
        mech.add(bd.Force("push", body.point, (lambda t: np.sin(6.0 * t), 0.0)))
        return mech

    times = np.linspace(0.0, 4.0, 121)
    run = bd.simulate(driven(stiffness=50.0), METHOD).at_times(times)
    data = {"t [s]": times, "mass.x": run["mass.x"].to_numpy()}
    result = bd.fit(driven, data, ["stiffness", "damping"], METHOD)
    assert result.parameters["stiffness"] == pytest.approx(50.0, rel=1e-3)


@pytest.mark.parametrize("period", [12.0, 20.0, 30.0])
def test_regression_residuals_that_oscillate_are_alike(exact, period):
    """Their autocorrelations cancel: vibrations that the model lacks were noise for warnings."""
    vibration = 3e-3 * np.sin(2.0 * np.pi * np.arange(TIMES.size) / period)
    with pytest.warns(bd.BeamdaeWarning, match="Residuals are alike over about"):
        fit(exact + vibration + white())


@pytest.mark.parametrize("sigma", [1e-6, None])
def test_regression_residuals_with_a_large_mean_suggest_an_offset(sigma):
    t = np.linspace(0.0, 2.0, 51)
    noise = 1e-3 * np.random.default_rng(1).normal(size=51)
    data = {"t [s]": t, "mass.x [mm]": 32.0 * np.sin(6.5 * t) * np.exp(-0.2 * t) + 150.0 + noise}
    method = bd.GeneralizedAlpha(step=4e-2)
    with pytest.warns(bd.BeamdaeWarning, match=r"offset=\['mass.x'\]"):
        fit = bd.fit(oscillator, data, ["stiffness"], method, sigma=sigma, max_evaluations=3)
    assert fit.status.kind == "limited"
    # A sigma in a wrong unit does not make the steps too long.
    assert not [x for x in fit.warnings if "would change" in x]


def test_regression_a_sigma_in_a_larger_unit_is_named(exact):
    """A thousandfold sigma was accepted with chi-square 0.04 of 601 degrees of freedom."""
    data = {"t [s]": TIMES, "mass.x [mm]": 1e3 * (exact + white())}
    options = {"log": ["damping"]}
    with pytest.warns(bd.BeamdaeWarning, match=r"sigma is .*e\+03 times as large"):
        wrong = bd.fit(oscillator, data, list(TRUE), METHOD, sigma=1e3, **options)
    assert len(wrong.warnings) == 1
    # The interval of a logarithm is positive.
    low, high = wrong.table().loc["damping", ["lower 95 %", "upper 95 %"]]
    assert 0.0 < low < wrong.parameters["damping"] < high
    right = bd.fit(oscillator, data, list(TRUE), METHOD, sigma="1 mm", **options)
    assert right.warnings == ()


@bd.model(t_end=2.0)
def scaled_oscillator(stiffness=30.0, damping=0.5, size=1.0):
    """Masses and forces are proportional to `size`; the motion does not depend on it."""
    mech, body = mass_on_rail(size, 1.0, velocity=(0.2, 0.0))
    ground = mech.ground.at(0.0, 0.0)
    spring = bd.Spring("spring", ground, body.point, size * stiffness, size * damping)
    mech.observe("pull", mech.add(spring).force)
    return mech


@pytest.mark.parametrize("sigma", [None, 0.01])
def test_regression_estimates_do_not_depend_on_the_unit_of_the_data(sigma):
    """Strains of 1e-6 without sigma ended five standard deviations before the minimum."""
    run = bd.simulate(scaled_oscillator(**TRUE), METHOD, t_end=2.0).at_times(TIMES)
    values = run["pull"].to_numpy() + white(0.01)
    fits = [
        bd.fit(
            scaled_oscillator,
            {"t [s]": TIMES, "pull": size * values},
            list(TRUE),
            METHOD,
            sigma=sigma and size * sigma,
            parameters={"size": size},
        )
        for size in (1.0, 1e-9, 1e9)
    ]
    for scaled in fits[1:]:
        assert scaled.status.success
        assert scaled.parameters == pytest.approx(dict(fits[0].parameters), rel=1e-6)
        deviations = fits[0].standard_deviations
        np.testing.assert_allclose(scaled.standard_deviations, deviations, rtol=1e-5)
        assert scaled.warnings == fits[0].warnings


@pytest.mark.parametrize(("factor", "is_reported"), [(1.0, False), (1.2, False), (2.0, True)])
def test_regression_a_sigma_twice_the_noise_is_reported(exact, factor, is_reported):
    """Chi-square of 94 at 391 degrees of freedom had no warning."""
    with warnings.catch_warnings(record=True):
        warnings.simplefilter("always")
        result = fit(exact + white(), sigma=factor * 1e-3)
    assert any("sigma is 2" in x for x in result.warnings) == is_reported
    assert len(result.warnings) == is_reported


def test_regression_outliers_that_dominate_chi_square_are_named(exact):
    """The message blamed the unit of sigma, or what the model lacks."""
    values = exact + white(1e-4)
    values[[20, 55]] += 0.05
    with pytest.warns(bd.BeamdaeWarning, match="most of their squares are outliers"):
        result = fit(values, sigma=1e-4)
    assert len(result.warnings) == 2
    assert "mass.x has outliers at t = 0.4 s, 1.1 s" in result.warnings[1]


def test_regression_rows_of_data_that_miss_peaks_have_no_warning(exact):
    """The advice was to reduce output_step=, which a fit does not have."""
    values = exact + white()
    values[10:60] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = fit(values, sigma=1e-3)
    assert result.solution.missed_peaks


def test_regression_profile_that_ends_at_rejected_values_names_them(exact):
    """It ended one step before them, without a word."""
    result = fit(exact + white(0.04), sigma=0.04)
    with pytest.warns(bd.BeamdaeWarning, match="no upper limit .* before runs fail next to"):
        profile = result.profile("damping")
    assert profile.interval[1] == np.inf
    assert "stiffness must not be negative" in profile.warnings[0]


def test_regression_profiles_of_fits_that_did_not_converge_are_rejected(exact):
    """One had an interval, while that of the fit was NaN, without a word."""
    with pytest.warns(bd.BeamdaeWarning, match="stopped after 2 evaluations"):
        result = fit(exact + white(), sigma=1e-3, max_evaluations=2)
    with pytest.raises(bd.BeamdaeError, match=r"profile: the fit did not converge \(stopped after"):
        result.profile("damping")


def test_regression_profile_with_lower_sums_than_the_fit_warns(exact):
    """A profile found another minimum, without a word."""
    converged = fit(exact + white(), sigma=1e-3)
    profile = converged.profile("damping")
    assert profile.warnings == ()
    other = replace(profile, increases=profile.increases - 0.2)
    assert f"at damping = {converged.parameters['damping']:.6g} is lower" in other.warnings[0]


def test_regression_wrong_first_values_are_the_first_suspect(exact):
    """Large residuals of a search far from the minimum were blamed on the unit of sigma."""
    values = exact + 1e-3 * white()
    with pytest.warns(bd.BeamdaeWarning, match="start from other values"):
        result = fit(values, sigma=1e-3, parameters={"stiffness": 900.0}, max_evaluations=3)
    assert "unit of sigma" not in " ".join([result.status.sentence, *result.warnings])


@bd.model(t_end=2.0)
def stiff_pair(stiffness=30.0, damping=0.5, stiff=1e7):
    mech = oscillator(stiffness=stiffness, damping=damping)
    other = mech.add(bd.PointMass("other", 0.01, at=(2.0, 0.0), velocity=(0.2, 0.0)))
    mech.add(bd.Spring("link", mech.parts["mass"].point, other.point, stiff, 1e3))
    return mech


def test_regression_parameters_without_effect_keep_their_first_values(exact):
    """One that the data do not determine moved to 1e30 and was said to be correlated."""
    data = {"t [s]": TIMES, "mass.x": exact + white()}
    with pytest.warns(bd.BeamdaeWarning, match=r"Changes of stiff by .* do not change the fitted"):
        result = bd.fit(
            stiff_pair, data, ["stiffness", "damping", "stiff"], METHOD, sigma={"mass.x": 1e-3}
        )
    assert result.parameters["stiff"] == pytest.approx(1e7, rel=1e-5)
    assert result.standard_deviations[2] > 1e7


def test_regression_parameters_that_the_model_does_not_use_take_no_evaluations(exact):
    """An unused parameter moved to three times its first value and took eleven more runs."""

    @bd.model(t_end=2.0)
    def with_unused(stiffness=30.0, damping=0.5, unused=1.0):
        return oscillator(stiffness=stiffness, damping=damping)

    data = {"t [s]": TIMES, "mass.x": exact + white()}
    used = bd.fit(with_unused, data, ["stiffness", "damping"], METHOD)
    with pytest.warns(bd.BeamdaeWarning, match="Changes of unused .* do not change the fitted"):
        both = bd.fit(with_unused, data, ["stiffness", "damping", "unused"], METHOD)
    assert abs(both.evaluations - used.evaluations) <= 1
    assert both.parameters["unused"] == 1.0
    assert both.parameters == pytest.approx({**used.parameters, "unused": 1.0}, rel=1e-6)


def test_parameters_that_have_an_effect_later_are_fitted(exact):
    @bd.model(t_end=2.0)
    def stiff_only(stiffness=30.0, level=1.0):
        """Damping begins at a stiffness of 35."""
        rate = 0.1 * level * max(stiffness - 35.0, 0.0)
        return oscillator(stiffness=stiffness, damping=rate)

    data = {"t [s]": TIMES, "mass.x": exact}
    result = bd.fit(stiff_only, data, ["stiffness", "level"], METHOD)
    assert result.status.success
    assert result.parameters == pytest.approx({"stiffness": 40.0, "level": 1.6}, rel=1e-4)


def test_regression_ends_that_explain_nothing_have_not_converged():
    """They had the status "ok" and intervals after 41 evaluations."""
    data = {"t [s]": TIMES, "mass.x": np.exp(-3.0 * TIMES) + white()}
    with pytest.warns(bd.BeamdaeWarning, match="explains the data less well .* check signs, units"):
        result = bd.fit(oscillator, data, "stiffness", METHOD, parameters={"stiffness": 900.0})
    assert result.status.kind == "limited"
    assert result.evaluations <= 40


@pytest.mark.slow(reason="one to two seconds")
@pytest.mark.filterwarnings("ignore:fit. Residuals are alike")
@pytest.mark.parametrize("sigma", [None, 1e-3])
@pytest.mark.parametrize("first", [2.0, 6.0, 300.0, 900.0])
def test_regression_vibrations_of_another_frequency_reach_the_solution(exact, first, sigma):
    """From values wrong by a factor of 7, searches stopped without progress or ran away."""
    data = {"t [s]": TIMES, "mass.x": exact + white()}
    result = bd.fit(
        oscillator, data, "stiffness", METHOD, parameters={"stiffness": first}, sigma=sigma
    )
    assert result.status.kind == "ok"
    # The damping keeps a value that is 0.2 N s/m too large.
    assert result.parameters["stiffness"] == pytest.approx(40.0, rel=0.02)


@bd.model(t_end=3.0)
def chain(k1=60.0, k2=90.0, damping=0.5):
    mech, one = free_ball((1.0, 0.0), velocity=(0.3, 0.0), name="one")
    two = mech.add(bd.PointMass("two", 0.7, at=(2.0, 0.0)))
    mech.add(bd.Spring("left", mech.ground.at(0.0, 0.0), one.point, k1, damping))
    mech.add(bd.Spring("right", one.point, two.point, k2, damping))
    mech.observe("two", two.point)
    return mech


def noisy_chain(times, method, t_end, share, seed):
    """Return data of the chain, and standard deviations of their noise as shares of the ranges."""
    run = bd.simulate(chain(), method, t_end=t_end).at_times(times)
    rng = np.random.default_rng(seed)
    data, sigma = {"t [s]": times}, {}
    for column in ("one.x", "two.x"):
        values = run[column].to_numpy()
        sigma[column] = share * np.ptp(values)
        data[column] = values + rng.normal(scale=sigma[column], size=len(times))
    return data, sigma


def test_regression_searches_that_start_out_of_phase_reach_the_solution():
    """Steps that reduce the amplitude ended in another minimum with the status "ok"."""
    data, sigma = noisy_chain(np.linspace(0.03, 3.0, 101), METHOD, 3.0, 0.01, seed=2)
    first = {"k1": 175.5, "k2": 51.4, "damping": 0.62}
    result = bd.fit(chain, data, list(first), METHOD, sigma=sigma, parameters=first)
    assert result.status.kind == "ok"
    assert result.parameters["k1"] == pytest.approx(60.0, rel=0.01)


@pytest.mark.parametrize("log", [[], ["stiffness", "damping", "mass"]])
def test_regression_undetermined_combinations_stay_close_to_the_first_values(exact, log):
    """A stiffness whose ratio to the mass is determined moved from 30 to 368 N/m."""
    data = {"t [s]": TIMES, "mass.x": exact + white(1e-4)}
    first = {"stiffness": 30.0, "damping": 0.7, "mass": 1.0}
    with pytest.warns(bd.BeamdaeWarning, match="do not change the fitted columns"):
        result = bd.fit(oscillator, data, list(first), METHOD, parameters=first, log=log)
    # The product of the three ratios to the first values is one.
    changes = [result.parameters[name] / value for name, value in first.items()]
    assert np.prod(changes) == pytest.approx(1.0, rel=1e-3)
    assert result.parameters["stiffness"] / result.parameters["mass"] == pytest.approx(
        40.0, rel=0.01
    )
    assert result.status.kind == "ok"


@pytest.mark.slow(reason="one to three seconds")
@pytest.mark.parametrize("shift", [(), "*"], ids=["times", "delay"])
def test_regression_one_mirrored_column_beside_others_is_named(shift):
    """Searches with the scales of all columns lost the phase, and parameters ran away."""
    method = bd.GeneralizedAlpha(step=0.015)
    data, sigma = noisy_chain(np.linspace(0.3, 3.0, 91), method, 3.5, 0.005, seed=3)
    data["two.x"] = 4.0 - data["two.x"]
    first = {"k1": 54.0, "k2": 80.0, "damping": 0.4}
    options = {"sigma": sigma, "parameters": first, "log": list(first), "shift": shift}
    named = r"scale of two\.x = -(1|0\.99\d), offset of two\.x = 4 m"
    with pytest.warns(bd.BeamdaeWarning, match=named):
        result = bd.fit(chain, data, list(first), method, **options)
    assert result.evaluations <= 30


@bd.model(t_end=1.0)
def pulled(stiffness=300.0, damping=1.0, mass=1.0):
    mech, body = free_ball((1.0, 0.0), mass=mass, name="mass", spring=(stiffness, damping))
    mech.add(bd.Force("pull", body.point, (lambda t: 3.0 * t, 0.0)))
    return mech


@pytest.mark.slow(reason="a second")
def test_searches_do_not_creep_along_values_that_the_model_rejects():
    """Next to a damping of zero, a search took 20 further short steps of the whole run."""
    times = np.linspace(0.0, 1.0, 101)
    method = bd.GeneralizedAlpha(step=5e-3)
    exact = bd.simulate(pulled(), method, output_step=0.01)["mass.x"].to_numpy()
    noise = np.random.default_rng(1).normal(scale=1e-4, size=len(times))
    data = {"t [s]": times, "mass.x": exact + noise}
    first = {"stiffness": 1500.0, "damping": 0.3, "mass": 1.0}
    result = bd.fit(pulled, data, list(first), method, parameters=first, sigma=1e-4)
    assert result.parameters["stiffness"] == pytest.approx(300.0, rel=0.01)
    assert result.evaluations <= 30


@bd.model(t_end=2.0)
def dropped(stiffness=95.0, damping=1.0, force=0.0):
    """Mass below a spring, from the unloaded length on, with a force at 1.3 Hz."""
    mech, body = free_ball(name="mass", gravity=9.81)
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 1.0), body.point, stiffness, damping))
    law = bd.sine(force, 1.3)
    mech.add(bd.Force("force", body.point, (0.0, law)))
    return mech


def dropped_mass(t):
    """Return the height for a stiffness of 100 N/m and a damping of 0.8 N s/m [m]."""
    decay, rate = 0.4, np.sqrt(100.0 - 0.4**2)
    vibration = np.exp(-decay * t) * (np.cos(rate * t) + decay / rate * np.sin(rate * t))
    return -9.81 / 100.0 * (1.0 - vibration)


def suggested_causes(values, sigma=5e-4, times=TIMES, **parameters):
    """Return the sentence on residuals that the model does not explain."""
    noise = np.random.default_rng(2).normal(scale=sigma, size=times.size)
    data = {"t [s]": times, "mass.y": values + noise}
    by = ["stiffness", "damping"]
    options = {"sigma": sigma, "parameters": parameters}
    with pytest.warns(bd.BeamdaeWarning, match="does not explain"):
        result = bd.fit(dropped, data, by, bd.GeneralizedAlpha(step=5e-3), **options)
    return next(x for x in result.warnings if "does not explain" in x)


@pytest.mark.parametrize(
    ("change", "cause", "size"),
    [
        (lambda t: dropped_mass(t) + 2e-3, "offset of mass.y = ", 0.002),
        (lambda t: 0.96 * dropped_mass(t), "scale of mass.y = ", 0.96),
        # The sag m g / k determines the frequency, and a scale has the same effect as the clock.
        (lambda t: dropped_mass(t / 1.02), "scale of mass.y = ", 0.96),
    ],
    ids=["offset", "scale", "clock"],
)
def test_regression_errors_that_explain_all_but_the_noise_of_sigma_are_named(change, cause, size):
    """Scales were not named."""
    sentence = suggested_causes(change(TIMES))
    assert float(sentence.partition(cause)[2].split()[0].rstrip(");")) == pytest.approx(
        size, rel=0.05
    )
    # Other properties do not differ from those of a perfect sensor.
    assert sentence.count(" of mass.y = ") == 1


@pytest.mark.parametrize("clock", [1.02, 0.97])
def test_clocks_are_named_and_estimated(clock):
    """A force of known frequency determines them."""
    true, times = {"stiffness": 100.0, "damping": 0.8}, np.linspace(0.1, 2.0, 150)
    run = bd.simulate(dropped(**true, force=5.0), bd.Radau(1e-7), t_end=2.2)
    values = run.at_times(times / clock)["mass.y"].to_numpy()
    sentence = suggested_causes(values, times=times, force=5.0)
    assert f"clock of mass.y = {clock:g}" in sentence
    options = {"sigma": 5e-4, "parameters": {"force": 5.0}, "clock": {"mass.y": (0.8, 1.2)}}
    data = {"t [s]": times, "mass.y": values}
    result = bd.fit(dropped, data, list(true), bd.Radau(1e-6), **options)
    assert result.sensors["clock of mass.y"] == pytest.approx(clock, rel=1e-5)
    assert result.parameters == pytest.approx(true, rel=1e-4)


@pytest.mark.parametrize("bounds", [(1.1, 0.9), (0.0, 1.0), ("a", 2.0)])
def test_bounds_of_clocks_are_positive_and_ascend(bounds):
    with pytest.raises(bd.BeamdaeError, match=r"clock of mass\.y must be \(lower"):
        bd.fit(dropped, {"t [s]": TIMES, "mass.y": TIMES}, "damping", clock={"mass.y": bounds})


def test_columns_with_constant_errors_are_named_together():
    """No error of one of them explains the residuals."""
    times = np.linspace(0.02, 2.0, 100)
    run = bd.simulate(dropped(stiffness=100.0, damping=0.8), METHOD, t_end=2.0).at_times(times)
    noise = np.random.default_rng(3).normal(scale=5e-4, size=(2, times.size))
    y, rate = run["mass.y"].to_numpy(), run["mass.y_dot"].to_numpy()
    data = {"t [s]": times, "mass.y": y + 0.004 + noise[0], "mass.y_dot": rate + 0.04 + noise[1]}
    sigma = {"mass.y": 5e-4, "mass.y_dot": 5e-4 * 10.0}
    with pytest.warns(bd.BeamdaeWarning, match="does not explain") as caught:
        bd.fit(dropped, data, ["stiffness", "damping"], METHOD, sigma=sigma)
    (sentence,) = [str(x.message) for x in caught if "does not explain" in str(x.message)]
    assert "offset=['mass.y', 'mass.y_dot']" in sentence
