"""The printed representation of results is one short line."""

from __future__ import annotations

import re

import pytest

import beamdae as bd

STRIP = bd.Section.rectangle(bd.Material(E=2e9, nu=0.3, rho=1200.0), 0.02, 0.004, damping=1e-3)


def clamped(weight=9.81):
    mech = bd.Mechanism(gravity=(0.0, -weight))
    beam = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), (0.3, 0.0)), STRIP, elements=1))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("push", beam.end, (0.0, bd.sine(0.01, 2.0)), axes="body"))
    mech.observe("tip", beam.end)
    return mech


RESULTS = {
    "solution": (lambda: bd.simulate(clamped(), bd.Radau(1e-3), 0.01), r"Solution by Radau.*tip"),
    "mechanism": (clamped, r"Mechanism of 3 parts: strip, clamp, push"),
    "check": (lambda: bd.check(clamped()), r"Check of mechanism: .*; ready to run"),
    "equilibrium": (lambda: bd.equilibrium(clamped()), r"Equilibrium: ok.*load factor 1"),
    "modes": (lambda: bd.modes(clamped(), n=2), r"Modes about reference: 2, [\d.]+ Hz, [\d.]+ Hz"),
    "many modes": (
        lambda: bd.modes(clamped(), n=6),
        r"Modes about reference: 6, .* Hz, .*, \.\.\.",
    ),
    "campbell": (
        lambda: bd.campbell(clamped(weight=0.0), [0.0, 5.0], 2),
        r"Campbell: 2 modes at 2 speeds, 0 to 5 rad/s",
    ),
    "linear model": (
        lambda: bd.linearize(clamped(), inputs=["push"], outputs=["tip"]),
        r"LinearModel about .*inputs: push\.Fx, push\.Fy; outputs: tip\.x, tip\.y, ",
    ),
    "periodic": (lambda: bd.periodic(clamped(), 0.5), r"PeriodicMotion: period 0\.5 s, ok, stable"),
    "section forces": (
        lambda: bd.simulate(clamped(), bd.Radau(1e-3), 0.01).section_forces("strip"),
        r"SectionForces of strip: \d+ sections at 1001 times, 0 to 0\.01 s",
    ),
}


@pytest.mark.parametrize(("make", "pattern"), RESULTS.values(), ids=RESULTS)
def test_results_are_printed_as_one_short_line(make, pattern):
    text = repr(make())
    assert len(text) < 250
    assert text.isprintable()
    assert re.match(rf"<{pattern}.*>$", text)


def test_long_mechanisms_and_beams_are_abbreviated():
    mech = bd.Mechanism()
    assert repr(mech) == "<Mechanism of 0 parts>"
    for k in range(1000):
        mech.add(bd.PointMass(f"ball {k}", 1.0, at=(0.1 * k, 0.0)))
    assert re.match(r"<Mechanism of 1000 parts: ball 0, .*ball 5, \.\.\.>$", repr(mech))
    beam = bd.Beam("strip", bd.Line((0.0, 0.0), (0.3, 0.0)), STRIP, elements=2)
    assert repr(beam) == "Beam(name='strip', 0.3 m in 2 elements)"


def test_a_check_is_displayed_as_a_table():
    page = bd.check(clamped())._repr_html_()
    assert "ready to run" in page
    assert page.count("<tr>") == len(str(bd.check(clamped())).splitlines()) - 1


def test_regression_decaying_modes_are_no_vibrations_of_zero_hertz():
    """An overdamped axial mode of a leaf spring was shown as 0 Hz beside vibrations."""
    mech = bd.Mechanism()
    mass = mech.add(bd.PointMass("mass", 1.0, at=(1.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), mass.point, (1.0, 0.0)))
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), mass.point, 100.0, 50.0))
    assert repr(bd.modes(mech)) == "<Modes about reference: 2, decay, decay>"
