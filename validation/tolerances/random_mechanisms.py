"""Random mechanisms: chains of one to three beams and bars, drawn by a seed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import beamdae as bd
from tolerances.mechanisms import ALLOY, GRAVITY, PAPER, STEEL

# No beam sags by more than this share of its length under its weight, clamped and level, nor bends
# further under the load, at rest: the strains hold for moderate deflections.
MAX_BENDING = 0.1


@dataclass(frozen=True)
class BodyParameters:
    """What is drawn of one body: `bend` is the angle its axis turns by, straight if zero."""

    rigid: bool
    material: bd.Material
    width: float
    height: float
    length: float
    bend: float
    damping: float
    turn: float
    tip_mass: float

    @property
    def section(self) -> bd.Section:
        """The cross-section, of rigid bars as well."""
        return bd.Section.rectangle(self.material, self.width, self.height, self.damping)

    @property
    def mass(self) -> float:
        """Mass of the body and what sits on its end [kg]."""
        return self.section.rhoA * self.length + self.tip_mass


def sample_body(rng: np.random.Generator, rigid: bool, height: float) -> BodyParameters:
    """A bar or beam of about this height, as long as its stiffness allows, up to 1 m."""
    material = (STEEL, ALLOY)[rng.integers(2)]
    height = float(np.clip(height * 10.0 ** rng.uniform(-0.3, 0.3), 5e-4, 2e-2))
    stiffness = material.E * height**2 / (1.5 * material.rho * 9.81)
    length = rng.uniform(0.3, 1.0) * min((MAX_BENDING * stiffness) ** (1.0 / 3.0), 1.0)
    bend = rng.choice([0.0, rng.uniform(0.2, 1.2), -rng.uniform(0.2, 1.2)])
    light, heavy = 10.0 ** rng.uniform(-6.0, -5.0), 10.0 ** rng.uniform(-4.0, -3.0)
    damping = rng.choice([0.0, light, heavy])
    body = BodyParameters(
        rigid=rigid,
        material=material,
        width=rng.uniform(0.01, 0.04),
        height=height,
        length=length,
        bend=0.0 if rigid else float(bend),
        damping=0.0 if rigid else float(damping),
        turn=rng.uniform(-1.5, 1.5),
        tip_mass=0.0,
    )
    loaded = rng.random() < 0.4
    return replace(body, tip_mass=loaded * rng.uniform(0.1, 2.0) * body.mass)


def sample_law(rng: np.random.Generator, size: float, t_end: float) -> Any:
    """A constant, a sine or a step of this size."""
    kind = rng.integers(3)
    if kind == 0:
        return size
    if kind == 1:
        return bd.sine(size, 10.0 ** rng.uniform(-0.3, 1.0))
    return bd.piecewise((rng.uniform(0.1, 0.7) * t_end, 0.0), size)


@dataclass(frozen=True)
class MechanismParameters:
    """Everything that is drawn of a mechanism but its load, which `rng` goes on to draw."""

    rng: np.random.Generator
    bodies: tuple[BodyParameters, ...]
    clamped: bool
    closed: bool
    gravity: bool
    t_end: float

    @property
    def damped(self) -> bool:
        """Whether every beam is damped."""
        return all(body.rigid or body.damping > 0.0 for body in self.bodies)


def sample_mechanism(seed: int) -> MechanismParameters:
    """Draw the bodies of the mechanism of a seed; at least one of them is a beam."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 4))
    flexible = rng.integers(count)
    rigid = [k != flexible and rng.random() < 0.3 for k in range(count)]
    height = 10.0 ** rng.uniform(np.log10(5e-4), np.log10(2e-2))
    bodies = tuple(sample_body(rng, r, height) for r in rigid)
    return MechanismParameters(
        rng=rng,
        bodies=bodies,
        clamped=rng.random() < 0.25,
        closed=count > 1 and rng.random() < 0.4,
        gravity=rng.random() < 0.7,
        t_end=float(np.round(rng.uniform(0.4, 1.2), 2)),
    )


def _add(mech: bd.Mechanism, name: str, body: BodyParameters, start, angle: float):
    """Add a body; its two ends."""
    if not body.rigid:
        if body.bend:
            axis = bd.Arc(body.length / body.bend, body.length, start, angle)
        else:
            reach = body.length * np.array([np.cos(angle), np.sin(angle)])
            axis = bd.Line(start, tuple((np.array(start) + reach).tolist()))
        beam = mech.add(bd.Beam(name, axis, body.section, elements=2, **PAPER))
        return beam.start, beam.end
    reach = body.length * np.array([np.cos(angle), np.sin(angle)])
    end, center = (tuple((np.array(start) + k * reach).tolist()) for k in (1.0, 0.5))
    mass = body.section.rhoA * body.length
    bar = mech.add(bd.RigidBody(name, mass, mass * body.length**2 / 12.0, center))
    return bar.at(*start), bar.at(*end)


@bd.model(t_end=1.0)
def random_mechanism(seed=0):
    """Chain from the ground, hinged or clamped there; its end free, or held to close the loop.

    Three bodies close to a four-bar, two by a guide to a slider-crank. Loads act on the end of one
    of the bodies, up to five times the weight and to what bends the weakest beam by a tenth.
    """
    plan = sample_mechanism(seed)
    rng = plan.rng
    mech = bd.Mechanism(gravity=GRAVITY if plan.gravity else (0.0, 0.0))
    held, angle, ends = mech.ground.at(0.0, 0.0), rng.uniform(-np.pi, np.pi), []
    for k, body in enumerate(plan.bodies):
        start, end = _add(mech, f"body {k}", body, held.point, angle)
        joint = bd.Weld if k == 0 and plan.clamped else bd.Revolute
        mech.add(joint(f"joint {k}", held, start))
        if body.tip_mass:
            mech.add(bd.PointMass(f"mass {k}", body.tip_mass, on=end))
        held, angle = end, angle + body.bend + body.turn
        ends.append(end)
    if plan.closed:
        ground, ends = mech.ground.at(*held.point), ends[:-1]
        if len(plan.bodies) == 3:
            mech.add(bd.Revolute("closing", ground, held))
        else:
            direction = (np.cos(angle), np.sin(angle))
            mech.add(bd.PointOnLine("guide", ground, held, direction=direction))
    if not plan.gravity or rng.random() < 0.6:
        mech.add(bd.Force("load", on=ends[rng.integers(len(ends))], law=_load(plan)))
    mech.observe("end", ends[-1])
    return mech


def _load(plan: MechanismParameters) -> tuple[Any, Any]:
    rng = plan.rng
    beams = [body for body in plan.bodies if not body.rigid]
    bending = min(3.0 * MAX_BENDING * b.section.EI / b.length**2 for b in beams)
    weight = 9.81 * sum(body.mass for body in plan.bodies)
    size = min(bending, 5.0 * weight) * 10.0 ** rng.uniform(-2.0, 0.0)
    direction = rng.uniform(-np.pi, np.pi)
    return tuple(
        sample_law(np.random.default_rng(rng.integers(2**32)), size * part, plan.t_end)
        for part in (np.cos(direction), np.sin(direction))
    )
