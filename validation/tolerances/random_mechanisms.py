"""Random mechanisms: chains of one to three beams and bars, sampled from a seed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import beamdae as bd
from tolerances.mechanisms import ALLOY, GRAVITY, PAPER, STEEL

# Largest static deflection over length, of a level cantilever under its weight and of a beam under
# the load: the strains are valid for moderate deflections.
MAX_BENDING = 0.1
GRAVITATIONAL_ACCELERATION = -GRAVITY[1]  # [m/s^2]


@dataclass(frozen=True)
class BodyParameters:
    """Sampled parameters of one body; `bend` is the subtended angle of its axis [rad]."""

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
        """Cross-section, also of rigid bars."""
        return bd.Section.rectangle(self.material, self.width, self.height, self.damping)

    @property
    def mass(self) -> float:
        """Mass of the body and its tip mass [kg]."""
        return self.section.rhoA * self.length + self.tip_mass


def sample_body(rng: np.random.Generator, rigid: bool, height: float) -> BodyParameters:
    """Sample a bar or beam of about the given height, up to 1 m long as its stiffness allows."""
    material = (STEEL, ALLOY)[rng.integers(2)]
    height = float(np.clip(height * 10.0 ** rng.uniform(-0.3, 0.3), 5e-4, 2e-2))
    stiffness = material.E * height**2 / (1.5 * material.rho * GRAVITATIONAL_ACCELERATION)
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
    has_tip_mass = rng.random() < 0.4
    return replace(body, tip_mass=has_tip_mass * rng.uniform(0.1, 2.0) * body.mass)


def sample_law(rng: np.random.Generator, size: float, t_end: float) -> Any:
    """Sample a constant, a sine or a step of the given size."""
    kind = rng.integers(3)
    if kind == 0:
        return size
    if kind == 1:
        return bd.sine(size, 10.0 ** rng.uniform(-0.3, 1.0))
    return bd.piecewise((rng.uniform(0.1, 0.7) * t_end, 0.0), size)


@dataclass(frozen=True)
class MechanismParameters:
    """Sampled parameters of a mechanism; `rng` continues with those of its load."""

    rng: np.random.Generator
    bodies: tuple[BodyParameters, ...]
    clamped: bool
    closed: bool
    gravity: bool
    t_end: float

    @property
    def is_damped(self) -> bool:
        """True if every beam is damped."""
        return all(body.rigid or body.damping > 0.0 for body in self.bodies)


def sample_mechanism(seed: int) -> MechanismParameters:
    """Sample the bodies of the mechanism of a seed; at least one of them is a beam."""
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
    """Add a body and return its two ends."""
    if not body.rigid:
        if body.bend:
            axis = bd.Arc(body.length / body.bend, body.length, start, angle)
        else:
            span = body.length * np.array([np.cos(angle), np.sin(angle)])
            axis = bd.Line(start, tuple((np.array(start) + span).tolist()))
        beam = mech.add(bd.Beam(name, axis, body.section, elements=2, **PAPER))
        return beam.start, beam.end
    span = body.length * np.array([np.cos(angle), np.sin(angle)])
    end, center = (tuple((np.array(start) + k * span).tolist()) for k in (1.0, 0.5))
    mass = body.section.rhoA * body.length
    bar = mech.add(bd.RigidBody(name, mass, mass * body.length**2 / 12.0, center))
    return bar.at(*start), bar.at(*end)


@bd.model(t_end=1.0)
def random_mechanism(seed=0):
    """Chain hinged or clamped to the ground, open or closed to a loop.

    A closed chain of three bodies is a four-bar, of two bodies a slider-crank. A load acts on the
    end of one body, limited by five times the weight and by bending the weakest beam by a tenth.
    """
    parameters = sample_mechanism(seed)
    rng = parameters.rng
    mech = bd.Mechanism(gravity=GRAVITY if parameters.gravity else (0.0, 0.0))
    previous_end, angle, ends = mech.ground.at(0.0, 0.0), rng.uniform(-np.pi, np.pi), []
    for k, body in enumerate(parameters.bodies):
        start, end = _add(mech, f"body {k}", body, previous_end.point, angle)
        joint = bd.Weld if k == 0 and parameters.clamped else bd.Revolute
        mech.add(joint(f"joint {k}", previous_end, start))
        if body.tip_mass:
            mech.add(bd.PointMass(f"mass {k}", body.tip_mass, on=end))
        previous_end, angle = end, angle + body.bend + body.turn
        ends.append(end)
    if parameters.closed:
        ground, ends = mech.ground.at(*previous_end.point), ends[:-1]
        if len(parameters.bodies) == 3:
            mech.add(bd.Revolute("closing", ground, previous_end))
        else:
            direction = (np.cos(angle), np.sin(angle))
            mech.add(bd.PointOnLine("guide", ground, previous_end, direction=direction))
    if not parameters.gravity or rng.random() < 0.6:
        mech.add(bd.Force("load", on=ends[rng.integers(len(ends))], law=_sample_load(parameters)))
    mech.observe("end", ends[-1])
    return mech


def _sample_load(parameters: MechanismParameters) -> tuple[Any, Any]:
    rng = parameters.rng
    beams = [body for body in parameters.bodies if not body.rigid]
    bending = min(3.0 * MAX_BENDING * b.section.EI / b.length**2 for b in beams)
    weight = GRAVITATIONAL_ACCELERATION * sum(body.mass for body in parameters.bodies)
    size = min(bending, 5.0 * weight) * 10.0 ** rng.uniform(-2.0, 0.0)
    direction = rng.uniform(-np.pi, np.pi)
    return tuple(
        sample_law(np.random.default_rng(rng.integers(2**32)), size * part, parameters.t_end)
        for part in (np.cos(direction), np.sin(direction))
    )
