"""What a model built knows the model it is from."""

import pytest

import beamdae as bd

ALPHA = bd.GeneralizedAlpha(step=0.05)


@bd.model(t_end=0.2)
def swing(mass=2.0):
    """Ball in free fall."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    mech.add(bd.PointMass("ball", mass, at=(0.0, 2.0)))
    return mech


def test_a_mechanism_runs_as_long_as_its_model_and_tells_its_parameters():
    run = bd.simulate(swing(mass=3.0), ALPHA)
    assert run.t[-1] == 0.2
    assert run.model == {"name": "swing", "parameters": {"mass": 3.0}, "t_end": 0.2}
    assert "swing by GeneralizedAlpha" in run._repr_html_()
    assert bd.simulate(swing(mass=3.0), ALPHA, t_end=0.1).t[-1] == 0.1
    assert bd.simulate(swing, ALPHA).model["parameters"] == {"mass": 2.0}
    assert bd.check(swing(mass=3.0), predict=False).name == "swing"


def test_going_on_knows_the_parameters_whoever_built_it():
    half = bd.simulate(swing(mass=3.0), ALPHA, t_end=0.1)
    assert bd.simulate(swing(mass=3.0), ALPHA, start=half).t[-1] == 0.2
    with pytest.raises(bd.BeamdaeError, match="mass"):
        bd.simulate(swing, ALPHA, start=half)


def test_what_no_model_built_has_no_end_time():
    with pytest.raises(bd.BeamdaeError, match="give t_end="):
        bd.simulate(swing.build(), ALPHA)
