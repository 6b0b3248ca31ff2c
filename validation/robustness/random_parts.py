"""Random mechanisms from the whole catalog: a chain, ball or slider with one to three additions.

An addition is a contact, a force, a joint, a driven or rolling body, or an event, sampled from
`ADDITIONS`. All parts are sampled so that the mechanism can be assembled. To extend: add a function
to `ADDITIONS`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from tolerances.mechanisms import ALLOY, GRAVITY, PAPER, STEEL

import beamdae as bd

Rng = np.random.Generator
_RIGID_SHARE, _EXACT_SHARE = 0.6, 0.45  # of the bodies of a chain, and of their beams
_BASES = ("chain", "chain", "chain", "ball", "slider")
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


@dataclass
class Site:
    """Mechanism under construction, and the places at which parts can be added.

    Attributes
    ----------
    mech, rng
        The mechanism, and the random numbers for its parts.
    tip, at
        Free end of the base, and its position [m].
    size, mass, t_end
        Length [m] and mass [kg] of the base, and end time [s].
    body
        Body of the tip.
    hinge
        Joint of the base with the ground that can rub, if there is one.
    beams
        Beams of the base.
    names
        Names of the additions, with numbers.
    """

    mech: bd.Mechanism
    rng: Rng
    t_end: float
    tip: Any = None
    at: np.ndarray = field(default_factory=lambda: np.zeros(2))
    size: float = 1.0
    mass: float = 1.0
    body: Any = None
    hinge: Any = None
    beams: list[bd.Beam] = field(default_factory=list)
    prefix: str = ""

    @property
    def weight(self) -> float:
        """Weight of the base [N]."""
        return -GRAVITY[1] * self.mass

    def near(self, distance: float) -> tuple[float, float]:
        """Return a point at this distance from the tip, in a random direction."""
        angle = self.rng.uniform(-np.pi, np.pi)
        x, y = self.at + distance * np.array([np.cos(angle), np.sin(angle)])
        return float(x), float(y)

    def below(self, distance: float) -> tuple[float, float]:
        """Return a point at this distance from the tip, downward within 60 degrees."""
        angle = -0.5 * np.pi + self.rng.uniform(-1.0, 1.0)
        x, y = self.at + distance * np.array([np.cos(angle), np.sin(angle)])
        return float(x), float(y)

    def log(self, low: float, high: float) -> float:
        """Sample a number whose logarithm is uniformly distributed."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def name(self, text: str) -> str:
        """Return a name that is unique among all additions."""
        return f"{self.prefix} {text}"


def _contact_law(site: Site) -> dict[str, Any]:
    """Return arguments of a contact that the weight closes by 1e-5 to 1e-2 of the size."""
    exponent = float(site.rng.choice([1.0, 1.5, 1.5, 2.0]))
    law: dict[str, Any] = {
        "stiffness": site.weight / (site.log(1e-5, 1e-2) * site.size) ** exponent,
        "exponent": exponent,
    }
    if site.rng.random() < 0.6:
        law |= {"restitution": site.rng.uniform(0.3, 0.95), "impact_speed": site.log(0.5, 5.0)}
    if site.rng.random() < 0.5:
        law |= {"friction": site.rng.uniform(0.1, 0.6), "friction_speed": site.log(1e-3, 1e-1)}
    return law


def _add_contact(site: Site, surface: Any) -> None:
    contact = bd.Contact(site.name("contact"), site.tip, surface, **_contact_law(site))
    site.mech.observe(site.name("force"), site.mech.add(contact).force)


def floor(site: Site) -> None:
    """Line beside the tip, which lies on its left side."""
    foot = site.below(site.size * site.log(0.02, 0.6))
    x, y = site.at - np.array(foot)
    _add_contact(site, bd.LineSurface(site.mech.ground.at(*foot), direction=(y, -x)))


