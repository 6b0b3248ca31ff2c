"""Forces on points: their statements, and their loads, values and power as observables."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError
from beamdae.parts.forces.load_observables import POWER
from beamdae.parts.point_parts import FORCE, MOMENT, PointPart
from beamdae.symbolic.statements import (
    SX,
    ForceKernel,
    ForceStatement,
    Local,
    Quantity,
    Variable,
    rebuilt_for_mesh,
)

# Kernel of a force, and values that can be observed, by name.
ForceFormula = Callable[..., tuple[ForceKernel, Mapping[str, SX]]]


@dataclass(frozen=True)
class _Kernel:
    formula: ForceFormula

    def __call__(self, *arguments: Any) -> ForceKernel:
        return self.formula(*arguments)[0]


class _GeneralizedForce(_Kernel):
    def __call__(self, *arguments: Any) -> Any:
        return super().__call__(*arguments).force


class _Power(_Kernel):
    def __call__(self, local: Local, *arguments: Any) -> Any:
        return -ca.dot(super().__call__(local, *arguments).force, local.v)


@dataclass(frozen=True)
class _Values:
    formula: ForceFormula
    names: tuple[str, ...]

    def __call__(self, *arguments: Any) -> SX:
        _, values = self.formula(*arguments)
        return ca.vertcat(*(values[name] for name in self.names))


class PointForce(PointPart):
    """Force on points, given by a formula of their motion.

    A subclass defines `points` and `_formula`; statements and observables follow.
    """

    @property
    def _formula(self) -> ForceFormula:
        """Function (local, points, *other functions) of a `PointFormula`."""
        raise NotImplementedError

    @property
    def _joint(self) -> Any:
        """Joint on whose reactions the force depends."""
        return None

    @property
    def _observed_points(self) -> tuple[str, ...]:
        """Names of the points to which `force` and `moment` refer; by default the last one."""
        return tuple(self.points)[-1:]

    @property
    def _generalized_force(self) -> Callable[..., SX]:
        return _GeneralizedForce(self._formula)

    @property
    def _source(self) -> dict[str, Any]:
        joint, load = self._joint, {"load_of": self.name}
        return load if joint is None else {**load, "joint": joint.name, "joint_part": joint}

    def forces(self, gravity: np.ndarray) -> list[ForceStatement]:
        """Return the forces on all points as one statement."""
        joint, build = self._joint, _Kernel(self._formula)
        multipliers = () if joint is None else joint.multipliers
        kernel, data = self._build_kernel(build, self._functions, len(multipliers))
        name = None if joint is None else joint.name
        return [ForceStatement(self.name, kernel, self._pieces, data, name)]

    def _observe_values(self, columns: Mapping[str, Variable]) -> Quantity:
        """Return values of the formula as a quantity, with columns by their names."""
        build = _Values(self._formula, tuple(columns))
        return self._observe(build, tuple(columns.values()))

    @property
    @rebuilt_for_mesh
    def power(self) -> Quantity:
        """Power [W] of all forces of the part, the rate of the work done on the mechanism.

        In the energy balance, its integral is the work of loads minus the dissipated energy and the
        increase of the strain energy of the part.
        """
        return self._observe(_Power(self._formula), (POWER,))

    @rebuilt_for_mesh
    def load_on(self, place: str, axes: str = "inertial") -> Quantity:
        """Return force Fx, Fy [N] and moment M [N m] on the body of a point, acting at this point.

        The load on a particle has no moment.

        Parameters
        ----------
        place
            Name of the point: "a" or "b" for elements between two points and friction, "point" or
            "surface" for a contact, "on" for a load at one point, "reaction_on" for the second body
            of a moment, "1", "2", ... for a force law with several attachments.
        axes
            "inertial", or "body" for axes that rotate with the body (or with the section of a
            beam); in the reference configuration, these are the inertial axes.

        Raises
        ------
        BeamdaeError
            If `place` is not the name of a point, or `axes` is invalid.
        """
        return self._observe_load(place, axes)

    @property
    @rebuilt_for_mesh
    def force(self) -> Quantity:
        """Force Fx, Fy [N] on the loaded body, in the inertial frame.

        With several loaded points, the columns are Fx1, Fy1, Fx2, ...
        """
        return self._observe_components((0, 1), FORCE, self._observed_points)

    @property
    @rebuilt_for_mesh
    def moment(self) -> Quantity:
        """Moment M [N m] on the loaded body about the loaded point, counter-clockwise.

        With several loaded points that have an angle, the columns are M1, M2, ...

        Raises
        ------
        BeamdaeError
            If the part acts on particles only, which have no angle.
        """
        points = {place: self.points[place] for place in self._observed_points}
        places = tuple(place for place, point in points.items() if point.has_angle)
        if not places:
            first = next(iter(points.values()))
            raise BeamdaeError(
                f"{self.name}: {first} is a particle without an angle, so there is no moment on "
                "it; observe the force."
            )
        return self._observe_components((2,), (MOMENT,), places)

    def _observe_components(
        self, rows: tuple[int, ...], columns: tuple[Variable, ...], places: tuple[str, ...]
    ) -> Quantity:
        is_numbered = len(self._observed_points) > 1
        names = [(place if is_numbered else "", x) for place in places for x in columns]
        numbered = tuple(Variable(f"{x.name}{number}", x.unit) for number, x in names)
        return self._observe_loads(dict.fromkeys(places, rows), numbered)
