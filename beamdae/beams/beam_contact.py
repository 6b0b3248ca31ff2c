"""Contact of a beam with a surface along a range of arc lengths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import casadi as ca
import numpy as np

from beamdae.beams.beam import Beam, require_beam
from beamdae.beams.shape_functions import gauss_points
from beamdae.errors import BeamdaeError, require_name, require_positive, set_fields
from beamdae.parts.attachments import Attachment
from beamdae.parts.forces.contact import Contact
from beamdae.parts.forces.load_observables import FORCE, ObservablePower, resultant_at
from beamdae.parts.forces.regularized_friction import RegularizedFriction
from beamdae.parts.forces.surfaces import CircleSurface, LineSurface
from beamdae.parts.part import SurfaceGap
from beamdae.symbolic.statements import ForceStatement, Quantity, Variable, rebuilt_for_mesh

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class BeamContact(ObservablePower):
    """Contact of a beam with a surface along the beam, such as a strip over a cam.

    The force per length at the penetration d of the axis is that of a `Contact`,
    stiffness d^exponent with hysteresis and friction, integrated by Gauss points in each element:
    as many as nodes, so that finer meshes refine the contact, too. The axis of the beam touches the
    surface; add half the thickness to the radius of a circle, or shift a line.

    Parameters
    ----------
    name
        Unique name.
    beam
        The beam.
    surface
        `bd.LineSurface` or `bd.CircleSurface`, not on the same beam.
    stiffness
        Penalty stiffness per length [N/m^(1 + exponent)], positive: in N/m^2.5 by default.
    start, end
        Arc lengths between which the beam can touch [m]. Default to the whole beam.
    exponent, restitution, impact_speed, friction, friction_speed, static, stribeck
        See `Contact`.

    Raises
    ------
    BeamdaeError
        If `beam` is not a Beam, `surface` is on this beam, the arc lengths are outside the beam or
        do not ascend, or as for `Contact`.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.001)
    >>> blade = mech.add(bd.Beam("blade", bd.Line((0.0, 0.0), (0.4, 0.0)), strip, elements=20))
    >>> cam = bd.CircleSurface(mech.ground.at(0.1, -0.3), radius=0.3)
    >>> wrap = mech.add(bd.BeamContact("wrap", blade, cam, stiffness=1e9, exponent=1.0))
    """

    symbol = "contact"
    name: str
    beam: Beam
    surface: LineSurface | CircleSurface
    stiffness: float
    start: float = 0.0
    end: float | None = None
    exponent: float = 1.5
    restitution: float | None = None
    impact_speed: float | None = None
    friction: float = 0.0
    friction_speed: float | None = None
    static: float | None = None
    stribeck: float | None = None

    def __post_init__(self) -> None:
        name = require_name("BeamContact", self.name)
        set_fields(self, name=name)
        beam = require_beam(name, self.beam)
        start = beam.at(self.start).s
        end = beam.length if self.end is None else beam.at(self.end).s
        stiffness = require_positive(name, "stiffness", self.stiffness)
        set_fields(self, stiffness=stiffness, start=start, end=end)
        law = self._contact_at(self.start, 1.0)
        if law.surface.on.body is beam:
            raise BeamdaeError(f"{name}: surface must not be on the beam itself.")
        if not start < end:
            raise BeamdaeError(f"{name}: start must be less than end, got {start:g} and {end:g} m.")
        for field in ("exponent", "restitution", "impact_speed", "friction", "friction_speed"):
            set_fields(self, **{field: getattr(law, field)})
        set_fields(self, static=law.static, stribeck=law.stribeck)
        beam.has_moving_load = True

    def _contact_at(self, s: float, weight: float) -> Contact:
        """Return the contact of a section at s [m] with the stiffness of a length `weight` [m]."""
        law = (self.restitution, self.impact_speed, self.friction, self.friction_speed)
        more = {"static": self.static, "stribeck": self.stribeck}
        at, stiffness = self.beam.at(s), self.stiffness * weight
        return Contact(self.name, at, self.surface, stiffness, self.exponent, *law, **more)

    @property
    def _contacts(self) -> list[Contact]:
        """Contacts at the Gauss points between `start` and `end`."""
        mesh, contacts = self.beam.mesh, []
        xi, weights = gauss_points(mesh.nodes)
        bounds = np.clip(mesh.element_bounds, self.start, self.end)
        for low, high in pairwise(bounds.tolist()):
            if high > low:
                half = 0.5 * (high - low)
                points = zip(low + half * (1.0 + xi), half * weights, strict=True)
                contacts += [self._contact_at(float(s), float(x)) for s, x in points]
        return contacts

    @property
    def attachments(self) -> tuple[Attachment, ...]:
        """Attachment of the surface: elements need not end at the contact points."""
        return (self.surface.on,)

    @property
    def point(self) -> Attachment:
        """Section in the middle of the range, where the contact is drawn."""
        assert self.end is not None
        return self.beam.at(0.5 * (self.start + self.end))

    def sharpen_friction(self, ratio: float) -> bool:
        """Multiply the friction speed, see `Part`."""
        if self.friction:
            set_fields(self, friction_speed=ratio * float(self.friction_speed or 0.0))
        return self.friction > 0.0

    @property
    def regularized_friction(self) -> RegularizedFriction | None:
        """Law of the friction; None without friction."""
        return self._contact_at(self.start, 1.0).regularized_friction

    @property
    def gaps(self) -> Sequence[SurfaceGap]:
        """Gaps of all contact points."""
        return [gap for contact in self._contacts for gap in contact.gaps]

    def forces(self, gravity: Array) -> list[ForceStatement]:
        """Return one statement for each contact point."""
        return [x for contact in self._contacts for x in contact.forces(gravity)]

    @property
    @rebuilt_for_mesh
    def force(self) -> Quantity:
        """Resultant force Fx, Fy [N] on the beam, in the inertial frame."""
        points = [contact.point for contact in self._contacts]

        def combine(copies, local):
            loads = [
                resultant_at(at.checked_kinematics, *copy.of_piece(0), at.has_angle)[:2]
                for at, copy in zip(points, copies, strict=True)
            ]
            return sum(loads, ca.SX.zeros(2))

        return self._observe_forces(FORCE, combine)

    @rebuilt_for_mesh
    def pressure(self, s: float) -> Quantity:
        """Return the normal force p and the friction t per length at the arc length `s` [m].

        Parameters
        ----------
        s
            Arc length [m].

        Raises
        ------
        BeamdaeError
            If `s` is outside the beam.
        """
        force = self._contact_at(s, 1.0).force
        return replace(force, columns=(Variable("p", "N/m"), Variable("t", "N/m")))