def peg(site: Site) -> None:
    """Small circle on the ground, which the tip may hit or pass."""
    radius = site.size * site.log(0.005, 0.3)
    center = site.below(radius + site.size * site.log(0.05, 0.8))
    _add_contact(site, bd.CircleSurface(site.mech.ground.at(*center), radius, "outside"))


def bowl(site: Site) -> None:
    """Circle around the tip."""
    radius = site.size * site.rng.uniform(0.3, 1.5)
    center = site.near(radius * site.rng.uniform(0.0, 0.95))
    _add_contact(site, bd.CircleSurface(site.mech.ground.at(*center), radius, "inside"))


def moving_peg(site: Site) -> None:
    """Circle on a ball that flies toward the tip."""
    radius = site.size * site.rng.uniform(0.02, 0.2)
    start = np.array(site.near(radius + site.size * site.rng.uniform(0.1, 0.8)))
    aim = site.at + 0.3 * radius * site.rng.uniform(-1.0, 1.0, 2) - start
    velocity = aim / (site.t_end * site.rng.uniform(0.1, 0.8))
    ball = site.mech.add(
        bd.RigidBody.disk(
            site.name("ball"),
            tuple(start.tolist()),
            radius,
            mass=site.mass * site.log(0.1, 1.0),
            velocity=tuple(velocity.tolist()),
        )
    )
    center = ball.at(*start.tolist())
    _add_contact(site, bd.CircleSurface(center, radius, "outside"))
    site.mech.observe(site.name("ball"), center)


def joint_friction(site: Site) -> None:
    """Friction in the joint of the base, with or without Stribeck effect."""
    if site.hinge is None:
        return damper(site)
    rng = site.rng
    law = {"radius": site.size * site.log(0.01, 0.1), "friction_speed": site.log(1e-4, 1e-1)}
    if rng.random() < 0.4:
        law |= {"static": rng.uniform(0.5, 0.8), "stribeck": site.log(1e-2, 1e-1)}
    rub = bd.Friction(site.name("friction"), site.hinge, rng.uniform(0.1, 0.5), **law)
    site.mech.observe(site.name("friction"), site.mech.add(rub).reaction)
    return None


def _stiffness(site: Site) -> float:
    return site.weight / site.size * site.log(1.0, 1e3)


def _damping(site: Site) -> float:
    return site.mass * site.log(0.01, 10.0)


def spring(site: Site) -> None:
    """Spring between the tip and the ground."""
    anchor = site.mech.ground.at(*site.near(site.size * site.rng.uniform(0.3, 1.0)))
    part = bd.Spring(site.name("spring"), anchor, site.tip, _stiffness(site))
    site.mech.observe(site.name("spring"), site.mech.add(part).force)


def damper(site: Site) -> None:
    """Damper between the tip and the ground."""
    anchor = site.mech.ground.at(*site.near(site.size * site.rng.uniform(0.3, 1.0)))
    site.mech.add(bd.Spring(site.name("damper"), anchor, site.tip, damping=_damping(site)))


def one_sided_spring(site: Site) -> None:
    """Cable: a spring law without force in compression."""
    stiffness, damping = _stiffness(site), _damping(site)
    slack = site.size * site.log(1e-3, 0.3)
    anchor = site.mech.ground.at(*site.near(site.size * site.rng.uniform(0.3, 1.0)))
    length = float(np.hypot(*(np.array(anchor.point) - site.at))) + slack

    def pull(length: Any, rate: Any) -> Any:
        stretch = bd.positive_part(length - free)
        return stiffness * stretch * (1.0 + damping / stiffness * bd.smooth_sign(rate, 1.0))

    free = length
    part = bd.Spring(site.name("cable"), anchor, site.tip, law=pull)
    site.mech.observe(site.name("cable"), site.mech.add(part).force)


def torsion_spring(site: Site) -> None:
    """Torsion spring on the body of the tip."""
    if site.body is None:
        return spring(site)
    stiffness = site.weight * site.size * site.log(0.1, 30.0)
    damping = site.mass * site.size**2 * site.log(1e-3, 1.0)
    ground = site.mech.ground.at(0.0, 0.0)
    site.mech.add(
        bd.TorsionSpring(site.name("torsion spring"), ground, site.tip, stiffness, damping)
    )
    return None


