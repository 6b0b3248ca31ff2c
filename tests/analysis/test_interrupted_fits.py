"""Interrupts of fits and derivatives: finished results are kept."""

import numpy as np
import pytest
from mechanisms import free_ball

import beamdae as bd
from beamdae.errors import warn_user
from beamdae.interrupts import Interrupted

METHOD = bd.GeneralizedAlpha(step=0.02)
TIMES = np.linspace(0.1, 1.0, 10)
DATA = {"t [s]": TIMES, "mass.x": 1.0 + 0.2 / 40.0**0.5 * np.sin(40.0**0.5 * TIMES)}


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
    bd.fit(spring, DATA, "stiffness", METHOD, sigma=1e-4)
    # The last calls belong to the check of the steps.
    total = oscillator.calls
    errors = []
    for n in (total // 2, total):
        with pytest.raises(Interrupted, match=r"^fit: interrupted") as caught:
            bd.fit(model(n)[0], DATA, "stiffness", METHOD, sigma=1e-4)
        best = caught.value.partial
        assert isinstance(best, bd.results.Fit)
        assert best.status.kind == "interrupted"
        errors.append(abs(best.parameters["stiffness"] - 40.0))
    # The period of the discrete oscillator is longer by 0.1 %.
    assert errors[0] < 5.0
    assert errors[1] < 0.2
    result = bd.fit(model(total // 2)[0], DATA, "stiffness", METHOD, sigma=1e-4, partial="return")
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
        bd.fit(model(3)[0], DATA, "stiffness", METHOD)
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
        getattr(bd, call)(spring, *objective, "stiffness", METHOD)
    assert isinstance(caught.value.partial, (bd.results.Gradient, bd.results.Sensitivities))
    assert caught.value.partial.warnings == ("coarse: a message",)
