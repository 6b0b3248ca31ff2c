"""Errors of periodic motions by strains and elements of beams, amplified by resonances."""

from types import SimpleNamespace

import numpy as np
import pytest

import beamdae as bd
from beamdae.results.frequency_response import FrequencyResponse, ResponsePoint
from beamdae.results.outcome import Status
from beamdae.results.periodic_motion import BeamError

LENGTH = 0.35  # m
RUNS = bd.Radau(1e-6)


def blade(frequency, acceleration, elements=3, damping=2e-5, **settings):
    """Return a tapered blade of titanium on a shaker, with its first resonance at 43.7 Hz."""
    titanium = bd.Material(E=114e9, nu=0.34, rho=4430.0)
    mech = bd.Mechanism()
    slide = mech.add(bd.RigidBody("slide", mass=2.0, inertia=0.01))
    ground, up = mech.ground.at(0.0, 0.0), (0.0, 1.0)
    travel = bd.sine(acceleration / (2.0 * np.pi * frequency) ** 2, frequency)
    mech.add(bd.Prismatic("guide", ground, slide.at(0.0, 0.0), direction=up))
    mech.add(bd.TranslationalDriver("shaker", ground, slide.at(0.0, 0.0), travel, direction=up))

    def section(s):
        height = 6e-3 - 3e-3 * s / LENGTH
        return bd.Section.rectangle(titanium, width=0.03, height=height, damping=damping)

    line = bd.Line((0.0, 0.0), (LENGTH, 0.0))
    beam = mech.add(bd.Beam("blade", line, section, elements=elements, **settings))
    mech.add(bd.Weld("clamp", slide.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.deflection(LENGTH))
    mech.observe("root", beam.stress(0.0, "top"))
    return mech


def motion_of(frequency, *arguments, **settings):
    return bd.periodic(blade(frequency, *arguments, **settings), 1.0 / frequency, RUNS)


def half_range_of(motion):
    return motion.amplitudes().loc["tip.transverse [m]", "half range"]


@pytest.mark.parametrize(
    ("frequency", "acceleration", "size"),
    [
        (43.8, 15.0, 0.149),
        pytest.param(43.3, 25.0, 0.033, marks=pytest.mark.slow(reason="a second and more")),
        pytest.param(43.7, 25.0, 0.176, marks=pytest.mark.slow(reason="a second and more")),
        pytest.param(43.75, 8.0, 0.041, marks=pytest.mark.slow(reason="a second and more")),
    ],
)
def test_regression_errors_of_strains_include_the_resonance(frequency, acceleration, size):
    """Errors of 3 to 18 % had no warning, or one of at most 1 to 5 %."""
    with pytest.warns(bd.BeamdaeWarning, match="errors by the strains are"):
        motion = motion_of(frequency, acceleration)
    exact = motion_of(frequency, acceleration, strain="exact")
    error = half_range_of(motion) / half_range_of(exact) - 1.0
    assert abs(error) == pytest.approx(size, rel=0.1)
    assert motion.beam_error.columns["tip.transverse [m]"] == pytest.approx(error, rel=0.05)
    assert motion.warnings[0] == motion.beam_error.warning
    assert "at most about" not in " ".join(motion.warnings)
    assert exact.beam_error is None


@pytest.mark.slow(reason="a second")
def test_strains_have_no_warning_away_from_the_resonance():
    motion = motion_of(30.0, 25.0)
    assert motion.beam_error.size < 1e-3
    assert motion.warnings == ()


def shaken_blade(strain, frequency=15.3937, elements=4):
    """Return a uniform blade on a shaker of 2 m/s2, with its first resonance at 15.4 Hz."""
    titanium = bd.Material(E=113.8e9, nu=0.342, rho=4430.0)
    section = bd.Section.rectangle(titanium, width=0.025, height=0.003, damping=1e-4)
    mech = bd.Mechanism()
    slide = mech.add(bd.RigidBody("slide", mass=2.0, inertia=0.01))
    ground, up = mech.ground.at(0.0, 0.0), (0.0, 1.0)
    travel = bd.sine(2.0 / (2.0 * np.pi * frequency) ** 2, frequency)
    mech.add(bd.Prismatic("guide", ground, slide.at(0.0, 0.0), direction=up))
    mech.add(bd.TranslationalDriver("shaker", ground, slide.at(0.0, 0.0), travel, direction=up))
    line = bd.Line((0.0, 0.0), (0.4, 0.0))
    beam = mech.add(bd.Beam("blade", line, section, elements=elements, strain=strain))
    mech.add(bd.Weld("clamp", slide.at(0.0, 0.0), beam.start))
    mech.observe("R", beam.section_forces(0.0))
    return mech


@pytest.mark.filterwarnings("ignore:blade. errors by the strains")
def test_regression_errors_of_section_forces_do_not_contain_those_of_the_start():
    """Forces in the first steps of the exact motion led to -93 % of N and -39 % of Q."""
    green, exact = (
        bd.periodic(shaken_blade(strain), 1.0 / 15.3937, RUNS) for strain in ("green", "exact")
    )
    for header in ("R.N [N]", "R.Q [N]", "R.M [N m]"):
        sizes = (x.amplitudes().loc[header, "half range"] for x in (green, exact))
        error = np.divide(*sizes) - 1.0
        assert 0.01 < error < 0.03
        assert green.beam_error.columns[header] == pytest.approx(error, abs=2e-3)


@pytest.mark.slow(reason="five seconds: a free motion without damping")
def test_free_motions_have_no_amplified_errors_of_elements():
    """Their multipliers of 1 are no resonance."""
    steel = bd.Material.of("steel")
    section = bd.Section.rectangle(steel, width=0.02, height=0.001, damping=1e-4)
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    line = bd.Line((0.0, 0.0), (0.4, -0.5))
    beam = mech.add(bd.Beam("beam", line, section, elements=2, strain="exact"))
    mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    motion = bd.periodic(mech, integrator=bd.Radau(1e-7), period_guess=1.35, settle=2)
    assert motion.status.success
    assert motion.beam_error is None


def error_of(size, beams=("arm",)):
    return BeamError(beams, True, False, {"tip.y [m]": size})


def test_regression_responses_name_the_largest_error_of_beams():
    """The first error above 1 % was named, 1.3 % of 18 %."""
    errors = [None, error_of(0.013), error_of(-0.18), error_of(0.05), error_of(0.002)]
    solution = SimpleNamespace(warnings=(), row_warnings=(), fast_load_warnings=(), validity=())
    points = tuple(
        ResponsePoint(float(k), 1.0, solution, np.ones(1), beam_error=error)
        for k, error in enumerate(errors)
    )
    response = FrequencyResponse("f", points, Status("ok", "reached the end"))
    assert response.warnings == (
        "f = 2: arm: errors by the strains are -18 % of tip.y; use strain='exact'. Such motions: "
        "3 of 5.",
    )
    unknown = ResponsePoint(9.0, 1.0, solution, np.ones(1), beam_error=BeamError(("arm",), 1, 1))
    response = FrequencyResponse("f", (*points, unknown), Status("ok", "reached the end"))
    assert len(response.warnings) == 2
    assert response.warnings[1].startswith("f = 9: arm: with strain='exact' and twice as many")


@pytest.mark.slow(reason="half a second")
def test_regression_periodic_motions_have_no_errors_of_a_start():
    """The response to a start from rest had errors of 10 %, next to those of the motion."""
    with pytest.warns(bd.BeamdaeWarning, match="errors by the strains and elements"):
        motion = motion_of(275.0, 5.0, elements=2)
    assert not any("faster than waves" in warning for warning in motion.warnings)


@pytest.mark.slow(reason="one second")
def test_pulses_after_rest_in_periodic_motions_have_errors_of_waves():
    mech, period = bd.Mechanism(), 0.02
    steel = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
    bar = bd.Section.rectangle(steel, width=0.02, height=0.02, damping=2e-5)
    rod = mech.add(bd.Beam("rod", bd.Line((0.0, 0.0), (1.0, 0.0)), bar, elements=1))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), rod.start))
    times = [0.0, 0.01, 0.0105, 0.011, period]
    force = bd.table(times, [0.0, 0.0, 1e3, 0.0, 0.0], "pchip", outside="repeat")
    mech.add(bd.Force("blow", rod.end, (0.0, force)))
    mech.observe("root", rod.stress(0.1, "top"))
    with pytest.warns(bd.BeamdaeWarning, match="blow: this law rises within 0.00033 s"):
        bd.periodic(mech, period, RUNS)