def bushing(site: Site) -> None:
    """Bushing between the tip and a rigid body."""
    block = _add_disk(site, tuple(site.at.tolist()), 0.1 * site.size)
    if site.body is None:
        return None
    kx, ky = _stiffness(site), _stiffness(site)
    law = {"ktheta": kx * (0.1 * site.size) ** 2, "cx": 0.1 * _damping(site)}
    anchor = block.at(*site.at.tolist())
    site.mech.add(bd.Bushing(site.name("bushing"), site.tip, anchor, kx, ky, **law))
    return None


def magnet(site: Site) -> None:
    """Magnet on the ground that attracts the tip."""
    distance = site.size * site.log(0.05, 0.5)
    pole = np.array(site.below(distance))
    soft = (0.3 * distance) ** 2
    strength = site.weight * distance**2 * site.log(0.3, 10.0)

    def pull(point: Any, t: Any) -> Any:
        away = pole - point.position
        return strength * away / (away @ away + soft) ** 1.5

    def potential(point: Any) -> Any:
        away = pole - point.position
        return -strength / np.sqrt(away @ away + soft)

    site.mech.add(bd.ForceLaw(site.name("magnet"), site.tip, pull, energy=potential))


def load(site: Site) -> None:
    """Force on the tip by a time law."""
    size = site.weight * site.log(0.1, 3.0)
    angle = site.rng.uniform(-np.pi, np.pi)
    law = (_time_law(site, size * np.cos(angle)), _time_law(site, size * np.sin(angle)))
    site.mech.add(bd.Force(site.name("load"), site.tip, law))


def _time_law(site: Site, size: float) -> Any:
    """Sample a constant, a sine, a step, a table or a run-up."""
    kind = site.rng.integers(3)
    if kind == 0:
        return sample_law(site.rng, size, site.t_end)
    times = np.sort(site.rng.uniform(0.0, site.t_end, 4))
    if kind == 1 or np.diff(times).min() < 1e-3 * site.t_end:
        return bd.piecewise((float(times[1]), lambda t: size * t), size * float(times[1]))
    return bd.table([0.0, *times.tolist()], [0.0, size, -size, 0.5 * size, size])


def _add_disk(site: Site, center: tuple[float, float], radius: float) -> bd.RigidBody:
    """Add a disk and observe its center."""
    mass = site.mass * site.log(0.1, 1.0)
    disk = site.mech.add(bd.RigidBody.disk(site.name("disk"), center, radius, mass))
    site.mech.observe(site.name("disk"), disk.at(*center))
    return disk


def gear(site: Site) -> None:
    """Two wheels, driven by a moment, and coupled with the body of the tip by a spring."""
    radius = 0.1 * site.size
    x, y = site.at + np.array([3.0 * site.size, 0.0])
    centers = ((x, y), (x + 3.0 * radius, y))
    wheels = [
        site.mech.add(bd.RigidBody.disk(site.name(f"wheel {k}"), c, r, site.mass * 0.3))
        for k, (c, r) in enumerate(zip(centers, (radius, 2.0 * radius), strict=True))
    ]
    for wheel, center in zip(wheels, centers, strict=True):
        site.mech.add(
            bd.Revolute(f"{wheel.name} bearing", site.mech.ground.at(*center), wheel.at(*center))
        )
        site.mech.observe(wheel.name, wheel.at(*center))
    ends = wheels[0].at(*centers[0]), wheels[1].at(*centers[1])
    site.mech.add(bd.Gear(site.name("gear"), *ends, ratio=-0.5))
    moment = site.weight * site.size * site.log(0.01, 0.3)
    site.mech.add(bd.Moment(site.name("moment"), ends[0], _time_law(site, moment)))
    if site.body is not None:
        stiffness = site.weight * site.size * site.log(0.1, 10.0)
        site.mech.add(bd.TorsionSpring(site.name("shaft"), ends[1], site.tip, stiffness))


