"""Warnings about columns of runs that change with exact strains."""

import re

import numpy as np
import pytest

import beamdae as bd
from beamdae import verification
from beamdae.integrators import drive
from beamdae.integrators.amplitudes import Amplitudes
from beamdae.results import run_checks
from beamdae.results.diagnostics.meshes import refined_runs
from beamdae.results.diagnostics.meshes.refined_runs import refine_run
from beamdae.results.run_checks import BEAMS, STEPS, skip_error_estimates

# A filter that matches no message, so that runs are checked although all warnings are ignored.
pytestmark = pytest.mark.filterwarnings("always:(?!):beamdae.errors.BeamdaeWarning")

SOFT = bd.Material(E=1e7, nu=0.3, rho=1000.0)
EXACT = {"strain": "exact"}
ESTIMATE = "the error of deflections is at most about"


def cantilever(observed=("tip", "root"), height=0.05, force=0.0, **settings):
    """Return a soft cantilever of 1 m that gravity bends, and a force of 10 Hz at its end."""
    strip = bd.Section.rectangle(SOFT, width=1.0, height=height, damping=1e-3)
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    beam = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), (1.0, 0.0)), strip, 3, **settings))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("push", beam.end, (0.0, bd.sine(force, 10.0))))
    quantities = {"tip": beam.end, "root": beam.strain(0.0, "top")}
    for name in observed:
        mech.observe(name, quantities[name])
    return mech


def hanging_strip(**settings):
    """Return a strip that a heavy body swings: its estimate is far above its error."""
    strip = bd.Section.rectangle(SOFT, width=0.05, height=0.01, damping=1e-3)
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    beam = mech.add(bd.Beam("strip", bd.Line((0.0, 0.0), (0.0, -0.1)), strip, 2, **settings))
    body = mech.add(bd.RigidBody("bob", 0.2, 1e-4, (0.0, -0.6), velocity=(1.0, 0.0)))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Weld("top", beam.end, body.at(0.0, -0.1)))
    mech.observe("bob", body.at(0.0, -0.6))
    return mech


def run(model, t_end=0.3, **options):
    return bd.simulate(model, bd.Radau(1e-4), t_end, **options)


def find_sentences(solution):
    return [x for x in solution.warnings if "away from the floating frame" in x]


def largest_difference(one, other, header):
    return np.max(np.abs(one[header] - other[header])) / np.ptp(one[header])


@pytest.mark.slow(reason="a second")
def test_runs_state_the_difference_from_exact_strains_instead_of_an_estimate():
    solution, exact = run(cantilever()), run(cantilever(**EXACT))
    (sentence,) = find_sentences(solution)
    assert ESTIMATE not in sentence
    assert solution.validity[0].error > 0.1
    # Positions differ by less than 1 %.
    found = re.search(r": with exact strains, the peak of root differs by (\S+) %; ", sentence)
    assert found is not None
    peaks = [np.max(np.abs(x["root [-]"])) for x in (solution, exact)]
    assert float(found[1]) == pytest.approx(100.0 * abs(peaks[1] / peaks[0] - 1.0), rel=0.05)
    assert largest_difference(solution, exact, "tip.angle [rad]") < 0.01


@pytest.mark.slow(reason="half a second")
def test_differences_of_positions_are_those_at_any_row():
    solution, exact = (run(cantilever(["tip"], 0.04, **x), 0.4) for x in ({}, EXACT))
    (sentence,) = find_sentences(solution)
    found = re.search(
        r"exact strains, (tip\.\w+) differs by up to (\S+) % of its range, by over 1 % from "
        r"t = (\S+) s on, and its range by",
        sentence,
    )
    assert found is not None
    (header,) = (x for x in solution.columns if x.startswith(f"{found[1]} ["))
    difference = largest_difference(solution, exact, header)
    assert float(found[2]) == pytest.approx(100.0 * difference, rel=0.05)
    before = solution.t < 0.99 * float(found[3])
    change = np.abs(solution[header] - exact[header])[before]
    assert 0.005 < np.max(change) / np.ptp(solution[header]) <= 0.0101


@pytest.mark.slow(reason="a second")
def test_regression_beams_that_heavy_bodies_bend_have_no_false_alarm():
    """The estimate was 1 % for errors of less than 0.1 %."""
    solution, exact = run(hanging_strip()), run(hanging_strip(**EXACT))
    assert solution.validity[0].error > 0.01
    assert not find_sentences(solution)
    assert max(largest_difference(solution, exact, x) for x in solution.columns) < 1e-3


