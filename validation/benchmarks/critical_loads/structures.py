"""Mechanisms of the critical load cases: steel strips of length L = 1 m at any slenderness."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import beamdae as bd
from benchmarks.critical_loads.frame_stability import BeamStiffness, FrameDescription

LENGTH = 1.0  # [m]
WIDTH = 0.02  # [m]
STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)
FORMULATIONS: dict[str, dict[str, Any]] = {
    "exact": {"formulation": "exact"},
    "floating frame": {},
    "floating frame, Green's strain": {"strain": "green"},
}
# Joint that fixes displacements along x and y and rotations r.
SUPPORTS: dict[str, tuple[Any, ...]] = {
    "xyr": (bd.Weld,),
    "xy": (bd.Revolute,),
    "x": (bd.PointOnLine, (0.0, 1.0)),
    "y": (bd.PointOnLine, (1.0, 0.0)),
    "xr": (bd.Prismatic, (0.0, 1.0)),
    "yr": (bd.Prismatic, (1.0, 0.0)),
}


def strip(slenderness: float, width: float = 1.0, damping: float = 0.0) -> bd.Section:
    """Return the rectangular section of height L / `slenderness`; `width` is relative."""
    height = LENGTH / slenderness
    return bd.Section.rectangle(STEEL, width=WIDTH * width, height=height, damping=damping)


def stiffness(slenderness: float, strain: str = "exact") -> BeamStiffness:
    """Return the stiffness of the section over EI / L^2."""
    section = strip(slenderness)
    unit = section.EI / LENGTH**2
    return BeamStiffness(section.EA / unit, section.GA / unit, strain)


def build_frame(
    frame: FrameDescription, slenderness: float, elements: int, settings: Mapping[str, Any]
) -> bd.Mechanism:
    """Return the frame under its loads times EI / L^2, with `elements` elements per member."""
    mech = bd.Mechanism()
    unit = strip(slenderness).EI / LENGTH**2
    joints: dict[str, bd.results.Attachment] = {}
    for k, member in enumerate(frame.members):
        a, b = (tuple(LENGTH * x for x in frame.nodes[node]) for node in (member.a, member.b))
        section = strip(slenderness, member.width)
        name = f"{member.a}-{member.b}"
        beam = mech.add(bd.Beam(name, bd.Line(a, b), section, elements, **settings))
        for end, node, attachment in (("a", member.a, beam.start), ("b", member.b, beam.end)):
            if node not in joints:
                joints[node] = attachment
                if end in member.hinges:
                    raise ValueError(f"{node}: the first member at a node cannot be hinged")
                continue
            joint = bd.Revolute if end in member.hinges else bd.Weld
            mech.add(joint(f"joint {node} {k}", joints[node], attachment))
    for node, axes in frame.supports.items():
        ground = mech.ground.at(*joints[node].point)
        kind, *direction = SUPPORTS[axes]
        mech.add(kind(f"support {node}", ground, joints[node], *direction))
    for node, (kx, ky, kr) in frame.springs.items():
        ground = mech.ground.at(*joints[node].point)
        stiffnesses = {"kx": kx * unit / LENGTH, "ky": ky * unit / LENGTH}
        mech.add(
            bd.Bushing(
                f"spring {node}", ground, joints[node], **stiffnesses, ktheta=kr * unit * LENGTH
            )
        )
    for node, (fx, fy) in frame.loads.items():
        mech.add(bd.Force(f"load {node}", joints[node], (fx * unit, fy * unit)))
    return mech