def rack(site: Site) -> None:
    """Rack on a guide, moved by a pinion on the ground."""
    radius = 0.1 * site.size
    center = tuple((site.at + np.array([2.0 * site.size, 0.0])).tolist())
    foot = (center[0], center[1] - radius)
    pinion = site.mech.add(bd.RigidBody.disk(site.name("pinion"), center, radius, site.mass * 0.3))
    rod = site.mech.add(
        bd.RigidBody.plate(site.name("rack"), foot, site.size, 0.1 * radius, mass=site.mass * 0.5)
    )
    ground = site.mech.ground
    site.mech.add(bd.Revolute(site.name("bearing"), ground.at(*center), pinion.at(*center)))
    site.mech.add(bd.Prismatic(site.name("guide"), ground.at(*foot), rod.at(*foot)))
    ends = pinion.at(*center), rod.at(*foot)
    site.mech.add(bd.RackAndPinion(site.name("mesh"), *ends, radius=radius, direction=(1.0, 0.0)))
    site.mech.observe(site.name("rack"), rod.at(*foot))
    site.mech.add(bd.Spring(site.name("spring"), rod.at(*foot), site.tip, _stiffness(site)))


def rolling_disk(site: Site) -> None:
    """Disk that rolls on a sloping line or in a circle, tied to the tip by a spring."""
    radius = site.size * site.rng.uniform(0.05, 0.2)
    ground, rng = site.mech.ground, site.rng
    root = site.at + np.array([1.5 * site.size, -0.5 * site.size])
    angle = rng.uniform(-0.5, 0.5)
    if rng.random() < 0.5:
        normal = np.array([-np.sin(angle), np.cos(angle)])
        disk = _add_disk(site, tuple((root + radius * normal).tolist()), radius)
        arguments: dict[str, Any] = {"radius": radius, "direction": (normal[1], -normal[0])}
        joint: Any = bd.RollingOnLine
    else:
        outer = site.size
        arm = (outer - radius) * np.array([np.sin(angle), -np.cos(angle)])
        disk = _add_disk(site, tuple((root + arm).tolist()), radius)
        arguments, joint = {"radii": (outer, radius)}, bd.RollingOnCircle
    center = disk.at(*disk.center)
    site.mech.add(joint(site.name("rolling"), ground.at(*root.tolist()), center, **arguments))
    site.mech.add(bd.Spring(site.name("tie"), center, site.tip, _stiffness(site)))


def skate(site: Site) -> None:
    """Free plate with a blade, pulled by the tip."""
    center = tuple((site.at + np.array([0.5 * site.size, 0.3 * site.size])).tolist())
    disk = _add_disk(site, center, 0.1 * site.size)
    angle = site.rng.uniform(-np.pi, np.pi)
    direction = (float(np.cos(angle)), float(np.sin(angle)))
    site.mech.add(bd.Skate(site.name("blade"), disk.at(*center), direction=direction))
    offset = (center[0], center[1] + 0.05 * site.size)
    site.mech.add(bd.Spring(site.name("tie"), disk.at(*offset), site.tip, _stiffness(site)))


def slider_on_beam(site: Site) -> None:
    """Particle that slides along the first beam."""
    if not site.beams:
        return rolling_disk(site)
    beam = site.beams[0]
    place = beam.at(beam.length * site.rng.uniform(0.3, 0.7))
    ring = site.mech.add(
        bd.PointMass(site.name("ring"), site.mass * site.log(0.05, 0.5), at=place.point)
    )
    site.mech.add(bd.SlidingOnBeam(site.name("sliding"), ring.point, beam, ends="stop"))
    site.mech.observe(site.name("ring"), ring.point)
    return None


