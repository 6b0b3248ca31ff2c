"""Warnings about bodies that rest, or only fall, because no joint, driver or force acts."""

from __future__ import annotations

import math
from typing import Any

import pytest

import beamdae as bd


def driven_disk(**arm: Any) -> bd.Mechanism:
    """Return a driven disk beside a beam that was meant to be clamped to it."""
    mech = bd.Mechanism()
    disk = mech.add(bd.RigidBody.disk("disk", (0.0, 0.0), 0.1, mass=1.0))
    pivot = mech.ground.at(0.0, 0.0), disk.at(0.0, 0.0)
    mech.add(bd.Revolute("pivot", *pivot))
    mech.add(bd.Driver("motor", *pivot, lambda t: t))
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.003)
    line = bd.Line((0.0, 0.0), (0.5, 0.0))
    mech.add(bd.Beam("arm", line, section, elements=1, **arm))
    return mech


def unconnected(mech: bd.Mechanism) -> list[str]:
    run = bd.simulate(mech, bd.Radau(1e-4), t_end=0.5, output_step=0.01)
    return [x for x in run.warnings if "no joint connects" in x]


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_regression_forgotten_clamps_have_a_warning(formulation: str) -> None:
    """A beam without its clamp, under friction that acts at speeds only, rested silently."""
    mech = driven_disk(formulation=formulation)
    arm = mech.part("arm")
    mech.add(bd.ForceLaw("air", arm.end, lambda p, t: (-p.velocity[0], -p.velocity[1])))
    (sentence,) = unconnected(mech)
    assert sentence == (
        "arm: no joint connects it to other parts and no force acts on it, so it rests during the "
        "whole run; add a joint or a force, or remove it."
    )
    head = mech.add(bd.RigidBody("head", mass=0.1, inertia=1e-4, center=(0.5, 0.0)))
    mech.add(bd.Weld("head weld", arm.end, head.at(0.5, 0.0)))
    (sentence,) = unconnected(mech)
    assert "no joint connects them to other parts" in sentence


def add_weld(mech: bd.Mechanism, arm: Any, disk: Any) -> None:
    mech.add(bd.Weld("clamp", disk.at(0.0, 0.0), arm.start))


def add_soft_spring(mech: bd.Mechanism, arm: Any, disk: Any) -> None:
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), arm.start, 1e-3, free_length=1.0))


def add_late_force(mech: bd.Mechanism, arm: Any, disk: Any) -> None:
    mech.add(bd.Force("kick", arm.end, (bd.piecewise((0.4, 0.0), 1e-3), 0.0)))


def add_contact(mech: bd.Mechanism, arm: Any, disk: Any) -> None:
    floor = bd.LineSurface(arm.start)
    mech.add(bd.Contact("floor", mech.ground.at(0.0, 0.2), floor, 1e3))


@pytest.mark.slow(reason="one second")
@pytest.mark.parametrize("add", [add_weld, add_soft_spring, add_late_force, add_contact])
def test_held_moved_and_waiting_bodies_have_no_warning(add: Any) -> None:
    mech = driven_disk()
    add(mech, mech.part("arm"), mech.part("disk"))
    assert unconnected(mech) == []


def test_runs_that_stop_early_have_no_warning() -> None:
    mech = driven_disk()
    mech.observe("disk", mech.part("disk").at(0.0, 0.0))
    mech.when("disk.angle", 0.1)
    assert unconnected(mech) == []


