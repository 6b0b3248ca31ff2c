"""Mechanism: named parts under gravity, with observables and events."""

from __future__ import annotations

import math
from collections.abc import Mapping
from copy import copy
from itertools import islice
from typing import Any, TypeVar

import numpy as np

from beamdae.deferred import module
from beamdae.errors import (
    BeamdaeError,
    as_text,
    plain_text,
    require_choice,
    require_finite,
    require_mapping,
    require_name,
    require_pair,
    require_point,
    set_fields,
    short_repr,
    suggest,
    warn_user,
)
from beamdae.model_functions import HasOrigin
from beamdae.parts.attachments import Attachment
from beamdae.parts.bodies.rigid_body import Ground
from beamdae.parts.events import Event, select_impacts, select_switches
from beamdae.parts.gravity import GravityLaws
from beamdae.parts.laws import Law, as_law
from beamdae.parts.observables import as_quantity
from beamdae.parts.part import Part, require_extension
from beamdae.parts.rotation import Rotation
from beamdae.parts.signals import Input, Sensor, State
from beamdae.read_only import ReadOnlyDict, read_only, read_only_copy
from beamdae.symbolic.local_symbols import SX
from beamdae.symbolic.statements import Quantity

AS_DRAWN, EQUILIBRIUM = "as drawn", "equilibrium"
_ALLOWED = (
    f"{AS_DRAWN!r}, {EQUILIBRIUM!r}, bd.rotation(...) or a dict of positions and velocities by "
    "name such as {'crank.angle': 0.3, 'crank.angle_dot': 5.0}"
)


def require_start(part: str, start: Any, more: str = "") -> Any:
    """Return `start`, with floats as values if it is a mapping, or raise BeamdaeError.

    `more` lists further options in the message.
    """
    if as_text(start) in (AS_DRAWN, EQUILIBRIUM):
        return as_text(start)
    if isinstance(start, Rotation):
        return start
    values = require_mapping(part, "start", start, f"{_ALLOWED}{more}")
    return {
        name: require_finite(part, f"start[{short_repr(name)}]", value)
        for name, value in values.items()
    }


REFUSE, MINIMUM_NORM = "refuse", "minimum norm"
# Number of parts named in the repr of a mechanism.
_MAX_NAMES_IN_REPR = 6
_EARTH = 9.80665  # m/s^2
# Numbers of 1 m/s^2 in other units.
_GRAVITY_UNITS = {"mm/s^2": 1e3, "cm/s^2": 1e2, "in/s^2": 1.0 / 0.0254, "ft/s^2": 1.0 / 0.3048}
_MAX_GRAVITY_DIFFERENCE = 4e-3  # covers the poles, the equator and rounded numbers
P = TypeVar("P", bound=Part)


