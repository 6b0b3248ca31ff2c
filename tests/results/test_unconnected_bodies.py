"""Warnings about bodies without joints that rest because no force acts on them."""

from __future__ import annotations

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