def pendulum_and_plate(**plate: Any) -> bd.Mechanism:
    """Return a pendulum beside a plate that was meant to be welded to it."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    rod = mech.add(bd.RigidBody.rod("rod", (0.0, 0.0), (0.3, 0.0), mass=1.0))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0)))
    mech.add(bd.RigidBody("plate", 0.2, 1e-3, (0.3, 0.0), **plate))
    mech.observe("rod", rod.at(0.3, 0.0))
    return mech


def falling(mech: bd.Mechanism) -> list[str]:
    return [x for x in bd.simulate(mech, t_end=0.1).warnings if "fall" in x]


def test_regression_bodies_that_only_fall_have_a_warning() -> None:
    """A plate without its weld fell beside a pendulum that was too light, without a word."""
    mech = pendulum_and_plate()
    with pytest.warns(bd.BeamdaeWarning):
        assert falling(mech) == [
            "plate: no joint and no force connects it to other parts, so it only falls, and no "
            "column depends on it; add a joint, observe it, or remove it."
        ]
    mech.add(bd.Weld("weld", mech.part("rod").at(0.3, 0.0), mech.part("plate").at(0.3, 0.0)))
    assert falling(mech) == []


def test_falls_that_are_intended_have_no_warning() -> None:
    assert falling(pendulum_and_plate(velocity=(1.0, 0.0))) == []
    observed, driven = pendulum_and_plate(), pendulum_and_plate()
    observed.observe("plate", observed.part("plate").at(0.3, 0.0))
    driven.add(bd.Force("thrust", driven.part("plate").at(0.3, 0.0), (0.0, 2.0)))
    assert falling(observed) == []
    assert falling(driven) == []


def guided_ram(angle: float = 0.0, gravity: float = -9.81, **start: Any) -> bd.Mechanism:
    """Return a driven crank beside a ram on a guide, which was meant to be driven."""
    mech = bd.Mechanism(gravity=(0.0, gravity))
    ram = mech.add(bd.RigidBody("ram", 2.0, 0.1, (0.5, 0.0), **start))
    direction = (math.cos(angle), math.sin(angle))
    mech.add(bd.Prismatic("guide", mech.ground.at(0.5, 0.0), ram.at(0.5, 0.0), direction))
    crank = mech.add(bd.RigidBody.rod("crank", (0.0, 0.0), (0.1, 0.0), mass=1.0))
    hinge = mech.ground.at(0.0, 0.0), crank.at(0.0, 0.0)
    mech.add(bd.Revolute("hinge", *hinge))
    mech.add(bd.Driver("motor", *hinge, lambda t: 3.0 * t))
    mech.observe("crank", crank.at(0.1, 0.0))
    return mech


def undriven(mech: bd.Mechanism) -> list[str]:
    run = bd.simulate(mech, bd.Radau(1e-4), t_end=0.5, output_step=0.01)
    return [x for x in run.warnings if "no driver and no force" in x]


def test_regression_rams_without_a_driver_have_a_warning() -> None:
    """A ram on a guide rested beside the crank that should drive it, without a word."""
    (sentence,) = undriven(guided_ram())
    assert sentence == (
        "ram: no driver and no force moves it, so it rests during the whole run; add a driver, a "
        "force, an initial velocity, or a joint with another body."
    )


@pytest.mark.slow(reason="half a second")
def test_rams_and_wheels_that_something_moves_or_may_move_have_no_warning() -> None:
    assert undriven(guided_ram(angle=0.5)) == []  # falls
    assert undriven(guided_ram(velocity=(0.1, 0.0))) == []
    late = guided_ram()
    late.add(bd.Force("late", late.part("ram").at(0.5, 0.0), (bd.piecewise((0.4, 0.0), 1.0), 0.0)))
    assert undriven(late) == []
    buffer = guided_ram()
    wall = bd.LineSurface(buffer.ground.at(1.0, 0.0), (0.0, 1.0))
    buffer.add(bd.Contact("buffer", buffer.part("ram").at(0.5, 0.0), wall, 1e6))
    assert undriven(buffer) == []
    locked = guided_ram()
    locked.add(bd.Weld("lock", locked.ground.at(0.5, 0.0), locked.part("ram").at(0.5, 0.0)))
    locked.redundant = "minimum norm"
    assert undriven(locked) == []
    # A pendulum that hangs at rest; without gravity, it is a wheel that nothing drives.
    for gravity, count in ((-9.81, 0), (0.0, 1)):
        mech = bd.Mechanism(gravity=(0.0, gravity))
        bar = mech.add(bd.RigidBody("bar", 1.0, 0.1, (0.0, -0.5)))
        mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bar.at(0.0, 0.0)))
        assert len(undriven(mech)) == count
