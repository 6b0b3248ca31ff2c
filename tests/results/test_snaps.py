"""Warnings about motions of beams that snap, which depend on the elements."""

import re

import numpy as np
import pytest

import beamdae as bd
from beamdae import verification
from beamdae.results.diagnostics.meshes import refined_runs
from beamdae.results.diagnostics.meshes.snaps import find_snap

# A filter that matches no message, so that runs are checked although all warnings are ignored.
pytestmark = pytest.mark.filterwarnings("always:(?!):beamdae.errors.BeamdaeWarning")

STEEL = bd.Material.of("steel")
SPAN, HEIGHT = 0.5, 2e-3
SECTION = bd.Section.rectangle(STEEL, width=0.02, height=HEIGHT, damping=2e-4)
BUCKLING_FORCE = np.pi**2 * SECTION.EI / SPAN**2


def arch(elements, load=34.5, rise=8e-3, **settings):
    """Return a clamped arch with a sudden load; the limit load of slow loads is 38 N."""
    radius = (0.25 * SPAN**2 + rise**2) / (2.0 * rise)
    half = np.arcsin(0.5 * SPAN / radius)
    curve = bd.Arc(radius, 2.0 * half * radius, start=(0.5 * SPAN, 0.0), angle=np.pi - half)
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("arch", curve, SECTION, elements=elements, **settings))
    mech.add(bd.Weld("right", mech.ground.at(*beam.start.point), beam.start))
    mech.add(bd.Weld("left", mech.ground.at(*beam.end.point), beam.end))
    crown = beam.at(0.5 * beam.length)
    mech.add(bd.Force("press", crown, (0.0, -load)))
    mech.observe("crown", crown)
    return mech


def falling_rod(share):
    """Return a hinged rod that falls, with a weight of this share of its buckling force."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    rod = mech.add(bd.Beam("rod", bd.Line((0.0, 0.0), (0.0, SPAN)), SECTION, elements=4))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), rod.start))
    mech.add(bd.PointMass("weight", share * BUCKLING_FORCE / 9.81, on=rod.end))
    mech.add(bd.Force("push", rod.end, (1e-2 * BUCKLING_FORCE, 0.0)))
    mech.observe("top", rod.end)
    return mech


def run(model, t_end=0.05):
    return bd.simulate(model, t_end=t_end)


def find_sentences(solution):
    return [x for x in solution.warnings if "unstable states" in x]


@pytest.mark.slow(reason="seconds")
@pytest.mark.parametrize("settings", [{"formulation": "exact"}, {"strain": "exact"}])
def test_regression_snaps_have_their_error_by_the_elements(settings):
    """Positions were off by up to 12 % without a word."""
    solution, fine = (run(arch(n, 33.0, **settings)) for n in (4, 16))
    (sentence,) = find_sentences(solution)
    change = re.search(
        r"arch: 4 elements are too few .*: with halved elements, (\S+) differs by up to (\S+) % of "
        r"its range, .*; use elements=8\.$",
        sentence,
    )
    assert change is not None
    (header,) = (x for x in solution.columns if x.startswith(f"{change[1]} ["))
    error = np.max(np.abs(solution[header] - fine[header])) / np.ptp(solution[header])
    assert error > 0.1
    assert float(change[2]) == pytest.approx(100.0 * error, rel=0.1)


@pytest.mark.slow(reason="a second")
def test_snaps_with_enough_elements_have_no_warning():
    solution = run(arch(8))
    assert find_snap(solution.equations, solution.trajectory) is not None
    assert not find_sentences(solution)


@pytest.mark.parametrize("model", [arch(4, 10.0), falling_rod(0.1), falling_rod(0.2)])
def test_runs_without_a_snap_are_not_repeated(monkeypatch, model):
    def fail(*_):
        raise AssertionError("the run is repeated")

    monkeypatch.setattr(verification, "run_again", fail)
    solution = run(model)
    assert find_snap(solution.equations, solution.trajectory) is None
    assert not find_sentences(solution)


@pytest.mark.slow(reason="half a second")
def test_rods_that_buckle_while_they_fall_are_unstable():
    solution = run(falling_rod(2.0))
    assert find_snap(solution.equations, solution.trajectory) is not None


@pytest.mark.slow(reason="half a second")
def test_runs_that_are_too_long_to_repeat_name_few_elements(monkeypatch):
    monkeypatch.setattr(refined_runs, "_MAX_WORK", 1.0)
    (sentence,) = find_sentences(run(arch(4)))
    assert re.fullmatch(
        r"arch: 4 elements may be too few for a motion through unstable states \(as at t = \S+ s\),"
        r" and the run is too long to repeat it with halved elements; compare with elements=8\.",
        sentence,
    )
    assert not find_sentences(run(arch(8)))


def tapped_arch(elements, press):
    """Return a clamped arch that is pressed slowly and then tapped; its limit load is 82 N."""
    span, rise = 0.4, 8e-3
    radius = (0.25 * span**2 + rise**2) / (2.0 * rise)
    half = np.arcsin(0.5 * span / radius)
    curve = bd.Arc(radius, 2.0 * half * radius, start=(0.0, 0.0), angle=-half)
    section = bd.Section.rectangle(STEEL, width=0.02, height=HEIGHT, damping=1e-5)
    mech = bd.Mechanism()
    beam = mech.add(bd.Beam("arch", curve, section, elements=elements, formulation="exact"))
    for name, end in (("left", beam.start), ("right", beam.end)):
        mech.add(bd.Weld(name, mech.ground.at(*end.point), end))
    law = bd.table([0.0, 0.05, 2.0], [0.0, press, press], "pchip")
    mech.add(bd.Force("press", beam.at(0.5 * beam.length), (0.0, law)))
    pulse = bd.table([0.0, 0.064, 0.072, 0.08, 2.0], [0.0, 0.0, 2.0, 0.0, 0.0], "pchip")
    mech.add(bd.Force("tap", beam.at(0.4 * beam.length), (0.0, pulse)))
    mech.observe("quarter", beam.at(0.3 * beam.length))
    return mech


@pytest.mark.slow(reason="a second")
def test_regression_vibrations_near_the_limit_load_are_compared():
    """Vibrations at 80 % of the limit load were off by 3 % without a warning."""
    solution, fine = (run(tapped_arch(n, 66.0), 0.4) for n in (4, 20))
    assert find_snap(solution.equations, solution.trajectory) is None
    (sentence,) = find_sentences(solution)
    assert "are too few for a motion near unstable states" in sentence
    change = re.search(r"(quarter\.\w) (?:differs by up to )?(\S+) %", sentence)
    assert change is not None
    header = f"{change[1]} [m]"
    error = np.max(np.abs(solution[header] - fine[header])) / np.ptp(solution[header])
    assert error > 0.02
    assert float(change[2]) == pytest.approx(100.0 * error, rel=0.2)
    assert not find_sentences(fine)
