"""Warnings about bodies that rest, or only fall, because no joint, driver or force acts."""

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


def add_drag(mech: bd.Mechanism, arm: Any) -> None:
    mech.add(bd.ForceLaw("air", arm.end, lambda p, t: (-p.velocity[0], -p.velocity[1])))


def add_head(mech: bd.Mechanism, arm: Any) -> None:
    head = mech.add(bd.RigidBody("head", mass=0.1, inertia=1e-4, center=(0.5, 0.0)))
    mech.add(bd.Weld("head weld", arm.end, head.at(0.5, 0.0)))


def add_weld(mech: bd.Mechanism, arm: Any) -> None:
    mech.add(bd.Weld("clamp", mech.part("disk").at(0.0, 0.0), arm.start))


def add_soft_spring(mech: bd.Mechanism, arm: Any) -> None:
    mech.add(bd.Spring("spring", mech.ground.at(-1.0, 0.0), arm.start, 1e-3, free_length=1.0))


def add_late_force(mech: bd.Mechanism, arm: Any) -> None:
    mech.add(bd.Force("kick", arm.end, (bd.piecewise((0.4, 0.0), 1e-3), 0.0)))


def add_contact(mech: bd.Mechanism, arm: Any) -> None:
    floor = bd.LineSurface(arm.start)
    mech.add(bd.Contact("floor", mech.ground.at(0.0, 0.2), floor, 1e3))


def add_event(mech: bd.Mechanism, arm: Any) -> None:
    mech.observe("disk", mech.part("disk").at(0.0, 0.0))
    mech.when("disk.angle", 0.1)


ARMS = {
    "alone": (None, "arm"),
    "with a head": (add_head, "arm, head"),
    "welded": (add_weld, ""),
    "in air": (add_drag, ""),
    "on a soft spring": (add_soft_spring, ""),
    "pushed later": (add_late_force, ""),
    "waiting for a contact": (add_contact, ""),
    "stopped early": (add_event, ""),
}


def find_idle(mech: bd.Mechanism) -> list[str]:
    run = bd.simulate(mech, bd.Radau(1e-4), t_end=0.5, output_step=0.01)
    return [x for x in run.warnings if "and no force but weight moves" in x]


@pytest.mark.slow(reason="a quarter of a second")
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
@pytest.mark.parametrize(("add", "names"), ARMS.values(), ids=ARMS.keys())
def test_arms_without_a_clamp_have_a_warning(add: Any, names: str, formulation: str) -> None:
    mech = driven_disk(formulation=formulation)
    if add is not None:
        add(mech, mech.part("arm"))
    found = find_idle(mech)
    assert [x.partition(":")[0] for x in found] == ([names] if names else [])


def test_the_warning_names_a_remedy() -> None:
    (sentence,) = find_idle(driven_disk())
    assert sentence == (
        "arm: no joint holds it and no force but weight moves it; add a joint, observe it, or "
        "remove it."
    )


def pendulum_and_plate(add: str = "", **plate: Any) -> bd.Mechanism:
    """Return a pendulum beside a plate that was meant to be welded to it."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    rod = mech.add(bd.RigidBody.rod("rod", (0.0, 0.0), (0.3, 0.0), mass=1.0))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0)))
    point = mech.add(bd.RigidBody("plate", 0.2, 1e-3, (0.3, 0.0), **plate)).at(0.3, 0.0)
    mech.observe("rod", rod.at(0.3, 0.0))
    if add == "weld":
        mech.add(bd.Weld("weld", rod.at(0.3, 0.0), point))
    elif add == "observe":
        mech.observe("plate", point)
    elif add == "force":
        mech.add(bd.Force("thrust", point, (0.0, 2.0)))
    return mech


BODIES = {
    "plate": (pendulum_and_plate(), "plate"),
    "welded plate": (pendulum_and_plate("weld"), ""),
    "thrown plate": (pendulum_and_plate(velocity=(1.0, 0.0)), ""),
    "observed plate": (pendulum_and_plate("observe"), ""),
    "lifted plate": (pendulum_and_plate("force"), ""),
}


@pytest.mark.slow(reason="a fifth of a second")
@pytest.mark.parametrize(("mech", "name"), BODIES.values(), ids=BODIES.keys())
def test_bodies_that_only_fall_have_a_warning(mech: bd.Mechanism, name: str) -> None:
    found = find_idle(mech)
    assert [x.partition(":")[0] for x in found] == ([name] if name else [])