def driven_body(site: Site) -> None:
    """Crank turned by a driver, tied to the tip by a spring."""
    center = tuple((site.at + np.array([0.7 * site.size, 0.0])).tolist())
    disk = _add_disk(site, center, 0.2 * site.size)
    ground, rng = site.mech.ground.at(*center), site.rng
    site.mech.add(bd.Revolute(site.name("bearing"), ground, disk.at(*center)))
    speed = site.log(1.0, 30.0)
    law = rng.choice(
        [bd.run_up(speed, 0.3 * site.t_end), bd.sine(0.5, speed / (2.0 * np.pi))]  # type: ignore
    )
    driver = bd.Driver(site.name("driver"), ground, disk.at(*center), law=law)
    site.mech.add(driver)
    site.mech.observe(site.name("drive"), driver.drive)
    rim = disk.at(center[0], center[1] + 0.2 * site.size)
    site.mech.add(bd.Spring(site.name("tie"), rim, site.tip, _stiffness(site)))


def shaker(site: Site) -> None:
    """Block moved by a translational driver, tied to the tip by a spring and a damper."""
    center = tuple((site.at + np.array([0.0, 0.7 * site.size])).tolist())
    disk = _add_disk(site, center, 0.1 * site.size)
    ground = site.mech.ground.at(*center)
    site.mech.add(bd.Prismatic(site.name("guide"), ground, disk.at(*center), direction=(1.0, 0.0)))
    law = bd.sine(0.1 * site.size, site.log(1.0, 10.0))
    driver = bd.TranslationalDriver(
        site.name("driver"), ground, disk.at(*center), law=law, direction=(1.0, 0.0)
    )
    site.mech.add(driver)
    ends = disk.at(*center), site.tip
    site.mech.add(bd.Spring(site.name("tie"), *ends, _stiffness(site), _damping(site)))


def beam_effects(site: Site) -> None:
    """Air drag, oil, or a distributed or moving force on the first beam."""
    if not site.beams:
        return load(site)
    beam, kind = site.beams[0], site.rng.integers(4)
    weight = beam.section.at(0.0).rhoA * -GRAVITY[1]
    if kind == 0:
        site.mech.add(bd.AirDrag(site.name("drag"), beam, coefficient=site.log(0.01, 1.0)))
    elif kind == 1:
        mass = site.log(0.1, 10.0)
        site.mech.add(bd.RayleighDamping(site.name("oil"), beam, mass=mass, stiffness=1e-5))
    elif kind == 2:
        law = (0.0, _time_law(site, 0.3 * weight))
        site.mech.add(bd.DistributedForce(site.name("wind"), beam, law))
    else:
        force = (0.0, -0.3 * weight * beam.length)
        speed = beam.length / (site.t_end * site.rng.uniform(0.3, 0.9))
        site.mech.add(bd.MovingForce(site.name("cart"), beam, force, speed))
    return None


def _crossed_height(site: Site) -> tuple[str, float]:
    """Return a column of the tip and a value that it may cross."""
    x, y = site.near(site.size * site.log(0.03, 0.5))
    return ("tip.x", x) if site.rng.random() < 0.5 else ("tip.y", y)


def release(site: Site) -> None:
    """Spring that an event deactivates, or activates."""
    anchor = site.mech.ground.at(*site.near(site.size * site.rng.uniform(0.3, 1.0)))
    part = site.mech.add(bd.Spring(site.name("spring"), anchor, site.tip, _stiffness(site)))
    column, value = _crossed_height(site)
    action: Any = bd.deactivate(part)
    if site.rng.random() < 0.5:
        site.mech.deactivate(part)
        action = bd.activate(part)
    site.mech.when(column, value, "both", do=action, name=site.name("release"))


def catch(site: Site) -> None:
    """Joint between the tip and the ground that an event activates."""
    x, y = site.near(site.size * site.rng.uniform(0.5, 1.0))
    link = bd.Distance(site.name("link"), site.mech.ground.at(x, y), site.tip)
    site.mech.deactivate(site.mech.add(link))
    column, value = _crossed_height(site)
    action = bd.activate(link, as_is=True)
    site.mech.when(column, value, "both", do=action, name=site.name("catch"))


