"""Warnings about peaks after impacts that change with the elements of beams."""

import re

import numpy as np
import pytest

import beamdae as bd
from beamdae import verification

ALUMINUM = bd.Material(E=70e9, nu=0.33, rho=2700.0)
LENGTH, HEIGHT = 0.12, 2e-3


def dropped_board(elements, stiffness=1e6, height=1e-7):
    """Return a box that falls onto a floor, with a cantilever board."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    velocity = (0.0, -2.0)
    box = mech.add(bd.RigidBody("box", 0.05, 1e-5, center=(0.0, 0.0), velocity=velocity))
    section = bd.Section.rectangle(ALUMINUM, width=0.02, height=HEIGHT, damping=1e-5)
    line = bd.Line((0.0, 0.0), (LENGTH, 0.0))
    board = mech.add(bd.Beam("board", line, section, elements=elements, velocity=velocity))
    mech.add(bd.Weld("clamp", box.at(0.0, 0.0), board.start))
    guide = mech.ground.at(0.0, 0.0), box.at(0.0, 0.0)
    mech.add(bd.Prismatic("guide", *guide, direction=(0.0, 1.0)))
    floor = bd.LineSurface(mech.ground.at(0.0, -height), direction=(1.0, 0.0))
    mech.add(
        bd.Contact("floor", box.at(0.0, 0.0), floor, stiffness, restitution=0.5, impact_speed=2.0)
    )
    mech.observe("root", board.strain(0.0, 0.5 * HEIGHT))
    return mech


def peak(run, first=0.0, last=1.0):
    t = np.linspace(first, last, 4001) * run.trajectory.end
    return np.max(np.abs(run.at_times(t)["root [-]"]))


def find_sentences(run):
    return [x for x in run.warnings if "for this impact" in x]


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_regression_peaks_of_single_elements_after_impacts_have_their_error():
    """Peaks were off by 6 % without a word, or with a quarter of it."""
    coarse, fine = (bd.simulate(dropped_board(n), t_end=0.004) for n in (1, 12))
    (sentence,) = find_sentences(coarse)
    change = re.search(r"board: 1 element is too few .* a change of ([\d.]+) %", sentence)
    assert change is not None
    error = 100.0 * abs(peak(coarse) / peak(fine) - 1.0)
    assert error > 5.0
    assert float(change[1]) == pytest.approx(error, rel=0.2)
    assert sentence.endswith("; use elements=2.")


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_regression_later_peaks_that_a_larger_one_hides_are_named():
    """The largest strain was right, and a later peak was off by 40 % without a word."""
    coarse, fine = (bd.simulate(dropped_board(n, 1e8), t_end=0.004) for n in (1, 12))
    (sentence,) = find_sentences(coarse)
    assert abs(peak(coarse) / peak(fine) - 1.0) < 0.01
    assert "the peak of root between t = " in sentence
    change = re.search(r"between t = (\S+) and (\S+) s changes by ([\d.]+) %", sentence)
    assert change is not None
    first, last = (float(change[k]) / 0.004 for k in (1, 2))
    error = abs(peak(coarse, first, last) / peak(fine, first, last) - 1.0)
    assert error > 0.25
    assert float(change[3]) == pytest.approx(100.0 * error, rel=0.5)


@pytest.mark.slow(reason="a fifth of a second")
def test_peaks_of_enough_elements_have_no_warning():
    assert not find_sentences(bd.simulate(dropped_board(3), t_end=0.002))


# A filter that matches no message, so that runs are checked although all warnings are ignored.
@pytest.mark.filterwarnings("always:(?!):beamdae.errors.BeamdaeWarning")
def test_runs_without_an_impact_are_not_repeated(monkeypatch):
    def fail(*_):
        raise AssertionError("the run is repeated")

    monkeypatch.setattr(verification, "run_again", fail)
    bd.simulate(dropped_board(3, height=0.1), t_end=0.002)
    with pytest.raises(AssertionError):
        bd.simulate(dropped_board(3), t_end=0.002)
