"""Warnings about contacts whose sliding speed is below the regularization of their friction."""

import warnings

import pytest

import beamdae as bd


def glass(friction_speed, speed=0.3, push=0.0, friction=0.2):
    """Return a glass that rests on a table and slides or is pushed."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    mass = mech.add(bd.PointMass("mass", 0.3, at=(0.0, 0.0), velocity=(speed, 0.0)))
    table = bd.LineSurface(mech.ground.at(0.0, 0.0))
    law = {"friction": friction, "friction_speed": friction_speed}
    mech.add(bd.Contact("glass", mass.point, table, 1e6, **law))
    mech.add(bd.Force("push", mass.point, (push, 0.0)))
    mech.observe("mass", mass.point)
    return mech


def simulate_quietly(mech, **settings):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="push: ")
        return bd.simulate(mech, **settings)


@pytest.mark.parametrize("integrator", [bd.Auto(), bd.Radau(), bd.GeneralizedAlpha(step=1e-3)])
def test_regression_friction_below_its_law_is_reported(integrator):
    """A glass that slid at 0.3 m/s with friction_speed=1.0 kept sliding without a warning."""
    message = (
        r"glass: the sliding speed is below friction_speed \(1 m/s\) during 100 % of the contact, "
        r"which reduces the friction to \d+ % of friction N; use a smaller friction_speed=."
    )
    with pytest.warns(bd.BeamdaeWarning, match=message):
        bd.simulate(glass(1.0, push=0.01), integrator, t_end=0.5)


@pytest.mark.parametrize(
    "settings",
    [
        {"friction_speed": 1e-3},
        # Slides during the first 0.15 s and rests afterwards.
        {"friction_speed": 1e-3, "push": 0.01},
        # Sticks, with creep over less than a millimeter.
        {"friction_speed": 1e-3, "speed": 0.0, "push": 0.3},
        {"friction_speed": 1.0, "friction": 0.0},
        # Rests without any tangential force.
        {"friction_speed": 1.0, "speed": 0.0},
    ],
)
def test_sliding_sticking_and_resting_contacts_carry_no_warning(settings):
    run = simulate_quietly(glass(**settings), t_end=0.5)
    assert not any("friction_speed" in sentence for sentence in run.warnings)
