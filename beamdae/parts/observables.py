"""Observables of attachments: absolute motion, relative motion and relative displacement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, require_choice, short_repr
from beamdae.parts.attachments import (
    Attachment,
    require_angle,
    require_attachment,
    rotate,
    suggest_point,
)
from beamdae.parts.part import PlacedPoint, observe_points
from beamdae.parts.signals import NO_UNIT, Value, find_unit, require_formula
from beamdae.symbolic.formula import (
    MAX_SHARED_KERNELS,
    Formula,
    constant_formula,
)
from beamdae.symbolic.statements import SX, Local, Quantity, Variable, rebuilt_for_mesh


@rebuilt_for_mesh
def motion_quantity(attachment: Attachment) -> Quantity:
    """Return the position [m], the angle [rad] and their rates for an attachment.

    All values refer to the inertial frame. The angle and its rate are omitted if the rotation is
    constant, as for particles and points of the ground.
    """
    has_rotation = _has_rotation(attachment)
    columns = [Variable("x", "m"), Variable("y", "m"), *([Variable("angle", "rad")] * has_rotation)]
    functions = [constant_formula(attachment.inclination)] if has_rotation else []
    columns += [column.rate for column in columns]
    return observe_points([attachment], _motion, columns, functions)


def as_quantity(name: str, what: Attachment | Quantity | SX, unit: str | None = None) -> Quantity:
    """Return a quantity, or the motion of an attachment, rebuilt for the present beam meshes.

    `unit` is that of a formula of inputs, sensors and states, see `find_unit`.

    Raises
    ------
    BeamdaeError
        If `what` is neither an attachment nor a quantity nor such a formula, or `unit` is invalid
        or given for something else.
    """
    if isinstance(what, SX):
        formula = require_formula(name, "the observed formula", what)
        variable = Variable("", find_unit(name, formula, unit) or NO_UNIT)
        return Quantity((variable,), (), lambda local: formula)
    if not isinstance(what, Attachment | Value | Quantity):
        raise BeamdaeError(
            f"{name}: only attachments, quantities such as beam.strain(s=, offset=) and formulas "
            f"of sensors can be observed, got {short_repr(what)}{suggest_point(what)}."
        )
    if unit is not None:
        raise BeamdaeError(
            f"{name}: unit is that of a formula, but {short_repr(what)} has units; omit it."
        )
    if isinstance(what, Attachment):
        return motion_quantity(what)
    return what.quantity if isinstance(what, Value) else what.current


def _has_rotation(attachment: Attachment) -> bool:
    kinematics = attachment.checked_kinematics
    if isinstance(kinematics, Formula):
        return _kind_has_rotation(kinematics.kind, attachment.size, len(kinematics.numbers))
    return _depends_on_coordinates(kinematics, attachment.size)


@lru_cache(maxsize=MAX_SHARED_KERNELS)
def _kind_has_rotation(kind: Callable[..., Any], size: int, n_numbers: int) -> bool:
    return _depends_on_coordinates(Formula(kind, SX.sym("numbers", n_numbers)), size)


def _depends_on_coordinates(kinematics: Callable[[SX], tuple[SX, SX]], size: int) -> bool:
    _, rotation = kinematics(SX.sym("q", size))
    return not SX(rotation).is_constant()


def _motion(local: Local, points: Sequence[PlacedPoint], *inclination: Callable[[], Any]) -> SX:
    (position, rotation), *_ = points
    placement = ca.vertcat(position, *(angle()[0] + rotation for angle in inclination))
    return ca.vertcat(placement, local.dot(placement))


@dataclass(frozen=True)
class _Acceleration:
    """Acceleration of a point, and its angular acceleration if the rotation is not constant."""

    axes: str
    has_rotation: bool

    def __call__(
        self, local: Local, points: Sequence[PlacedPoint], inclination: Callable[[], Any]
    ) -> SX:
        ((position, rotation),) = points
        values = local.ddot(position)
        if self.axes == "section":
            values = rotate(-(inclination()[0] + rotation), values)
        return ca.vertcat(values, local.ddot(rotation)) if self.has_rotation else values


@rebuilt_for_mesh
def acceleration(of: Attachment, axes: str = "inertial") -> Quantity:
    """Return the acceleration of a point and its angular acceleration.

    The columns follow from the accelerations of the coordinates, which satisfy the equations of
    motion at each step of a run; they are not differences of velocities. Between steps, they are
    interpolated like reactions. At the onset of a sudden load, they include the response of modes
    that decay within the first step and may be large. The first row of a run belongs to its start:
    there, regularized friction of a body at rest is zero. Impacts (`bd.impact`) change velocities
    at once and have no acceleration. An accelerometer measures this acceleration minus gravity.

    They are columns of runs, of `sensitivities`, and of `linearize` about an equilibrium, but not
    of events, controllers, FMUs and adjoint gradients.

    Parameters
    ----------
    of
        The point.
    axes
        Axes of the components: "inertial", or "section" for axes that rotate with `of`, such as the
        axes of an accelerometer: along the axis of the beam and its left normal, or the axes of a
        rigid body.

    Returns
    -------
    Quantity
        Columns ax, ay [m/s^2] and angle_ddot [rad/s^2]; the last one is omitted for particles and
        points of the ground.

    Raises
    ------
    BeamdaeError
        If `of` is not an attachment, `axes` is unknown, or `of` is a particle and `axes` is
        "section".

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
    >>> mech.observe("ball acceleration", bd.acceleration(ball.point))
    >>> solution = bd.simulate(mech, t_end=0.1)
    >>> print(f"{solution['ball acceleration.ay'].iloc[-1]:.2f} m/s^2")
    -9.81 m/s^2
    """
    require_attachment("acceleration", "of", of)
    require_choice("acceleration", "axes", axes, ("inertial", "section"))
    if axes == "section":
        require_angle("acceleration", of)
    has_rotation = _has_rotation(of)
    columns = [Variable("ax", "m/s^2"), Variable("ay", "m/s^2")]
    columns += [Variable("angle_ddot", "rad/s^2")] * has_rotation
    functions = [constant_formula(of.inclination)]
    build = _Acceleration(axes, has_rotation)
    return observe_points([of], build, columns, functions, has_accelerations=True)


def express_displacement(
    local: Local, points: Sequence[PlacedPoint], arm: Callable[[], Any], *angle: Callable[[], Any]
) -> SX:
    """Return displacement and rotation (u, v, phi) of a point relative to the end of an arm.

    The arm is fixed to the body or section of a reference point, the second one. With an angle, the
    axes rotate with this point, and the angle is that of the axes in the reference configuration.
    """
    (position, rotation), (root, root_rotation) = points
    displacement = position - (root + rotate(root_rotation, arm()))
    for inclination in angle:
        displacement = rotate(-(inclination()[0] + root_rotation), displacement)
    return ca.vertcat(displacement, rotation - root_rotation)


@rebuilt_for_mesh
def relative_displacement(of: Attachment, on: Attachment, axes: str = "inertial") -> Quantity:
    """Return displacement and rotation of `of` relative to a rigid reference moving with `on`.

    With `on` at the root of a beam, the displacement and the rotation describe the deformation
    relative to the root, even across several beams welded together.

    Parameters
    ----------
    of
        Displaced point.
    on
        Point whose body or section is the reference.
    axes
        Axes of the components: "inertial", or "section" for axes that rotate with `on`: along the
        axis of the beam at `on` and its left normal, or the axes of a rigid body. In these axes, v
        is the transverse deflection of a rotating blade.

    Returns
    -------
    Quantity
        Columns u, v [m] and phi [rad], the rotation of `of` relative to `on`.

    Raises
    ------
    BeamdaeError
        If `of` or `on` is not an attachment or is a particle, or `axes` is unknown.
    """
    require_attachment("relative_displacement", "of", of)
    require_attachment("relative_displacement", "on", on)
    require_angle("relative_displacement", of)
    require_angle("relative_displacement", on)
    require_choice("relative_displacement", "axes", axes, ("inertial", "section"))
    functions = [constant_formula(*np.subtract(of.point, on.point).tolist())]
    if axes == "section":
        functions.append(constant_formula(on.inclination))
    columns = (Variable("u", "m"), Variable("v", "m"), Variable("phi", "rad"))
    return observe_points([of, on], express_displacement, columns, functions)


@dataclass(frozen=True)
class _RelativeMotion:
    """Motion of a point as seen from the body or section of a reference point.

    Attributes
    ----------
    axes
        As in `relative_motion`.
    has_angle
        True if the relative angle is a column.
    """

    axes: str
    has_angle: bool

    def __call__(
        self, local: Local, points: Sequence[PlacedPoint], angles: Callable[[], Any]
    ) -> SX:
        (position, rotation), (root, root_rotation) = points
        placement = position - root
        if self.axes == "section":
            placement = rotate(-(angles()[1] + root_rotation), placement)
        if self.has_angle:
            angle = angles()[0] + rotation - (angles()[1] + root_rotation)
            placement = ca.vertcat(placement, angle)
        return ca.vertcat(placement, local.dot(placement))


@rebuilt_for_mesh
def relative_motion(of: Attachment, on: Attachment, axes: str = "section") -> Quantity:
    """Return position, angle and rates of `of` relative to `on`, in axes that move with `on`.

    An observer who moves with the body of `on` measures these values, for example a sensor on a
    carriage. The rates are the derivatives of the components.

    Parameters
    ----------
    of
        Observed point.
    on
        Origin of the axes.
    axes
        Axes of the components: "section" for axes that rotate with `on`: along the axis of the beam
        at `on` and its left normal, or the axes of a rigid body; or "inertial".

    Returns
    -------
    Quantity
        Columns x, y [m] and angle [rad], followed by their rates x_dot, y_dot [m/s] and angle_dot
        [rad/s]. The angle is that of the section or body of `of` relative to that of `on`; it is
        omitted if one of them is a particle.

    Raises
    ------
    BeamdaeError
        If `of` or `on` is not an attachment, `axes` is unknown, or `on` is a particle and `axes` is
        "section".

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism()
    >>> arm = mech.add(bd.RigidBody("arm", mass=1.0, inertia=0.1, center=(0.5, 0.0)))
    >>> ball = mech.add(bd.PointMass("ball", 0.2, at=(1.0, 0.0)))
    >>> mech.observe("ball on arm", bd.relative_motion(ball.point, arm.at(0.5, 0.0)))
    """
    require_attachment("relative_motion", "of", of)
    require_attachment("relative_motion", "on", on)
    require_choice("relative_motion", "axes", axes, ("section", "inertial"))
    if axes == "section":
        require_angle("relative_motion", on)
    has_angle = of.has_angle and on.has_angle
    columns = [Variable("x", "m"), Variable("y", "m"), *([Variable("angle", "rad")] * has_angle)]
    columns += [column.rate for column in columns]
    angles = constant_formula(of.inclination, on.inclination)
    return observe_points([of, on], _RelativeMotion(axes, has_angle), columns, [angles])