@pytest.mark.parametrize("halved", [False, True])
def test_repeated_runs_take_their_amplitudes_from_the_first_one(monkeypatch, halved):
    """Pilot runs were a third of the time of repeated runs."""
    pilot_runs, runs = [], []
    run_pilot, run_again = drive.run_pilot, verification.run_again
    monkeypatch.setattr(drive, "run_pilot", lambda *x: pilot_runs.append(1) or run_pilot(*x))
    monkeypatch.setattr(
        verification, "run_again", lambda *x: runs.append(run_again(*x)) or runs[-1]
    )
    solution = run(cantilever())
    assert len(pilot_runs) == 1
    if halved:
        refine_run(solution, run_checks._repeat_with_beams(solution), halved=["strip"])
    assert len(runs) == 1 + halved
    assert len(pilot_runs) == 1
    for again in runs:
        measured = Amplitudes.from_trajectory(again.equations, again.trajectory)
        for name, amplitude in again.integrator["amplitudes"].items():
            assert amplitude == pytest.approx(measured.by_part[name], rel=0.1)


@pytest.mark.slow(reason="half a second")
def test_runs_that_start_in_equilibrium_are_repeated_from_their_own():
    solution, exact = (run(cantilever(force=5.0, **x), start="equilibrium") for x in ({}, EXACT))
    (sentence,) = find_sentences(solution)
    (found,) = re.findall(r"tip.x differs by up to (\S+) % of its range from the", sentence)
    x = solution["tip.x [m]"]
    difference = np.max(np.abs(x - exact["tip.x [m]"]))
    assert difference > np.ptp(x)
    # The tip is drawn at x = 1 m.
    assert float(found) == pytest.approx(100.0 * difference / (1.0 - np.min(x)), rel=0.05)


@pytest.mark.parametrize("reason", ["long", "failed", "estimate", "no columns"])
def test_runs_that_are_not_repeated_have_the_estimate(monkeypatch, reason):
    if reason == "long":
        monkeypatch.setattr(refined_runs, "_MAX_WORK", 100)
    if reason == "failed":
        monkeypatch.setattr(verification, "run_again", lambda *_: None)
    with skip_error_estimates(BEAMS if reason == "estimate" else STEPS):
        solution = run(cantilever(() if reason == "no columns" else ("tip",)))
    (sentence,) = find_sentences(solution)
    assert ESTIMATE in sentence


@pytest.mark.slow(reason="a second")
def test_chaotic_motions_are_named():
    section = bd.Section.rectangle(
        bd.Material(E=2.7e9, nu=0.37, rho=1410.0), 0.02, 0.003, damping=1e-3
    )
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    end = mech.ground.at(0.0, 0.0)
    for k in range(2):
        line = bd.Line((0.5 * k, 0.0), (0.5 * (k + 1), 0.0))
        beam = mech.add(bd.Beam(f"arm {k}", line, section, elements=2))
        mech.add(bd.Revolute(f"joint {k}", end, beam.start))
        end = beam.end
    mech.observe("tip", end)
    (sentence,) = find_sentences(bd.simulate(mech, t_end=6.0))
    assert "s instead of values at one time." in sentence
    assert re.search(
        r"The motion is chaotic \(changes of the start grow \de\+0\d times\)", sentence
    )


@pytest.mark.slow(reason="one second")
@pytest.mark.parametrize(("share", "is_warned"), [(0.97, True), (0.5, False)])
def test_regression_columns_near_their_buckling_load_are_compared(share, is_warned):
    """The estimate was 0.8 %, and the deflection was off by 3.8 %."""
    mech = bd.Mechanism()
    steel = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
    section = bd.Section.rectangle(steel, width=0.03, height=0.007, damping=1e-3)
    rod = mech.add(bd.Beam("rod", bd.Line((0.0, 0.0), (0.22, 0.0)), section, elements=4))
    mech.add(bd.Revolute("foot", mech.ground.at(0.0, 0.0), rod.start))
    mech.add(bd.PointOnLine("guide", mech.ground.at(0.22, 0.0), rod.end, (1.0, 0.0)))
    mech.add(bd.Force("side", rod.at(0.11), (0.0, 1.0)))
    load = share * np.pi**2 * section.EI / 0.22**2
    rise = bd.piecewise((0.5, lambda t: -load * (2.0 * t) ** 2 * (3.0 - 4.0 * t)), -load)
    mech.add(bd.Force("press", rod.end, (rise, 0.0)))
    mech.observe("middle", rod.at(0.11))
    mech.observe("moment", rod.section_forces(0.11))
    run = bd.simulate(mech, t_end=0.6)
    errors = [x for x in run.warnings if "with exact strains, " in x]
    assert len(errors) == is_warned
    assert all("middle.y" in x for x in errors)
    assert run.validity[0].error < 0.01