def rebound(site: Site) -> None:
    """Impacts of the tip on a line."""
    foot = site.below(site.size * site.log(0.05, 0.6))
    x, y = site.at - np.array(foot)
    gap = bd.LineSurface(site.mech.ground.at(*foot), direction=(y, -x)).gap(site.tip)
    action = bd.impact(gap, restitution=site.rng.uniform(0.5, 1.0))
    site.mech.when(gap, 0.0, "down", do=action, name=site.name("rebound"))


def switched_driver(site: Site) -> None:
    """Driven disk whose law an event changes."""
    center = tuple((site.at + np.array([0.7 * site.size, 0.0])).tolist())
    disk = _add_disk(site, center, 0.2 * site.size)
    ground = site.mech.ground.at(*center)
    site.mech.add(bd.Revolute(site.name("bearing"), ground, disk.at(*center)))
    speed = site.log(1.0, 30.0)
    driver = bd.Driver(
        site.name("driver"), ground, disk.at(*center), law=bd.run_up(speed, 0.2 * site.t_end)
    )
    site.mech.add(driver)
    rim = disk.at(center[0], center[1] + 0.2 * site.size)
    site.mech.add(bd.Spring(site.name("tie"), rim, site.tip, _stiffness(site)))
    slower = bd.change_law(driver, lambda t: 0.5 * speed * t)
    angle = speed * site.t_end * site.rng.uniform(0.1, 0.7)
    site.mech.when(f"{site.name('disk')}.angle", angle, "up", do=slower, name=site.name("slower"))


ADDITIONS: dict[str, Callable[[Site], None]] = {
    addition.__name__.replace("_", " "): addition
    for addition in (
        floor,
        floor,
        peg,
        bowl,
        moving_peg,
        joint_friction,
        spring,
        damper,
        one_sided_spring,
        torsion_spring,
        bushing,
        magnet,
        load,
        gear,
        rack,
        rolling_disk,
        skate,
        slider_on_beam,
        driven_body,
        shaker,
        beam_effects,
        release,
        catch,
        rebound,
        switched_driver,
    )
}
CONTACTS = ("floor", "peg", "bowl", "moving peg")
_CONTACT_SHARE = 0.5  # of the first additions


def sample_additions(rng: Rng) -> list[str]:
    """Sample none to three additions; half of the first ones are contacts or joint friction."""
    count = int(rng.choice([0, 1, 1, 1, 2, 2, 3]))
    names = [str(rng.choice(list(ADDITIONS))) for _ in range(count)]
    if names and rng.random() < _CONTACT_SHARE:
        names[0] = str(rng.choice([*CONTACTS, "joint friction"]))
    return names


def _add_chain(site: Site) -> None:
    """Add one to three bars and beams, hinged or clamped to the ground."""
    rng, mech = site.rng, site.mech
    count = int(rng.choice([1, 1, 2, 2, 3]))
    height = 10.0 ** rng.uniform(np.log10(2e-3), np.log10(2e-2))
    previous, angle = mech.ground.at(0.0, 0.0), rng.uniform(-np.pi, np.pi)
    site.size = site.mass = 0.0
    for k in range(count):
        parameters = sample_body(rng, bool(rng.random() < _RIGID_SHARE), height)
        start, end, body = _add_body(site, f"body {k}", parameters, previous.point, angle)
        is_clamped = k == 0 and not parameters.rigid and rng.random() < 0.4
        joint = (bd.Weld if is_clamped else bd.Revolute)(f"joint {k}", previous, start)
        mech.add(joint)
        if k == 0 and not is_clamped:
            site.hinge = joint
        previous, angle = end, angle + parameters.bend + parameters.turn
        site.size, site.mass = site.size + parameters.length, site.mass + parameters.mass
        site.body = body
    site.tip = previous
    site.at = np.array(previous.point, float)