class Mechanism(HasOrigin):
    """Ordered, uniquely named parts under uniform gravity.

    Parameters
    ----------
    gravity
        Acceleration of gravity (gx, gy) [m/s^2]: numbers, or time laws. With time laws, the weight
        is a load, because gravity then has no potential.
    start
        Initial state: "as drawn" (the reference configuration with the initial velocities of the
        parts), "equilibrium" (at rest under the loads at t = 0), a steady `rotation`, or positions
        and velocities by name, {"part.coordinate": value, "part.coordinate_dot": value}; all other
        values are adjusted to satisfy the joints.
    redundant
        Treatment of redundant constraints: "refuse" raises an error; "minimum norm" removes them
        from the equations and distributes the reactions so that their norm is smallest.

    Attributes
    ----------
    gravity_laws
        Time laws of gravity, or None.
    start, redundant
        The parameters.
    ground
        The ground: `mech.ground.at(x, y)` is a fixed point.
    parts
        Parts by name, in the order in which they were added; without the ground.
    observables
        Observed quantities by name.
    events
        Events added by `when`.
    inactive
        Names of the parts that are inactive at the start.
    inputs
        Inputs added by `input`, by name.
    outputs
        Formulas of the outputs of `pid` controllers, by name.
    removed
        Names of the parts that an analysis has removed, whose measured loads are zero.

    Raises
    ------
    BeamdaeError
        If `gravity` is not a pair of numbers or valid time laws, or `start` or `redundant` is
        invalid. Assembly raises this error if a name in `start` is neither that of a coordinate nor
        that of a velocity, or no state with the values of `start` satisfies the joints.

    Examples
    --------
    >>> import beamdae as bd
    >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
    >>> bob = mech.add(bd.RigidBody("bob", mass=1.0, inertia=0.1, center=(1.0, 0.0)))
    >>> hinge = mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    """

    point_syntax = "mech.ground.at(x, y)"

    def __init__(
        self,
        gravity: tuple[Any, Any] = (0.0, 0.0),
        start: str | Mapping[str, float] = "as drawn",
        redundant: str = REFUSE,
    ) -> None:
        components = require_pair("Mechanism", "gravity", gravity)
        self.gravity_laws: GravityLaws | None = None
        if any(callable(component) for component in components):
            x, y = (as_law("Mechanism.gravity", component) for component in gravity)
            self.gravity_laws, gravity = GravityLaws((x, y)), (0.0, 0.0)
        self.gravity = gravity
        self.start = read_only(require_start("Mechanism", start))
        self.redundant = require_choice("Mechanism", "redundant", redundant, (REFUSE, MINIMUM_NORM))
        self.ground = Ground()
        self.parts: dict[str, Part] = {}
        self.observables: dict[str, Quantity] = {}
        self.events: list[Event] = []
        self.inactive: set[str] = set()
        self.inputs: dict[str, Input] = {}
        self.outputs: dict[str, SX] = {}
        self._has_sensors = False
        self.removed: frozenset[str] = frozenset()

    def __repr__(self) -> str:
        names = list(islice(self.parts, _MAX_NAMES_IN_REPR))
        if len(self.parts) > _MAX_NAMES_IN_REPR:
            names.append("...")
        return f"<Mechanism of {len(self.parts)} parts{': ' * bool(names)}{', '.join(names)}>"

    @property
    def gravity(self) -> np.ndarray:
        """Acceleration of gravity, shape (2,) [m/s^2]; zero if time laws prescribe it."""
        return read_only_copy(self._gravity)

    @gravity.setter
    def gravity(self, value: Any) -> None:
        self._gravity = require_point("Mechanism", "gravity", value)
        size = math.hypot(*self._gravity)
        for unit, one in _GRAVITY_UNITS.items():
            if abs(size / (_EARTH * one) - 1.0) < _MAX_GRAVITY_DIFFERENCE:
                warn_user(
                    f"Mechanism: gravity = {size:g} m/s^2 is that of the earth in {unit}; pass "
                    "m/s^2, such as gravity=(0.0, -9.81)."
                )

    def add(self, part: P) -> P:
        """Add a part, such as a body, a joint or a load, and return the part.

        Parameters
        ----------
        part
            The part. Parts to which it refers, such as the bodies of a joint, must be added first.

        Returns
        -------
        Part
            The same part.

        Raises
        ------
        BeamdaeError
            If `part` is not a part, its name is invalid or in use, or a part to which it refers has
            not been added.
        """
        if not isinstance(part, Part):
            raise BeamdaeError(
                "Mechanism: only parts (subclasses of beamdae.Part) can be added, "
                f"got {short_repr(part)}."
            )
        kind: Any = type(part)
        name = require_name(kind.__name__, getattr(part, "name", None))
        require_extension(kind)
        self._require_free(name)
        for body in part.bodies:
            self._require_member(name, body)
        if part.is_controller:
            self._connect(part)
        self.parts[name] = part
        return part

    def _require_free(self, name: str) -> None:
        if name == self.ground.name:
            raise BeamdaeError(
                f"Mechanism: the name {name!r} is reserved for the fixed ground, mech.ground; use "
                "another name."
            )
        if name in self.parts or name in self.inputs:
            raise BeamdaeError(
                f"Mechanism: the name {name!r} is in use; give each part a different name."
            )

    def _connect(self, controller: Any) -> None:
        """Let a controller drive its inputs."""
        name = controller.name
        for quantity in controller.quantities:
            self._require_members_of(name, quantity)
        for drive in controller.drives:
            if drive not in self.inputs.values():
                raise BeamdaeError(
                    f"{name}: the input {drive.name!r} is not part of this mechanism; add it with "
                    "mech.input."
                )
            if drive.pieces or controller.drives.count(drive) > 1:
                raise BeamdaeError(
                    f"{name}: the input {drive.name!r} is already driven; add another input."
                )
        for k, drive in enumerate(controller.drives):
            set_fields(drive, pieces=(controller.piece(k),))

    def input(self, name: str, default: Any = 0.0, unit: str = "-") -> Input:
        """Add an input and return it: a value that laws and formulas of parts can contain.

        The input is observed under its name and is an input of `linearize`. `simulate` can replace
        its value. It is used instead of a law, as in `bd.Moment("motor", hub, torque)`, or in a
        formula, as in `bd.Moment("motor", hub, 0.5 * torque - damping * rate)` with a sensor
        `rate`.

        Parameters
        ----------
        name
            Unique name.
        default
            Value, in `unit`: a number, a function of t [s] or a `Law`. A number is one of the
            numbers `p` of the equations of motion.
        unit
            Unit of the value.

        Returns
        -------
        Input
            The input.

        Raises
        ------
        BeamdaeError
            If the name is invalid or in use, the default is neither a number nor a valid law, or
            the unit is invalid.

        Examples
        --------
        >>> import beamdae as bd
        >>> mech = bd.Mechanism()
        >>> wheel = mech.add(bd.RigidBody("wheel", mass=1.0, inertia=0.5))
        >>> pin = mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0)))
        >>> torque = mech.input("torque", default=2.0, unit="N m")
        >>> motor = mech.add(bd.Moment("motor", wheel.at(0.0, 0.0), torque))
        >>> mech.observe("wheel", wheel.at(0.0, 0.0))
        >>> for value in (2.0, 3.0):
        ...     run = bd.simulate(mech, bd.Radau(), t_end=1.0, inputs={"torque": value})
        ...     print(f"{run['wheel.angle'].iloc[-1]:.4f}")
        2.0000
        3.0000
        """
        name = require_name("Mechanism.input", name)
        self._require_free(name)
        value = Input(name, default, unit)
        self.observe(name, value.quantity)
        self.inputs[name] = value
        return value

    def sensor(
        self,
        name: str,
        what: Attachment | Quantity | SX,
        column: str | None = None,
        unit: str | None = None,
    ) -> Sensor:
        """Add a sensor and return it: a measured value that laws and formulas can contain.

        The value is that of the quantity at the same time, without delay. It is observed under its
        name. Formulas with sensors define forces and rates of states, but not constraints.

        Parameters
        ----------
        name
            Unique name.
        what
            Quantity such as `spring.elongation` or `beam.strain(s=0.1, offset=0.01)`, an
            attachment, or a formula of inputs, sensors and states; not a reaction.
        column
            Name of the column of the quantity, such as "angle" of an attachment. May be omitted if
            there is only one column.
        unit
            Unit of a formula, see `observe`.

        Returns
        -------
        Sensor
            The sensor.

        Raises
        ------
        BeamdaeError
            If the name or the unit is invalid or the name is in use, `what` has none of these types
            or is a reaction, or there is no such column.
        """
        name = require_name("Mechanism.sensor", name)
        self._require_free(name)
        quantity = as_quantity(name, what, unit)
        names = [x.name for x in quantity.columns]
        header = names[0] if column is None and len(names) == 1 else as_text(column)
        if header not in names:
            raise BeamdaeError(
                f"{name}: column must be one of {', '.join(map(repr, names))}, "
                f"got {short_repr(column)}."
            )
        k = names.index(header)
        sensor = Sensor(name, quantity, k, quantity.columns[k].unit)
        self._require_members_of(name, quantity)
        self.observe(name, sensor.quantity)
        self._has_sensors = True
        return sensor

    @property
    def has_coordinate_signals(self) -> bool:
        """True if formulas may contain signals that depend on coordinates.

        These are sensors, states, and inputs that a controller drives.
        """
        has_driven_input = any(x.pieces for x in self.inputs.values())
        has_states = any(isinstance(x, State) for x in self.parts.values())
        return self._has_sensors or has_driven_input or has_states

    def state(
        self, name: str, rate: Any = None, start: float = 0.0, unit: str = "-", scale: float = 1.0
    ) -> State:
        """Add a first-order state x' = rate and return it: a value that formulas can contain.

        The state is observed under its name; `rate` is evaluated without delay. States enter the
        error control of adaptive integrators, linear models and modes, and sensitivities; at an
        equilibrium, their rates are zero. They store no energy. A state cannot define a constraint.

        Parameters
        ----------
        name
            Unique name.
        rate
            Rate x' [unit/s]: a number, a function of t [s], or a formula of inputs, sensors and
            states, such as `(target - angle) / 0.1`. The rate of a state that depends on itself is
            a function of the state and of time: `lambda x, t: (speed - x) / 0.1`. If None,
            `State.follows` defines the rate.
        start
            Value at the start.
        unit
            Unit of the state.
        scale
            Typical size of the state, in `unit`, relative to which adaptive integrators limit its
            error until a pilot run has measured its amplitude.

        Returns
        -------
        State
            The state.

        Raises
        ------
        BeamdaeError
            If the name is invalid or in use, `rate` is not a valid formula, `start` is not a finite
            number, the unit is invalid or `scale` is not positive.

        Examples
        --------
        >>> import beamdae as bd
        >>> mech = bd.Mechanism()
        >>> ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0), velocity=(1.0, 0.0)))
        >>> x = mech.sensor("x", ball.point, "x")
        >>> lag = mech.state("lag", lambda lag, t: (x - lag) / 0.5, unit="m")
        >>> run = bd.simulate(mech, bd.Radau(), t_end=5.0)
        >>> print(f"{run['lag'].iloc[-1]:.3f} m")
        4.500 m
        """
        state = State(require_name("Mechanism.state", name), rate, start, unit, scale)
        self._require_free(state.name)
        self.observe(state.name, state.quantity)
        return self.add(state)

    def with_inputs(self, values: Mapping[str, Any]) -> Mechanism:
        """Return a copy of the mechanism with other values of inputs.

        Parameters
        ----------
        values
            Numbers, functions of t [s] or `Law`s by name of the input.

        Raises
        ------
        BeamdaeError
            If there is no such input, or a value is invalid.
        """
        other = copy(self)
        other.inputs = dict(self.inputs)
        for name, value in require_mapping(
            "Mechanism", "inputs", values, "a dict of numbers or laws by name of the input"
        ).items():
            if name not in self.inputs:
                raise BeamdaeError(
                    f"Mechanism: there is no input {short_repr(name)}"
                    f"{suggest(name, self.inputs)}; add it with mech.input."
                )
            if self.inputs[name].pieces:
                raise BeamdaeError(
                    f"Mechanism: a controller drives the input {name!r}; omit its value."
                )
            other.inputs[name] = Input(name, value, self.inputs[name].unit)
        return other

    def observe(self, name: str, what: Attachment | Quantity | SX, unit: str | None = None) -> None:
        """Add columns to the results: motion of an attachment, a quantity, or a formula of sensors.

        The motion of an attachment has the columns name.x [m], name.y [m], name.angle [rad] (not
        for particles and points of the ground) and their rates.

        Parameters
        ----------
        name
            Prefix of the columns.
        what
            An attachment such as `beam.end`, a quantity such as `joint.reaction`, or a formula of
            inputs, sensors and states.
        unit
            Unit of a formula. Defaults to that of its signals if the formula is their sum or
            difference and they have one unit, otherwise to "-".

        Raises
        ------
        BeamdaeError
            If the name is invalid, in use or reserved ("t", and names that are "energy" or start
            with "energy."), `what` is neither an attachment nor a quantity nor a formula, `unit` is
            invalid or given without a formula, or a part to which `what` refers has not been added.

        Examples
        --------
        >>> import beamdae as bd
        >>> import numpy as np
        >>> mech = bd.Mechanism()
        >>> ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0), velocity=(3.0, 4.0)))
        >>> vx, vy = (mech.sensor(x, ball.point, x) for x in ("x_dot", "y_dot"))
        >>> mech.observe("speed", np.hypot(vx, vy), unit="m/s")
        >>> run = bd.simulate(mech, bd.Radau(), t_end=1.0)
        >>> print(f"{run['speed'].iloc[-1]:.3f} m/s")
        5.000 m/s
        """
        name = require_name("Mechanism.observe", name)
        if name == "t" or name.split(".")[0] == "energy":
            columns = "the time" if name == "t" else "the energy balance"
            raise BeamdaeError(
                f"Mechanism: the observable name {name!r} is reserved for {columns}; choose "
                "another name."
            )
        if name in self.observables:
            raise BeamdaeError(
                f"Mechanism: the observable name {name!r} is in use; choose another name."
            )
        quantity = as_quantity(name, what, unit)
        self._require_members_of(name, quantity)
        self.observables[name] = quantity

    def when(
        self,
        what: str | Quantity,
        crosses: float = 0.0,
        direction: str = "both",
        do: Any = "stop",
        name: str | None = None,
    ) -> Event:
        """Add an event that occurs when a column or quantity crosses a value, and return the event.

        Parameters
        ----------
        what, crosses, direction, do, name
            See `Event`.

        Returns
        -------
        Event
            The event.

        Raises
        ------
        BeamdaeError
            If an argument is invalid, a part to which the quantity or an impact refers has not been
            added, or an action refers to a part of another mechanism whose name is in use here.
            Assembly raises this error for an unknown column and for other actions on parts that
            have not been added.

        Examples
        --------
        >>> import beamdae as bd
        >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
        >>> ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
        >>> mech.observe("ball", ball.point)
        >>> impact = mech.when("ball.y", crosses=0.0, direction="down", do="stop", name="impact")
        """
        event = Event(what, crosses, direction, do, name)
        for source in (what, *(x.on for x in select_impacts(event.do))):
            if isinstance(source, Part):
                self._require_member(str(event.name), source)
            elif isinstance(source, Quantity):
                self._require_members_of(str(event.name), source)
        for switch in select_switches(event.do):
            # Other parts may be added later; assembly checks them.
            for part in switch.parts:
                if part.name in self.parts:
                    self._require_member(str(event.name), part)
        self.events.append(event)
        return event

    def snapshot(self) -> Mechanism:
        """Return a copy of the mechanism in its present state.

        Later changes to the mechanism do not change the copy. The copy refers to the same parts;
        its collections of parts, observables, events and names of inactive parts are read-only.
        """
        other = copy(self)
        other.parts, other.observables = ReadOnlyDict(self.parts), ReadOnlyDict(self.observables)
        collections: Any = tuple(self.events), frozenset(self.inactive)
        other.events, other.inactive = collections
        other.inputs, other.outputs = ReadOnlyDict(self.inputs), ReadOnlyDict(self.outputs)
        return other

    def deactivate(self, *parts: Part) -> None:
        """Make joints and forces inactive until an event activates them; see `Event`.

        Parameters
        ----------
        *parts
            Joints and forces of this mechanism.

        Raises
        ------
        BeamdaeError
            If there is no argument, or an argument is not a part of this mechanism.
        """
        # Imported here: most mechanisms have no events, whose module imports all joints.
        from beamdae.parts.event_actions import name_parts

        name_parts("Mechanism.deactivate", parts)
        for part in parts:
            self._require_member("Mechanism.deactivate", part)
            self.inactive.add(part.name)

    def part(self, name: str) -> Part:
        """Return the part with this name.

        Parameters
        ----------
        name
            Name of the part.

        Raises
        ------
        BeamdaeError
            If no part has this name.
        """
        name = plain_text(name)
        if not isinstance(name, str) or name not in self.parts:
            raise BeamdaeError(
                f"Mechanism: there is no part {short_repr(name)}{suggest(name, self.parts)}; "
                "see mechanism.parts for all parts."
            )
        return self.parts[name]

    def draw(self) -> Any:
        """Draw the mechanism: bodies, joints, supports, springs and loads with their names.

        The drawing shows the reference configuration, even if a different start is requested. Rigid
        bodies are drawn by their shape or, without a shape, by lines between their attachment
        points, or between a single attachment point and the center of mass; beams are drawn along
        their axis, with the heights of their sections if any of these varies (times a factor above
        the drawing if they are too thin to be visible). Arrows of forces show the direction, not
        the magnitude, at t = 0 or, if the force is zero then, at a later time.

        Returns
        -------
        Plot
            The drawing, displayed by a notebook; `Plot.save` writes it to a file.

        Raises
        ------
        BeamdaeError
            If the mechanism has no parts that can be drawn.

        Examples
        --------
        >>> import beamdae as bd
        >>> mech = bd.Mechanism(gravity=(0.0, -9.81))
        >>> bob = mech.add(bd.RigidBody("bob", mass=1.0, inertia=0.1, center=(1.0, 0.0)))
        >>> hinge = mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
        >>> path = mech.draw().save("pendulum.svg")
        """
        return module("report.pictures.drawing").draw(self)

    @property
    def laws(self) -> list[Law]:
        """All time laws of the parts, of gravity and of inputs."""
        part_laws = [law for part in self.parts.values() for law in part.laws]
        gravity_laws = list(self.gravity_laws.laws if self.gravity_laws else ())
        return [*part_laws, *gravity_laws, *self.input_laws.values()]

    @property
    def input_laws(self) -> dict[str, Law]:
        """Laws of the inputs that are not numbers, by name of the input."""
        return {name: x.law for name, x in self.inputs.items() if x.law is not None}

    def require_switched_members(self) -> None:
        """Raise BeamdaeError unless this mechanism contains the parts that its events switch."""
        for event in self.events:
            for switch in select_switches(event.do):
                for part in switch.parts:
                    self._require_member(str(event.name), part)

    def _require_members_of(self, part: str, quantity: Quantity) -> None:
        for piece in quantity.pieces:
            self._require_member(part, piece.owner)
        if quantity.joint is None:
            return
        joint = self.parts.get(quantity.joint)
        # A joint of another mechanism may have the same name.
        if joint is None or quantity.joint_part not in (None, joint):
            raise BeamdaeError(
                f"{part}: the joint {quantity.joint!r} is not part of this mechanism; add "
                "the joint first."
            )

    def _require_member(self, part: str, body: Part) -> None:
        if body is self.ground or self.parts.get(body.name) is body:
            return
        if body.name == self.ground.name:
            raise BeamdaeError(
                f"{part}: the ground belongs to another mechanism; use the ground of this "
                "mechanism."
            )
        raise BeamdaeError(
            f"{part}: {body.name!r} is not part of this mechanism; add this part first, or use "
            "a part of the mechanism."
        )
