"""Interrupts of fits and derivatives: finished results are kept."""

import numpy as np
import pytest

import beamdae as bd
from beamdae.errors import warn_user
from beamdae.interrupts import Interrupted

METHOD = bd.GeneralizedAlpha(step=0.02)
TIMES = np.linspace(0.1, 1.0, 10)
DATA = {"t [s]": TIMES, "mass.x": 1.0 + 0.2 / 40.0**0.5 * np.sin(40.0**0.5 * TIMES)}


class Oscillator:
    """Model function that is interrupted when it is called for the time number `n`."""

    def __init__(self, n):
        self.calls, self.n = 0, n

    def build(self, stiffness):
        self.calls += 1
        if self.calls == self.n:
            raise KeyboardInterrupt
        mech = bd.Mechanism()
        body = mech.add(bd.PointMass("mass", 1.0, at=(1.0, 0.0), velocity=(0.2, 0.0)))
        mech.add(bd.SpringDamper("spring", mech.ground.at(0.0, 0.0), body.point, stiffness))
        mech.observe("mass", body.point)
        return mech


def model(n=0):
    """Return a model function whose call number `n` is interrupted."""
    oscillator = Oscillator(n)

    @bd.model(t_end=1.0)
    def spring(stiffness=30.0):
        return oscillator.build(stiffness)

    return spring, oscillator


@pytest.mark.slow(reason="four fits")
def test_regression_an_interrupted_fit_has_its_best_estimates():
    """All evaluations were lost."""
    spring, oscillator = model()
    bd.fit(spring, DATA, "stiffness", METHOD, sigma=1e-4)
    # The last calls belong to the check of the steps.
    total = oscillator.calls
    errors = []
    for n in (total // 2, total):
        with pytest.raises(Interrupted, match=r"^fit: interrupted") as caught:
            bd.fit(model(n)[0], DATA, "stiffness", METHOD, sigma=1e-4)
        best = caught.value.partial
        assert isinstance(best, bd.Fit)
        assert best.status.kind == "interrupted"
        errors.append(abs(best.parameters["stiffness"] - 40.0))
    # The period of the discrete oscillator is longer by 0.1 %.
    assert errors[0] < 5.0
    assert errors[1] < 0.2
    result = bd.fit(model(total // 2)[0], DATA, "stiffness", METHOD, sigma=1e-4, partial="return")
    assert result.status.kind == "interrupted"
    assert "interrupted after" in repr(result)


@pytest.mark.slow(reason="three fits")
def test_interrupted_searches_with_parts_of_the_data_have_estimates_for_all_data():
    times = np.linspace(0.0, 2.0, 101)
    data = {"t [s]": times, "mass.x": 1.0 + 0.2 / 40.0**0.5 * np.sin(40.0**0.5 * times)}
    options = {"sigma": 1e-4, "parameters": {"stiffness": 900.0}}
    spring, oscillator = model()
    result = bd.fit(spring, data, "stiffness", bd.GeneralizedAlpha(step=0.01), **options)
    assert result.status.kind == "ok"
    found = []
    for share in (0.4, 0.5, 0.6):
        interrupted, _ = model(int(share * oscillator.calls))
        with pytest.raises(Interrupted) as caught:
            bd.fit(interrupted, data, "stiffness", bd.GeneralizedAlpha(step=0.01), **options)
        best = caught.value.partial
        assert best.residuals.size == times.size
        found.append("with a part of the data" in best.status.sentence)
    assert any(found)


def test_regression_the_first_run_of_a_fit_has_no_partial_result():
    with pytest.raises(Interrupted) as caught:
        bd.fit(model(3)[0], DATA, "stiffness", METHOD)
    assert caught.value.partial is None


@pytest.mark.parametrize("call", ["sensitivities", "gradient"])
def test_regression_derivatives_survive_an_interrupt_of_their_error_estimate(call, monkeypatch):
    """The repeated run was interrupted, and the first one with its derivatives was lost."""
    from beamdae.analysis.gradients import gradients
    from beamdae.analysis.sensitivities import sensitivities

    def interrupt(*_):
        raise KeyboardInterrupt

    for module in (gradients, sensitivities):
        monkeypatch.setattr(module, "_warn_of_step_errors", interrupt)
    spring, _ = model()
    function = getattr(bd, call)
    objective = [bd.EndValue("mass.x")] * (call == "gradient")
    with pytest.raises(Interrupted, match="error of the derivatives was estimated") as caught:
        function(spring, *objective, "stiffness", METHOD)
    assert isinstance(caught.value.partial, (bd.Gradient, bd.Sensitivities))


@pytest.mark.parametrize("call", ["sensitivities", "gradient"])
def test_regression_derivatives_of_interrupted_calls_list_warnings(call, monkeypatch):
    """The warnings of the call were lost, although they were issued before the interrupt."""
    from beamdae.analysis.gradients import gradients
    from beamdae.analysis.sensitivities import sensitivities

    def interrupt(*_):
        warn_user("coarse: a message")
        raise KeyboardInterrupt

    for module in (gradients, sensitivities):
        monkeypatch.setattr(module, "_warn_of_step_errors", interrupt)
    spring, _ = model()
    objective = [bd.EndValue("mass.x")] * (call == "gradient")
    with pytest.warns(bd.BeamdaeWarning, match="coarse"), pytest.raises(Interrupted) as caught:
        getattr(bd, call)(spring, *objective, "stiffness", METHOD)
    assert caught.value.partial.warnings == ("coarse: a message",)