def _add_body(
    site: Site, name: str, parameters: BodyParameters, start: Any, angle: float
) -> tuple[Any, Any, Any]:
    """Add a bar, a beam with a floating frame or an exact beam; return its ends and itself."""
    span = parameters.length * np.array([np.cos(angle), np.sin(angle)])
    if parameters.rigid:
        end = tuple((np.array(start) + span).tolist())
        bar = site.mech.add(bd.RigidBody.rod(name, start, end, mass=parameters.mass))
        return bar.at(*start), bar.at(*end), bar
    axis: Any = bd.Line(start, tuple((np.array(start) + span).tolist()))
    if parameters.bend:
        axis = bd.Arc(parameters.length / parameters.bend, parameters.length, start, angle)
    settings: dict[str, Any] = dict(PAPER)
    if site.rng.random() < _EXACT_SHARE:
        settings = {"formulation": "exact"}
    beam = bd.Beam(name, axis, parameters.section, elements=2, **settings)
    site.beams.append(site.mech.add(beam))
    return beam.start, beam.end, beam


def _add_ball(site: Site) -> None:
    """Add a particle: thrown, on a thread, or on a spring."""
    rng = site.rng
    speed = rng.uniform(-3.0, 3.0, 2)
    kind = rng.integers(3)
    velocity = tuple(speed.tolist()) if kind == 0 else (0.0, 0.0)
    site.mass = site.log(0.05, 2.0)
    ball = site.mech.add(bd.PointMass("ball", site.mass, at=(0.0, 0.0), velocity=velocity))
    site.tip, site.at, site.size = ball.point, np.zeros(2), rng.uniform(0.3, 1.0)
    anchor = site.mech.ground.at(*site.near(site.size))
    if kind == 1:
        site.mech.add(bd.Distance("thread", anchor, ball.point))
    elif kind == 2:
        site.mech.add(bd.Spring("spring", anchor, ball.point, _stiffness(site)))


def _add_slider(site: Site) -> None:
    """Add a block on a guide with a spring."""
    rng = site.rng
    site.mass, site.size = site.log(0.1, 3.0), rng.uniform(0.2, 0.8)
    angle = rng.uniform(-np.pi, np.pi)
    direction = (float(np.cos(angle)), float(np.sin(angle)))
    speed = rng.uniform(0.0, 2.0)
    velocity = (speed * direction[0], speed * direction[1])
    block = site.mech.add(
        bd.RigidBody("block", site.mass, site.mass * (0.1 * site.size) ** 2, velocity=velocity)
    )
    guide = bd.Prismatic("guide", site.mech.ground.at(0.0, 0.0), block.at(0.0, 0.0), direction)
    site.hinge = site.mech.add(guide)
    site.tip, site.body = block.at(0.0, 0.0), block
    anchor = (site.size * direction[0], site.size * direction[1])
    site.mech.add(bd.Spring("spring", site.mech.ground.at(*anchor), site.tip, _stiffness(site)))


def describe_mechanism(seed: int) -> tuple[str, list[str]]:
    """Return the base and the additions of a seed."""
    rng = np.random.default_rng(seed)
    return str(rng.choice(_BASES)), sample_additions(rng)


@bd.model(t_end=1.0)
def random_mechanism(seed=0):
    """Chain, ball or slider with none to three additions."""
    base, additions = describe_mechanism(seed)
    rng = np.random.default_rng([seed, 1])
    mech = bd.Mechanism(gravity=GRAVITY)
    site = Site(mech, rng, end_time(seed))
    {"chain": _add_chain, "ball": _add_ball, "slider": _add_slider}[base](site)
    mech.observe("tip", site.tip)
    for k, name in enumerate(additions):
        site.prefix = f"{k}"
        ADDITIONS[name](site)
    return mech


def end_time(seed: int) -> float:
    """Return the end time of the mechanism of a seed [s]."""
    return float(np.round(np.random.default_rng([seed, 2]).uniform(0.4, 1.5), 2))
