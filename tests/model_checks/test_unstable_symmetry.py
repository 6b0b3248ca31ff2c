"""Warnings about runs that stay on an unstable path because nothing disturbs their symmetry."""

from functools import partial

import numpy as np
import pytest

import beamdae as bd

STRIP = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.002, damping=2e-4)
LENGTH = 0.5  # m
BUCKLING_LOAD = np.pi**2 * STRIP.EI / (4.0 * LENGTH**2)  # N, of a cantilever (Euler)
SENTENCE = "stays on an unstable path"


def column(load, side_load=0.0, **beam):
    """Return a cantilever that is compressed by a force, a number or a function of time."""
    mech = bd.Mechanism()
    rod = mech.add(bd.Beam("rod", bd.Line((0, 0), (LENGTH, 0)), STRIP, elements=2, **beam))
    mech.add(bd.Weld("clamp", mech.ground.at(0, 0), rod.start))
    mech.add(bd.Force("press", rod.end, (load, side_load)))
    mech.observe("tip", rod.end)
    return mech


def pinned_arch(load, formulation="exact"):
    """Return a pinned arch with a load at its crown that branches before its limit point."""
    radius, half = 0.3625, np.arcsin(0.25 / 0.3625)
    curve = bd.Arc(radius, 2.0 * half * radius, start=(0.25, 0.0), angle=np.pi - half)
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.002, damping=2e-3)
    mech = bd.Mechanism()
    arch = mech.add(bd.Beam("arch", curve, section, elements=8, formulation=formulation))
    for name, end in (("right", arch.start), ("left", arch.end)):
        mech.add(bd.Revolute(name, mech.ground.at(*end.point), end))
    mech.add(bd.Force("press", arch.at(0.5 * arch.length), (0.0, load)))
    mech.observe("crown", arch.at(0.5 * arch.length))
    return mech


def is_named(run):
    return any(SENTENCE in x for x in run.warnings)


@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
@pytest.mark.parametrize(("ratio", "expected"), [(0.9, False), (1.5, True), (20.0, True)])
def test_a_straight_column_above_its_buckling_load_is_named(formulation, ratio, expected):
    run = bd.simulate(column(-ratio * BUCKLING_LOAD, formulation=formulation), t_end=2.0)
    assert run.status.success
    assert np.ptp(run["tip.y"]) == 0.0
    assert is_named(run) is expected


@pytest.mark.slow(reason="half a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_a_column_that_buckles_is_not_named():
    load = -1.5 * BUCKLING_LOAD
    run = bd.simulate(column(load, 1e-3 * load, formulation="exact"), t_end=0.5)
    assert np.ptp(run["tip.y"]) > 0.1 * LENGTH
    assert not is_named(run)


@pytest.mark.slow(reason="half a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_a_load_that_vibrates_below_the_buckling_load_is_not_named():
    # The force exceeds the buckling load at times, but a column of this period does not follow.
    run = bd.simulate(
        column(lambda t: -BUCKLING_LOAD * (0.6 + 0.8 * np.sin(600.0 * t)), formulation="exact"),
        t_end=0.3,
    )
    assert not is_named(run)


@pytest.mark.slow(reason="one second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_a_load_that_increases_beyond_the_branch_point_is_named():
    # The path branches at 336 N, before its limit point at 389 N (`bd.equilibrium`).
    def at(load):
        return bd.simulate(pinned_arch(lambda t: -load * t / 0.5), t_end=0.5)

    assert not is_named(at(320.0))
    assert is_named(at(380.0))


@pytest.mark.slow(reason="a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_a_bar_that_vibrates_in_flight_is_not_named():
    # Its rotation grows linearly with time, because the forces of the vibration turn with it.
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.005)
    mech = bd.Mechanism()
    line = bd.Line((0, 0), (LENGTH, 0))
    bar = mech.add(bd.Beam("bar", line, section, elements=1, formulation="exact"))
    for end, sign in ((bar.start, 1.0), (bar.end, -1.0)):
        mech.add(bd.PointMass(f"mass at {end}", 0.1, on=end))
        blow = partial(lambda sign, t: sign * 2e4 * np.exp(-t / 1e-4), sign)
        mech.add(bd.Force(f"blow at {end}", end, (blow, 0.0)))
    mech.observe("left", bar.start)
    assert not is_named(bd.simulate(mech, t_end=0.01))


def add_turning_beam(mech):
    rotor = mech.add(bd.Beam("rotor", bd.Line((1, 0), (1.2, 0)), STRIP, elements=1))
    mech.add(bd.Revolute("axle", mech.ground.at(1, 0), rotor.start))
    mech.add(bd.Driver("motor", mech.ground.at(1, 0), rotor.start, lambda t: t))


def add_record_of_work(mech):
    speed = mech.sensor("speed", mech.part("rod").end, "x_dot")
    mech.state("path", speed, unit="m")


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize("add", [add_turning_beam, add_record_of_work])
def test_regression_states_and_turning_beams_beside_a_column_do_not_hide_it(add):
    """A run above the buckling load was silent if anything else in it turned or was integrated."""
    for ratio, expected in ((0.9, False), (1.5, True)):
        mech = column(-ratio * BUCKLING_LOAD)
        add(mech)
        assert is_named(bd.simulate(mech, t_end=1.0)) is expected


@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
def test_columns_that_filtered_feedback_may_hold_are_not_named():
    mech = column(-1.5 * BUCKLING_LOAD)
    tip = mech.part("rod").end
    filtered = bd.low_pass(mech, "filtered", mech.sensor("position", tip, "y"), 1e-3, scale=1.0)
    mech.add(bd.Force("hold", tip, (0.0, -1e5 * filtered)))
    assert not is_named(bd.simulate(mech, t_end=1.0))