@pytest.mark.slow(reason="half a second")
def test_regression_few_elements_near_a_buckling_load_are_halved():
    """Waves are long, but one element was too stiff: an error of 8 instead of 15 % was stated."""
    length, load = 0.5, 0.9

    def strut(elements):
        section = bd.Section.rectangle(
            bd.Material(E=70e9, nu=0.33, rho=2700.0), width=0.02, height=2e-3, damping=1e-3
        )
        euler = np.pi**2 * section.EI / length**2
        rate = (np.pi / length) ** 2 * ((1.0 - load) * section.EI / section.rhoA) ** 0.5
        frequency = 0.3 * rate / (2.0 * np.pi)
        mech = bd.Mechanism()
        line = bd.Line((0.0, 0.0), (length, 0.0))
        rod = mech.add(bd.Beam("rod", line, section, elements))
        mech.add(bd.Revolute("left", mech.ground.at(0.0, 0.0), rod.start))
        mech.add(bd.PointOnLine("right", mech.ground.at(0.0, 0.0), rod.end))
        mech.add(bd.Force("press", rod.end, (-load * euler, 0.0)))
        mech.add(bd.DistributedForce("shake", rod, (0.0, bd.sine(0.02, frequency))))
        mech.observe("middle", rod.at(0.5 * length))
        return bd.periodic(mech, 1.0 / frequency)

    with pytest.warns(bd.BeamdaeWarning, match="errors by the strains and elements are"):
        coarse = strut(1)
    fine = strut(8)
    sizes = [x.amplitudes().loc["middle.y [m]", "half range"] for x in (coarse, fine)]
    error = sizes[0] / sizes[1] - 1.0
    assert error < -0.1
    assert coarse.beam_error.columns["middle.y [m]"] == pytest.approx(error, rel=0.05)
    assert not any("too few" in x for x in coarse.warnings)
