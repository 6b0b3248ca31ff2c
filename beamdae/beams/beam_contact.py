"""Contact of a beam with a surface along a range of arc lengths."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from beamdae.beams.beam import Beam, require_beam
from beamdae.beams.shape_functions import gauss_points
from beamdae.errors import (
    BeamdaeError,
    require_finite,
    require_name,
    require_positive,
    set_fields,
)
from beamdae.parts.attachments import Attachment
from beamdae.parts.forces.contact import (
    CircleSurface,
    Contact,
    LineSurface,
    require_unit_of_stiffness,
)
from beamdae.parts.forces.load_observables import ObservablePower
from beamdae.parts.part import FORCE, RegularizedFriction, SurfaceGap
from beamdae.symbolic.statements import (
    ForceStatement,
    Quantity,
    Variable,
    add_quantities,
    rebuilt_for_mesh,
)

Array = np.ndarray
_MAX_POINTS = 1000  # of contact along a beam
# Settings of the law of a `Contact`.
_LAW = (
    *("exponent", "restitution", "impact_speed", "friction", "friction_speed"),
    *("static", "stribeck"),
)


@dataclass(frozen=True, eq=False)
class BeamContact(ObservablePower):
    """Contact of a beam with a surface along the beam, such as a strip over a cam.

    The force per length at the penetration d of the axis is that of a `Contact`,
    stiffness d^exponent with hysteresis and friction, integrated by Gauss points in each element:
    as many as nodes, so that finer meshes refine the contact, too, and at distances of at most half
    the radius of a circle, so that it does not pass between them. The axis of the beam touches the
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
        do not ascend, a circle is smaller than 1/320 of the range, or as for `Contact`.

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
    restitution: float = 1.0
    impact_speed: float | None = None
    friction: float = 0.0
    friction_speed: float | None = None
    static: float | None = None
    stribeck: float | None = None

    def __post_init__(self) -> None:
        name = require_name("BeamContact", self.name)
        set_fields(self, name=name)
        beam = require_beam(name, self.beam)
        last = beam.length if self.end is None else self.end
        start, end = (beam.at(x).s or 0.0 for x in (self.start, last))
        exponent = require_finite(name, "exponent", self.exponent)
        require_unit_of_stiffness(name, self.stiffness, exponent, is_per_length=True)
        stiffness = require_positive(name, "stiffness", self.stiffness)
        set_fields(self, stiffness=stiffness, start=start, end=end)
        law = self._contact_at(start, 1.0)
        if law.surface.on.body is beam:
            raise BeamdaeError(f"{name}: surface must not be on the beam itself.")
        if not start < end:
            raise BeamdaeError(f"{name}: start must be less than end, got {start:g} and {end:g} m.")
        least = math.pi * (end - start) / _MAX_POINTS
        if self.surface.size < least:
            raise BeamdaeError(
                f"{name}: the radius of the surface must be at least {least:.3g} m for a range of "
                f"{end - start:.3g} m, got {self.surface.size:g} m."
            )
        # Defaults of the law are resolved, and numbers are converted.
        set_fields(self, **{x: getattr(law, x) for x in _LAW})
        beam._has_moving_load = True

    def _contact_at(self, s: float, weight: float) -> Contact:
        """Return the contact of a section at s [m] with the stiffness of a length `weight` [m]."""
        law: dict[str, Any] = {x: getattr(self, x) for x in _LAW}
        return Contact(self.name, self.beam.at(s), self.surface, self.stiffness * weight, **law)

    @property
    def _contacts(self) -> list[Contact]:
        """Contacts at the Gauss points between `start` and `end`."""
        mesh, contacts = self.beam.mesh, []
        bounds = np.clip(mesh.element_bounds, self.start, self.end)
        for low, high in pairwise(bounds.tolist()):
            if high > low:
                half = 0.5 * (high - low)
                # The distance of Gauss points is at most half the radius of a circle.
                needed = math.ceil(math.pi * (high - low) / self.surface.size)
                xi, weights = gauss_points(max(mesh.nodes, needed))
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
        return self.beam.at(0.5 * (self.start + float(self.end or 0.0)))

    @property
    def regularized_friction(self) -> RegularizedFriction | None:
        """Regularization of the friction; None without friction."""
        return self._contact_at(self.start, 1.0).regularized_friction

    @property
    @rebuilt_for_mesh
    def gap(self) -> Quantity:
        """Smallest distance of the contact points from the surface [m], negative in contact."""
        return self.surface.smallest_gap([x.point for x in self._contacts])

    @property
    def gaps(self) -> tuple[SurfaceGap, ...]:
        """Smallest gap, as a tuple of one entry: later points touch gradually."""
        return (SurfaceGap(self.gap, self.beam.name, self.surface.remedy),)

    def forces(self, gravity: Array) -> list[ForceStatement]:
        """Return one statement for each contact point."""
        return [x for contact in self._contacts for x in contact.forces(gravity)]

    @property
    @rebuilt_for_mesh
    def force(self) -> Quantity:
        """Resultant force Fx, Fy [N] on the beam, in the inertial frame."""
        return add_quantities([contact.load_on("point") for contact in self._contacts], FORCE)

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
            If `s` is not between `start` and `end`.
        """
        s, last = require_finite(self.name, "s", s), float(self.end or 0.0)
        if not self.start <= s <= last:
            raise BeamdaeError(
                f"{self.name}: arc length s must lie in [{self.start:g}, {last:g}] m, where the "
                f"beam can touch, got {s:g}."
            )
        force = self._contact_at(s, 1.0).force
        return replace(force, columns=(Variable("p", "N/m"), Variable("t", "N/m")))
