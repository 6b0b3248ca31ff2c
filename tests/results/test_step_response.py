"""Rise time, settling time, overshoot and steady-state error, against python-control."""

import control
import numpy as np
import pytest

import beamdae as bd

ROWS = 20_001


@pytest.fixture(scope="module", params=[0.2, 0.5, 1.2], ids=lambda x: f"damping ratio {x}")
def oscillator(request):
    """Return a step response of an oscillator from 0.5 to 2.5, 1 s after the start."""
    mech = bd.Mechanism()
    x, rate = mech.state("x", start=0.5), mech.state("rate")
    x.follows(rate)
    target = mech.input("target", bd.piecewise((1.0, 0.5), 2.5))
    rate.follows(target - x - 2.0 * request.param * rate)
    run = bd.simulate(mech, bd.Radau(1e-8), t_end=41.0, output_step=2e-3)
    return request.param, run


@pytest.mark.slow
def test_characteristics_are_those_of_python_control(oscillator):
    damping, run = oscillator
    times = np.linspace(0.0, 40.0, ROWS)
    system = control.TransferFunction([2.0], [1.0, 2.0 * damping, 1.0])
    _, response = control.step_response(system, times)
    expected = control.step_info(response, times, final_output=2.0)
    step = run.step_response("x", target=2.5, t=1.0)
    one_row = 1.01 * 2e-3
    assert step.rise_time == pytest.approx(expected["RiseTime"], abs=one_row)
    assert step.settling_time == pytest.approx(expected["SettlingTime"], abs=one_row)
    assert 100.0 * step.overshoot == pytest.approx(expected["Overshoot"], abs=1e-3)
    if expected["Overshoot"] > 0.0:
        assert step.peak == pytest.approx(0.5 + expected["Peak"], rel=1e-6)
        assert step.peak_time == pytest.approx(expected["PeakTime"], abs=one_row)
    assert abs(step.steady_state_error) < 2e-3


@pytest.mark.slow
def test_steps_downwards_and_other_bands():
    mech = bd.Mechanism()
    mech.state("level", lambda level, t: -level - 3.0)
    run = bd.simulate(mech, bd.Radau(1e-8), t_end=4.0, output_step=1e-3)
    step = run.step_response("level", target=-3.0, band=0.05)
    assert step.rise_time == pytest.approx(np.log(9.0), abs=1e-4)
    assert step.settling_time == pytest.approx(np.log(20.0), abs=1e-4)
    assert step.overshoot == 0.0
    assert step.steady_state_error == pytest.approx(-3.0 * np.exp(-4.0), rel=1e-5)
    short = run.step_response("level", target=-4.0)
    assert np.isnan([short.rise_time, short.settling_time]).all()


@pytest.mark.parametrize("scale", [0.01, 1.0, 100.0])
@pytest.mark.parametrize(
    ("duration", "damping", "is_steady"),
    [(40.0, 0.3, True), (8.0, 2.0, False), (0.1, 0.3, False), (20.0, 0.02, False)],
    ids=["settled", "slow", "short", "oscillating"],
)
def test_regression_errors_of_unsteady_responses_are_nan(scale, duration, damping, is_steady):
    """The last value of a vibration that had not settled was its steady state."""
    mech = bd.Mechanism()
    x, rate = mech.state("x", scale=scale), mech.state("rate", scale=scale)
    x.follows(rate)
    rate.follows(0.7 * scale - x - 2.0 * damping * rate)
    run = bd.simulate(mech, bd.Radau(1e-6), t_end=duration, output_step=duration / 400)
    step = run.step_response("x", target=scale)
    assert np.isnan(step.steady_state_error) != is_steady
    if is_steady:
        assert step.steady_state_error == pytest.approx(0.3 * scale, rel=1e-2)
        assert np.isnan(step.settling_time)


def test_responses_end_at_t_end():
    """A disturbance after the step was part of the response."""
    mech = bd.Mechanism()
    push = mech.input("push", bd.piecewise((5.0, 1.0), 3.0))
    x = mech.state("x")
    x.follows(push - x)
    run = bd.simulate(mech, bd.Radau(1e-8), t_end=10.0, output_step=2e-3)
    assert run.step_response("x", target=1.0).overshoot > 1.0
    # The end is between two rows.
    step = run.step_response("x", target=1.0, t_end=4.999)
    assert step.settling_time == pytest.approx(np.log(50.0), abs=1e-4)
    assert (step.overshoot, step.peak_time) == (0.0, 4.999)
    assert step.steady_state_error == pytest.approx(np.exp(-4.999), rel=1e-4)
    ended = run.step_response("x", t_end=3.0)
    assert ended.peak == pytest.approx(1.0 - np.exp(-3.0), rel=1e-6)
    assert np.isnan(ended.steady_state_error)
    later = run.step_response("x", target=3.0, t=5.0)
    assert later == run.step_response("x", target=3.0, t=5.0, t_end=10.0)


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"name": "x", "target": 0.5}, "x .* starts at 0.5, the target; pass target= and t= of"),
        ({"name": ["x", "rate"]}, r"\['x', 'rate'\] selects 2 columns; name one of them"),
        ({"name": "x", "t": 41.0}, "t must be within the run, 0 to 41 s, got 41 s"),
        ({"name": "x", "t": 2.0, "t_end": 2.0}, "t_end must be later than 2 s .* got 2 s"),
        ({"name": "x", "t_end": 42.0}, "t_end must be .* ends at 41 s, got 42 s"),
        ({"name": "x", "band": 0.0}, "band must be positive, got 0"),
        ({"name": "y"}, "y"),
    ],
)
def test_invalid_arguments_are_rejected(oscillator, options, reason):
    with pytest.raises(bd.BeamdaeError, match=reason):
        oscillator[1].step_response(**options)
