"""Small mechanism for tests, to which the sample parts of the catalog can be added."""

from __future__ import annotations

from functools import cached_property

from beamdae.beams.beam import Beam
from beamdae.beams.materials import Material
from beamdae.beams.sections import Section
from beamdae.curves.plane_curves import Arc, PlaneCurve
from beamdae.parts.bodies.rigid_body import Ground, RigidBody
from beamdae.parts.forces.surfaces import LineSurface
from beamdae.parts.joints.joint import Joint, Revolute
from beamdae.parts.mechanism import Mechanism


class SampleMechanism:
    """Mechanism with a disk, a beam and a hinge, each added when it is first accessed.

    Attributes
    ----------
    mechanism
        The mechanism, under gravity of 9.81 m/s^2.
    """

    def __init__(self) -> None:
        self.mechanism = Mechanism(gravity=(0.0, -9.81))

    @property
    def ground(self) -> Ground:
        """Ground of the mechanism, without coordinates."""
        return self.mechanism.ground

    @cached_property
    def disk(self) -> RigidBody:
        """Rigid body of 1 kg and 0.1 kg m^2 with its center of mass at (0.5, 0.4) m."""
        return self.mechanism.add(RigidBody("disk", 1.0, 0.1, (0.5, 0.4)))

    @cached_property
    def beam(self) -> Beam:
        """Beam of one element along `curve`."""
        return self.mechanism.add(Beam("beam", self.curve, self.section, elements=1))

    @cached_property
    def hinge(self) -> Joint:
        """Hinge between the ground and the disk at the origin."""
        ends = self.ground.at(0.0, 0.0), self.disk.at(0.0, 0.0)
        return self.mechanism.add(Revolute("hinge", *ends))

    @cached_property
    def floor(self) -> LineSurface:
        """Horizontal surface at y = -0.1 m."""
        return LineSurface(self.ground.at(0.0, -0.1))

    @cached_property
    def curve(self) -> PlaneCurve:
        """Arc of 1 m length and 1 m radius that starts at (0, 1) m."""
        return Arc(1.0, 1.0, start=(0.0, 1.0))

    @cached_property
    def material(self) -> Material:
        """Steel with a Young's modulus of 210 GPa and a density of 7850 kg/m^3."""
        return Material(E=2.1e11, nu=0.3, rho=7850.0)

    @cached_property
    def section(self) -> Section:
        """Steel rectangle of 20 mm width and 4 mm height."""
        return Section.rectangle(self.material, width=0.02, height=0.004)
