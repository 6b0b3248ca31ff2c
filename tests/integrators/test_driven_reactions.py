"""Reactions of mechanisms whose motion joints and drivers prescribe."""

import numpy as np
import pytest
from mechanisms import driven_slide, reaction_of_driven_slide

import beamdae as bd


def simulate(mech, method, t_end=1.0):
    run = bd.simulate(mech, method, t_end)
    return run, [x for x in run.warnings if x.startswith("drive.F: the error")]


def relative_error(run, **motion):
    exact = reaction_of_driven_slide(run.t, **motion)
    return np.max(np.abs(run["drive.F"].to_numpy() - exact)) / (0.5 * np.ptp(exact))


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize("speed", [0.1, 0.01, 1e-3])
def test_regression_reactions_of_driven_mechanisms_are_resolved_by_radau(speed, rtol):
    """The reaction was wrong by 69 % of half its range at rtol = 1e-5, without a warning."""
    run, found = simulate(driven_slide(speed=speed), bd.Radau(rtol))
    assert relative_error(run, speed=speed) < 100.0 * rtol
    assert found == []


def test_regression_reactions_of_driven_mechanisms_have_a_warning_with_fixed_steps():
    """Torques of a press were 136 % too large with steps of 1 ms, without a warning."""
    run, found = simulate(driven_slide(), bd.GeneralizedAlpha(1e-2))
    assert relative_error(run) > 0.1
    (sentence,) = found
    assert sentence.startswith("drive.F: the error is ")
    assert "use step=" in sentence


@pytest.mark.slow(reason="half a second")
def test_accurate_reactions_of_driven_mechanisms_have_no_warning():
    smooth = {"speed": 1.0}
    for method in (bd.GeneralizedAlpha(1e-3), bd.Radau(1e-3), bd.Radau(), bd.Ida()):
        run, found = simulate(driven_slide(**smooth), method)
        assert relative_error(run, **smooth) < 0.01
        assert found == []


def test_jumps_of_reactions_of_driven_mechanisms_do_not_stop_radau():
    mech = driven_slide(speed=1e-9)
    run, _ = simulate(mech, bd.Radau(1e-8))
    assert run.status.kind == "ok"
    assert (
        np.median(np.abs(run["drive.F"].to_numpy() - reaction_of_driven_slide(run.t, speed=1e-9)))
        < 1.0
    )


@pytest.mark.slow(reason="half a second")
def test_regression_reactions_of_driven_mechanisms_have_accurate_derivatives():
    """Derivatives of a reaction with respect to the scale of the force were wrong by 28 %."""

    @bd.model(t_end=1.0)
    def slide(scale=1.0):
        return driven_slide(scale=scale)

    result = bd.sensitivities(slide, "scale")
    exact = reaction_of_driven_slide(result.t) - reaction_of_driven_slide(result.t, force=0.0)
    error = np.abs(result.sensitivity("drive.F", "scale").to_numpy() - exact)
    assert np.max(error) < 1e-3 * 0.5 * np.ptp(exact)


@pytest.mark.parametrize("method", [bd.Ida, bd.Radau])
@pytest.mark.parametrize("time_constant", [1e-2, 1e-4, 1e-6, 1e-1])
def test_regression_reactions_of_driven_mechanisms_with_filters_are_resolved(time_constant, method):
    """The reaction was wrong by up to 95 % of half its range.

    Short steps at peaks of rates of fast states were repeated without end.
    """
    mech = driven_slide(filter_time=time_constant)
    run, found = simulate(mech, method(1e-5))
    assert run.status.kind == "ok"
    assert relative_error(run) < 1e-3
    assert found == []


@pytest.mark.parametrize("time_constant", [None, 1e-3])
@pytest.mark.parametrize("rtol", [1e-3, 1e-5])
@pytest.mark.parametrize("speed", [0.1, 0.01, 1e-3])
def test_regression_reactions_are_resolved_by_generalized_alpha(speed, rtol, time_constant):
    """The reaction was wrong by 5 to 87 % of half its range with adaptive steps, with a warning."""
    mech = driven_slide(speed=speed, filter_time=time_constant)
    run, found = simulate(mech, bd.GeneralizedAlpha(rtol=rtol))
    assert run.status.kind == "ok"
    assert relative_error(run, speed=speed) < 100.0 * rtol
    assert found == []
