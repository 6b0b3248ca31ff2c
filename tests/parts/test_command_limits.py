"""Commands of controllers at their limits, where there is no feedback."""

import warnings

import pytest
from mechanisms import mass_on_rail

import beamdae as bd

LIMIT = 5.0


def build_stage(target, limits=(-LIMIT, LIMIT), ki=4.0, size=1.0):
    """Return a mass on a spring whose force is limited by `pid`."""
    mech, stage = mass_on_rail(2.0, name="stage")
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), stage.point, 20.0 * size))
    x, v = (mech.sensor(name, stage.point, name) for name in ("x", "x_dot"))
    gains = {"kp": 6.0 * size, "ki": ki * size, "kd": 3.0 * size}
    error, limits = mech.input("target", target) - x, tuple(size * x for x in limits)
    force = bd.pid(mech, "servo", error, **gains, rate=-v, limits=limits)
    mech.add(bd.Force("motor", stage.point, (force, 0.0)))
    return mech


def limit_sentences(analysis, *arguments, **options):
    with warnings.catch_warnings(record=True) as issued:
        warnings.simplefilter("always")
        analysis(*arguments, **options)
    return [str(x.message) for x in issued if "its limit" in str(x.message)]


@pytest.mark.parametrize("size", [0.1, 1.0, 1e3])
@pytest.mark.parametrize("target", [2.0, -2.0, 0.05])
@pytest.mark.parametrize("ki", [4.0, 0.0])
def test_regression_saturated_loops_have_no_feedback_in_silence(target, size, ki):
    """Poles were those of the open loop, without a word."""
    model = build_stage(target, size=size, ki=ki)
    sign = -1 if target < 0.0 else 1
    beyond = f"is beyond its limit {sign * LIMIT * size:.4g}, so "
    for analysis in (bd.linearize, bd.modes):
        sentences = limit_sentences(analysis, model)
        assert len(sentences) == (abs(target) > 1.0)
        for sentence in sentences:
            assert sentence.startswith(f"servo: the command {6.0 * size * target:.4g} {beyond}")
            assert "contains no feedback through it" in sentence
    sentences = limit_sentences(bd.equilibrium, model)
    assert len(sentences) == (abs(target) > 1.0)
    assert all(f"{beyond}this equilibrium is that of the limit" in x for x in sentences)


@pytest.mark.slow(reason="a fifth of a second")
def test_linear_models_at_a_limit_contain_half_of_the_feedback():
    model = build_stage(0.0, limits=(0.0, LIMIT), ki=0.0)
    (sentence,) = limit_sentences(bd.linearize, model)
    assert sentence.startswith("servo: the command 0 is at its limit, so the linear model contains")
    assert not limit_sentences(bd.equilibrium, model)
    with pytest.warns(bd.BeamdaeWarning, match="half of the feedback"):
        linear = bd.linearize(model)
    # x'' = -(20 + 6 / 2) x / 2 - (3 / 2) x' / 2
    assert sum(linear.poles).real == pytest.approx(-0.75)
    assert abs(linear.poles[0]) ** 2 == pytest.approx(11.5)
