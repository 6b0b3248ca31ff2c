"""Mechanisms for timing: two systems for comparison with Exudyn, and systems of any size."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2] / "models"))

import numpy as np
from hub_beam import hub_beam

import beamdae as bd


def exact_hub_beam(
    bodies: int, elements: int, damping: float, formulation: str = "floating frame"
) -> bd.Mechanism:
    """Return the hub beam whose limit, with many bodies or elements, is the exact beam."""
    if formulation == "exact":
        return hub_beam(elements=elements, bodies=bodies, damping=damping, formulation=formulation)
    return hub_beam(
        elements=elements, bodies=bodies, frame="chord", strain="green", damping=damping
    )


def exact_pendulum(
    bodies: int, elements: int, damping: float, formulation: str = "floating frame"
) -> bd.Mechanism:
    """Return the pendulum whose limit, with many bodies or elements, is the exact beam."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    arc = bd.Arc(radius=0.85, length=0.80, start=(0.0, 0.0), angle=-0.60)
    kind: dict[str, Any] = {"elements": elements, "formulation": formulation}
    beams = bd.welded_beams(mech, "beam", arc, pendulum_section(damping), bodies, **kind)
    mech.add(bd.PointMass("tip mass", 0.060, on=beams[-1].end))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beams[0].start))
    mech.observe("tip", beams[-1].end)
    return mech


def pendulum_section(damping: float) -> bd.Section:
    """Return the section of the pendulum."""
    alloy = bd.Material(E=68.95e9, nu=0.3, rho=2760.0)
    return bd.Section.rectangle(alloy, width=0.03, height=0.0025, damping=damping)


def beam(elements: int) -> bd.Mechanism:
    """Return the hub beam with one floating frame."""
    return exact_hub_beam(1, elements, 0.0)


def exact(elements: int) -> bd.Mechanism:
    """Return the hub beam without a floating frame."""
    return hub_beam(elements=elements, formulation="exact")


def chain(beams: int) -> bd.Mechanism:
    """Return a hanging chain of straight beams of 4 elements with hinges."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    before = mech.ground.at(0.0, 0.0)
    for k in range(beams):
        line = bd.Line((0.4 * k, 0.0), (0.4 * (k + 1), 0.0))
        link = mech.add(bd.Beam(f"link {k}", line, pendulum_section(1e-4), elements=4))
        mech.add(bd.Revolute(f"hinge {k}", before, link.start))
        before = link.end
    return mech


def ring(beams: int) -> bd.Mechanism:
    """Return a closed ring of curved beams with hinges, one of them to the ground."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    length = 0.4
    radius, turn = beams * length / (2.0 * np.pi), 2.0 * np.pi / beams
    links = []
    for k in range(beams):
        angle = k * turn
        start = (radius * np.sin(angle), radius * (1.0 - np.cos(angle)))
        arc = bd.Arc(radius=radius, length=length, start=start, angle=angle)
        links.append(mech.add(bd.Beam(f"link {k}", arc, pendulum_section(1e-4), elements=4)))
    mech.add(bd.Revolute("support", mech.ground.at(0.0, 0.0), links[0].start))
    for k, link in enumerate(links):
        mech.add(bd.Revolute(f"hinge {k}", links[k - 1].end, link.start))
    return mech
