"""Warnings about contacts whose penetration exceeds the thickness of a beam."""

import warnings

import pytest

import beamdae as bd


def cantilever(stiffness, height=2e-3, start=None):
    """Cantilever of 0.2 m that a force of 10 N presses on a surface below its tip."""
    rubber = bd.Material(E=6e6, nu=0.45, rho=1150.0)
    section = bd.Section.rectangle(rubber, width=0.03, height=height, damping=3e-3)
    settings = {} if start is None else {"start": start}
    mech = bd.Mechanism(**settings)
    lip = mech.add(bd.Beam("lip", bd.Line((0, 0), (0.2, 0)), section, 2, formulation="exact"))
    mech.add(bd.Weld("clamp", mech.ground.at(0, 0), lip.start))
    mech.add(bd.Force("press", lip.end, (0.0, -10.0)))
    surface = bd.LineSurface(mech.ground.at(0.0, -1e-4))
    law = {"restitution": 0.1, "impact_speed": 0.1}
    mech.add(bd.Contact("glass", lip.end, surface, stiffness, exponent=1.0, **law))
    mech.observe("lip", lip.end)
    return mech


def deep_warnings(call, *arguments, **settings):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", bd.BeamdaeWarning)
        return [x for x in call(*arguments, **settings).warnings if "deep, more than" in x]


def test_regression_soft_contacts_let_parts_pass_in_silence():
    """A lip of 2 mm sank 22 mm into a surface, without a word."""
    (text,) = deep_warnings(bd.simulate, cantilever(1e3), t_end=0.2)
    assert text.startswith("glass: the contact sinks 0.0")
    assert "more than lip is thick (0.002 m)" in text
    # 10 N / (1e3 N/m) are 10 mm.
    (text,) = deep_warnings(bd.check, cantilever(1e3, start="equilibrium"))
    depth = float(text.split("sinks ")[1].split(" m deep")[0])
    assert 0.008 < depth <= 0.01  # the beam carries the rest


@pytest.mark.parametrize("start", [None, "equilibrium"])
def test_contacts_less_deep_than_the_beam_have_no_warning(start):
    assert deep_warnings(bd.simulate, cantilever(1e5, start=start), t_end=0.05) == []
    assert deep_warnings(bd.check, cantilever(1e5, start=start)) == []
    assert deep_warnings(bd.simulate, cantilever(1e3, 0.05, start), t_end=0.05) == []
