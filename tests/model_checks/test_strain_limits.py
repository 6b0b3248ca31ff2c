"""Strains of beams beyond linear elasticity."""

import pytest
from mechanisms import clamped_beam, rectangle

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
