"""Warnings about contacts that bounce because no dissipation is given."""

import warnings

import pytest

import beamdae as bd


def bouncing(**options):
    """Return warnings of a ball that falls 0.1 m on a floor, within 3.5 s."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(bd.PointMass("ball", 0.2, at=(0.0, 0.1)))
    floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
    mech.add(bd.Contact("floor", ball.point, floor, 1e6, **options))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        solution = bd.simulate(mech, t_end=3.5)
    return [x for x in solution.warnings if "dissipates no energy" in x]


def test_regression_contacts_bounce_without_dissipation_in_silence():
    (text,) = bouncing()
    assert text.startswith("floor: the contact opens 12 times")


@pytest.mark.parametrize(
    "options",
    [{"restitution": 1.0}, {"restitution": 0.5, "impact_speed": 1.4}],
    ids=["elastic", "dissipative"],
)
def test_given_restitution_has_no_warning(options):
    assert bouncing(**options) == []
