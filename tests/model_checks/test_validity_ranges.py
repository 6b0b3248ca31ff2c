"""Warnings about strains and tables beyond their ranges."""

import numpy as np
import pytest
from mechanisms import clamped_beam, free_ball, rectangle

import beamdae as bd

SOFT = bd.Material(E=1e7, nu=0.3, rho=1000.0)
STRIP = rectangle(0.01, 1.0, damping=0.3, material=SOFT)


LINE = bd.Line((0.0, 0.0), (1.0, 0.0))


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize("settings", [{"formulation": "exact"}, {"strain": "exact"}, {}])
@pytest.mark.parametrize(("strain", "is_reported"), [(-101.0, True), (0.9, True), (0.1, False)])
def test_strains_beyond_linear_elasticity_are_reported(settings, strain, is_reported):
    """A cantilever pulled to (1 + strain) of its length; at -100 m, its axis is inverted."""
    if not settings and abs(strain) > 1.0:
        settings = {"strain": "linear"}
    mech, beam = clamped_beam(STRIP, 2, LINE, name="bar", **settings)
    mech.add(bd.Force("pull", beam.end, (strain * STRIP.EA, 0.0)))
    result = bd.equilibrium(mech)
    sentences = [x for x in result.warnings if "linear elasticity" in x]
    assert bool(sentences) == is_reported
    assert all(x.startswith("bar: the largest strain is") for x in sentences)
    if strain == 0.9 or settings.get("strain") == "linear":
        return
    mech.start = "equilibrium"
    run = bd.simulate(mech, bd.Radau(1e-4), 1e-5)
    assert any("linear elasticity" in x for x in run.warnings) == is_reported
    if settings.get("formulation") == "exact":
        (sentence,) = sentences or ("strain is 0.1,",)
        assert float(sentence.split("strain is ")[1].split(",")[0]) == pytest.approx(abs(strain))


@pytest.mark.parametrize(
    ("modulus", "strain"), [(2.1e11, 0.03), (7e10, 0.03), (1e10, 0.03), (1e9, 0.6)]
)
def test_regression_stiff_materials_are_not_strained_by_several_percent(modulus, strain):
    """Steel at 44 GPa, and a steel rod at five times the Euler load, 2 % strain, were silent."""
    section = rectangle(0.001, 0.01, material=bd.Material(modulus, 0.3, 7850.0))
    for factor, is_reported in ((1.0, True), (0.5, False)):
        mech, beam = clamped_beam(section, 2, LINE, name="leaf", formulation="exact")
        mech.add(bd.Force("pull", beam.end, (factor * strain * section.EA, 0.0)))
        sentences = [x for x in bd.equilibrium(mech).warnings if "linear elasticity" in x]
        assert bool(sentences) == is_reported


@pytest.mark.parametrize("height", [0.001, 0.02])
@pytest.mark.parametrize("profile", ["rectangle", "i_profile"])
def test_a_yield_stress_is_the_limit_of_linear_elasticity(profile, height):
    steel = bd.Material(2.1e11, 0.3, 7850.0, yield_stress=250e6)
    more = {"flange": 0.1 * height, "web": 1e-3} if profile == "i_profile" else {}
    section = getattr(bd.Section, profile)(steel, width=0.01, height=height, **more)
    for utilization in (0.98, 1.02):
        mech, beam = clamped_beam(section, 2, LINE, name="leaf")
        moment = utilization * steel.yield_stress * section.EI / (0.5 * height * steel.E)
        mech.add(bd.Moment("bend", beam.end, moment))
        path = bd.equilibrium(mech)
        sentences = [x for x in path.warnings if "yield stress" in x]
        assert bool(sentences) == (utilization > 1.0)
        assert (path.section_forces(beam).safety().factor < 1.0) == bool(sentences)
        assert all(x.startswith("leaf: the largest stress is 2.55e+08 Pa, ") for x in sentences)


LEFT = "where its value is held"


def falling(rows, values, argument=lambda point, t: point.position[1], kind="linear"):
    """Return a ball that falls from 1 m with a force from a table."""
    table = bd.table(rows, values, kind=kind, name="curve")
    mech, ball = free_ball((0.0, 1.0), gravity=9.81)
    mech.add(bd.ForceLaw("pull", ball.point, lambda x, t: (0.0, table(argument(x, t)))))
    return mech


def turning(rows, values, outside="hold", unit=1.0):
    """Return a disk that turns twice with a torque from a table of its angle, times `unit`."""
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody("disk", 1.0, 1.0, (0.0, 0.0), angular_velocity=4.0 * np.pi))
    center = disk.at(0.0, 0.0)
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), center))
    table = bd.table(rows, values, "pchip", outside)
    mech.add(bd.ForceLaw("load", center, lambda disk, t: (0, 0, table(unit * disk.angle))))
    return mech


TURN, LOAD = np.radians([0.0, 90.0, 180.0, 270.0, 360.0]), [0.0, 0.0, -1.0, 0.0, 0.0]


# Model, end of the run, and words of the warning, or "".
CASES = {
    "left": (falling([0.5, 1.5], [-3.0, 3.0]), 0.9, LEFT),
    "left, nearly constant": (falling([0.5, 1.0, 1.5], [2.0, 2.001, 3.0]), 0.6, LEFT),
    "left at both sides": (falling([0.9, 0.95], [1.0, 2.0]), 0.2, LEFT),
    "zero at the end": (falling([0.5, 1.0, 1.5], [0.0, 3.0, 3.0]), 0.9, ""),
    "constant at the end": (falling([0.5, 1.0, 1.5], [2.0, 2.0, 3.0]), 0.9, ""),
    "rounding": (falling([0.5, 1.0, 1.5], [0.1 + 0.2, 0.3, 3.0]), 0.6, ""),
    "rounding of zero": (falling([0.5, 1.0, 1.5], [1e-16, 1.0, 3.0]), 0.6, ""),
    "over time": (falling([0.0, 0.1], [0.0, 3.0], lambda point, t: t), 0.3, ""),
    "inside": (falling([-1.0, 0.0, 1.0, 2.0], [1.0, 2.0, 1.0, 3.0]), 0.3, ""),
    "repeated turn": (turning(TURN, LOAD, "repeat"), 1.0, ""),
    "stop of a turn": (turning(TURN, [0.0, 0.0, 0.0, -1.0, -1.0]), 1.0, ""),
    "part of a turn": (turning(0.9 * TURN, LOAD), 1.0, ""),
}


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(("mech", "t_end", "words"), CASES.values(), ids=CASES.keys())
def test_arguments_that_leave_a_table_have_a_warning(mech, t_end, words):
    run = bd.simulate(mech, bd.Radau(1e-4), t_end=t_end)
    found = [x for x in run.warnings if LEFT in x]
    assert len(found) == bool(words)


def test_warnings_name_the_argument():
    (left,) = bd.simulate(falling([0.5, 1.5], [-3.0, 3.0]), t_end=0.9).warnings
    assert left.startswith("pull: x = -3.")
    assert "leaves the range 0.5 to 1.5 of curve at t = 0.9 s, where its value is held" in left
