"""Quantities that vary along a path of equilibria in place of a load factor."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.smooth_intervals import time_on_branch
from beamdae.equations.starts.reduced_equations import (
    ReducedEquations,
    remove_redundant_constraints,
)
from beamdae.errors import BeamdaeError, as_text, require_finite, short_repr, suggest
from beamdae.model_functions import Model
from beamdae.parts.joints.drivers import Distance, DrivenJoint
from beamdae.parts.laws import as_law
from beamdae.parts.mechanism import Mechanism

Array = np.ndarray

TIME = "t"
# Zeros and ones drop out of formulas. The structure of the equations is that at this share of the
# range, and such values are moved by this share of it.
_ORDINARY_SHARE = 0.3819
_NEGLIGIBLE_OFFSET = 1e-12


@dataclass(frozen=True)
class PathParameter:
    """Quantity that varies along a path: the time, or a value that the numbers of a model contain.

    Attributes
    ----------
    name, unit
        Name and unit of the quantity; "" if the unit is not known.
    begin, end
        Its values at the beginning and at the last target.
    time
        (t, branch) at which laws are evaluated; None if the quantity is the time.
    equations_at
        Function that returns the equations of all parts at a value. They differ in numbers only.
    """

    name: str
    unit: str
    begin: float
    end: float
    time: Array | None
    equations_at: Callable[[float], EquationsOfMotion] = field(repr=False)

    @property
    def header(self) -> str:
        """Header of the column of the quantity."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def time_at(self, value: float) -> Array:
        """Return (t, branch) at a value of the quantity."""
        if self.time is not None:
            return self.time
        return time_on_branch(self.equations_at(value).breakpoints, value)

    def reduce(self, value: float) -> ReducedEquations | None:
        """Return the reduction that removes redundant constraints at a value; None without any."""
        active = self.equations_at(value).initially_active
        return remove_redundant_constraints(active, self.time_at(value))


def quantity_units(source: Any, mechanism: Mechanism | None) -> dict[str, str]:
    """Return the units of the quantities that `over` of `equilibrium` can name; "" if unknown.

    `source` is the model function or the mechanism. Of quantities with the same name, drivers come
    before inputs and parameters, as in `resolve_parameter`.
    """
    units = {TIME: "s"}
    if mechanism is not None:
        for name, part in mechanism.parts.items():
            if isinstance(part, DrivenJoint):
                units[name] = "m" if isinstance(part, Distance) else part.inputs[0].unit
        for name, signal in mechanism.inputs.items():
            units.setdefault(name, signal.unit)
    if isinstance(source, Model):
        for name, parameter in source.parameter_info.items():
            units.setdefault(name, parameter.unit)
    return units


def resolve_parameter(
    source: Any, equations: EquationsOfMotion, over: str, begin: Any, end: float, t: float
) -> PathParameter:
    """Return the parameter that `over` of `equilibrium` names.

    `source` is the model function or the mechanism, `begin` the value at which the path begins, or
    None for that of the model, and `end` its last value.

    Raises
    ------
    BeamdaeError
        If the name is unknown, or the quantity cannot vary continuously.
    """
    first = None if begin is None else require_finite("equilibrium", "from_", begin)
    name = as_text(over) or ""
    if name == TIME:
        return PathParameter(TIME, "s", first or 0.0, end, None, lambda _: equations)
    mechanism = equations.mechanism
    units = quantity_units(source, mechanism)
    parameters = source.parameters if isinstance(source, Model) else {}
    rebuild: Callable[[float], Any]
    drawn, is_affine = 0.0, True
    if mechanism is not None and isinstance(part := mechanism.parts.get(name), DrivenJoint):
        if isinstance(part, Distance):
            drawn = float(np.hypot(*np.subtract(part.b.point, part.a.point)))
        rebuild = partial(_prescribe, mechanism, part)
    elif mechanism is not None and name in mechanism.inputs:
        signal = mechanism.inputs[over]
        drawn = signal.default if signal.law is None else signal.law.at(t)
        rebuild = lambda value: mechanism.with_inputs({over: value})  # noqa: E731
    elif name in parameters:
        drawn, is_affine = parameters[over], False
        if not isinstance(drawn, float):
            raise BeamdaeError(
                f"equilibrium: over={over!r} must name a parameter that is a decimal number, but "
                f"its default is {short_repr(drawn)}; choose another one, or write its default as "
                "a decimal number."
            )
        rebuild = lambda value: source(**{over: value})  # noqa: E731
    else:
        raise BeamdaeError(
            "equilibrium: over must be 't' or the name of a driver, an input or a parameter of the "
            f"model, got {short_repr(over)}{suggest(over, units)}; use one of {', '.join(units)}."
        )
    first = drawn if first is None else first
    equations_at = _vary_numbers(rebuild, over, (first, end), is_affine)
    time = time_on_branch(equations.breakpoints, t)
    return PathParameter(over, units[over].strip("-"), first, end, time, equations_at)


def _prescribe(mechanism: Mechanism, driver: DrivenJoint, value: float) -> Mechanism:
    """Return the mechanism with a driver that has a constant value."""
    law: dict[str, Any] = {"law": value}
    if isinstance(driver, Distance):
        law = {"length": as_law(driver.name, value)}
    moved = copy(mechanism)
    moved.parts = {**mechanism.parts, driver.name: replace(driver, **law)}
    return moved


def _vary_numbers(
    rebuild: Callable[[float], Any], over: str, ends: tuple[float, float], is_affine: bool
) -> Callable[[float], EquationsOfMotion]:
    """Return the function from values to equations, which must differ in numbers only.

    `is_affine` is True if these numbers depend linearly on the value.
    """
    first, last = ends
    size = (last - first) or 1.0
    structure = equations_of_motion(rebuild(first + _ORDINARY_SHARE * size)).structure

    def build(value: float) -> EquationsOfMotion:
        for offset in (0.0, _NEGLIGIBLE_OFFSET * size):
            varied = equations_of_motion(rebuild(value + offset))
            if varied.structure is structure:
                break
        else:
            raise BeamdaeError(
                f"equilibrium: over={over!r} changes more than numbers of the model between "
                f"{first:g} and {value:g}, such as elements or joints, and the path cannot follow "
                "this; compute single equilibria instead."
            )
        return varied

    if not is_affine:
        return lru_cache(maxsize=4)(build)
    begin = build(first)
    slope = (build(first + size).p - begin.p) / size

    def move(value: float) -> EquationsOfMotion:
        return replace(begin, p=begin.p + (value - first) * slope, mechanism=rebuild(value))

    return lru_cache(maxsize=4)(move)
