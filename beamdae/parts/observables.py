"""What can be observed of attachments: their motion, and how they move relative to each other."""

from __future__ import annotations

import casadi as ca
import numpy as np

from beamdae.parts.attachments import Attachment, require_angle, require_attachment, rotate
from beamdae.symbolic.statements import SX, Local, Named, Quantity


def motion(attachment: Attachment) -> Quantity:
    """Position, angle and their rates of an attachment, in the inertial frame."""
    has_angle = not SX(attachment.turn(SX.sym("q", attachment.size))).is_constant()
    place = [Named("x", "m"), Named("y", "m"), *([Named("angle", "rad")] if has_angle else [])]
    columns = (*place, *(column.rate for column in place))

    def expression(local: Local) -> SX:
        place = attachment.position(local.q)
        if has_angle:
            place = ca.vertcat(place, attachment.inclination + attachment.turn(local.q))
        return ca.vertcat(place, local.dot(place))

    return Quantity(columns, (attachment.piece,), expression)


def relative_displacement(of: Attachment, on: Attachment) -> Quantity:
    """How far the point `of` is from where the body of `on` would carry it if it were rigid.

    Columns u, v [m], components in the inertial frame, and phi [rad], the turn of the section `of`
    relative to that of `on`. With `on` the root of a beam it is the deformation seen from there,
    also across several beams welded together.
    """
    require_attachment("relative_displacement", "of", of)
    require_attachment("relative_displacement", "on", on)
    require_angle("relative_displacement", of)
    require_angle("relative_displacement", on)
    arm = np.subtract(of.point, on.point)

    def expression(local: Local) -> SX:
        q_of, q_on = local.q[: of.size], local.q[of.size :]
        carried = on.position(q_on) + rotate(on.turn(q_on), arm)
        return ca.vertcat(of.position(q_of) - carried, of.turn(q_of) - on.turn(q_on))

    columns = (Named("u", "m"), Named("v", "m"), Named("phi", "rad"))
    return Quantity(columns, (of.piece, on.piece), expression)
