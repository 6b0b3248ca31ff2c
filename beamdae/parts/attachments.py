"""Attachments: material points of bodies, to which joints, loads and observables refer."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from beamdae.errors import (
    BeamdaeError,
    as_text,
    format_exception,
    read_attribute,
    require_choice,
    require_finite,
    require_point,
    set_fields,
    short_repr,
)
from beamdae.read_only import read_only_data
from beamdae.symbolic.formula import Formula
from beamdae.symbolic.statements import SX, Piece

_MAX_CACHED_POINTS = 1000  # of an outline whose size is cached


@read_only_data
@dataclass(frozen=True, eq=False, repr=False)
class Attachment:
    """Material point of a body, defined by its position in the reference configuration.

    Attributes
    ----------
    body
        Part to which the point belongs.
    point
        Position (x, y) in the reference configuration [m].
    inclination
        Angle of the section or body at the point in the reference configuration [rad].
    operator
        Sparse matrix (l, n) that maps the n coordinates of the body to the l local coordinates of
        the point.
    kinematics
        Function of the local coordinates that returns (position in the inertial frame [m], rotation
        from the reference configuration [rad]). If it is a `Formula`, joints, loads and observables
        at points of the same kind share one kernel.
    has_angle
        False for a particle.
    s
        Arc length [m] of the section of a beam; None for other points.

    Raises
    ------
    BeamdaeError
        If `body` has no name, `point` is not a pair of numbers, a number is not finite,
        `has_angle` is not a bool, `operator` is not a sparse matrix, or `kinematics` is not a
        function.
    """

    body: Any
    point: tuple[float, float]
    inclination: float
    operator: sp.csr_array
    kinematics: Callable[[SX], tuple[SX, SX]]
    has_angle: bool = True
    s: float | None = None

    def __post_init__(self) -> None:
        name = as_text(read_attribute(self.body, "name"))
        if name is None:
            raise BeamdaeError(f"Attachment: body must be a part, got {short_repr(self.body)}.")
        set_fields(
            self,
            point=require_point(name, "point", self.point),
            inclination=require_finite(name, "inclination", self.inclination),
            has_angle=require_choice(name, "has_angle", self.has_angle, (True, False)),
        )
        if self.s is not None:
            set_fields(self, s=require_finite(name, "s", self.s))
        if not sp.issparse(self.operator) or self.operator.ndim != 2:
            raise BeamdaeError(
                f"{name}: the operator of an attachment must be a SciPy sparse matrix, "
                f"got {short_repr(self.operator)}."
            )
        if not callable(self.kinematics):
            raise BeamdaeError(
                f"{name}: the kinematics of an attachment must be a function of the "
                f"local coordinates, got {short_repr(self.kinematics)}."
            )

    @property
    def size(self) -> int:
        """Number of local coordinates."""
        return self.operator.shape[0]

    @property
    def piece(self) -> Piece:
        """Local coordinates of the point as a `Piece` of a statement."""
        return Piece(self.body, self.operator, self.s)

    @property
    def checked_kinematics(self) -> Callable[[SX], tuple[SX, SX]]:
        """The kinematics; if a user function fails, the error message names the attachment."""
        return self.kinematics if isinstance(self.kinematics, Formula) else self._evaluate

    def position(self, q: SX) -> SX:
        """Return the position (x, y) in the inertial frame [m].

        Parameters
        ----------
        q
            Local coordinates of the point, (l,).

        Raises
        ------
        BeamdaeError
            If the call of `kinematics` fails or does not return two values.
        """
        return self._evaluate(q)[0]

    def rotation(self, q: SX) -> SX:
        """Return the rotation from the reference configuration [rad].

        Parameters
        ----------
        q
            Local coordinates of the point, (l,).

        Raises
        ------
        BeamdaeError
            If the call of `kinematics` fails or does not return two values.
        """
        return self._evaluate(q)[1]

    def _evaluate(self, q: SX) -> tuple[SX, SX]:
        try:
            position, rotation = self.kinematics(q)
        except Exception as problem:
            raise BeamdaeError(
                f"{self}: kinematics must return a position and a rotation, but the "
                f"call failed: {format_exception(problem)}."
            ) from problem
        return position, rotation

    def __repr__(self) -> str:
        return f"{self.body.name} at ({self.point[0]:.6g}, {self.point[1]:.6g})"


def require_attachment(part: str, name: str, value: Any) -> Attachment:
    """Return `value` if it is an attachment, or raise BeamdaeError."""
    if not isinstance(value, Attachment):
        raise BeamdaeError(
            f"{part}: {name} must be an attachment such as beam.end, got {short_repr(value)}"
            f"{suggest_point(value)}."
        )
    return value


def suggest_point(value: Any) -> str:
    """Return the advice to pass a point of a body, or "" for other values."""
    syntax = as_text(read_attribute(value, "point_syntax"))
    name = as_text(read_attribute(value, "name"))
    return f"; pass a point of {name or 'it'}: {syntax}" if syntax else ""


def require_angle(part: str, attachment: Attachment) -> None:
    """Raise BeamdaeError if an attachment is a particle, which has no angle."""
    if not attachment.has_angle:
        raise BeamdaeError(
            f"{part}: {attachment} is a particle without an angle; use a rigid body or a "
            "beam section."
        )


def require_movable(part: str, name: str, value: Any) -> Attachment:
    """Return `value` if it is an attachment that can move, so that a load has an effect on it."""
    if not require_attachment(part, name, value).size:
        raise BeamdaeError(
            f"{part}: {value} belongs to the ground; choose an attachment on a body that can move."
        )
    return value


def require_direction(part: str, name: str, value: Any) -> tuple[float, float]:
    """Return `value` as floats (x, y), or raise BeamdaeError if it is not a nonzero vector."""
    direction = require_point(part, name, value)
    if np.hypot(*direction) == 0.0:
        raise BeamdaeError(f"{part}: {name} must not be zero, got (0, 0).")
    return direction


def normalize(direction: tuple[float, float]) -> tuple[float, float]:
    """Return the unit vector (x, y) of a direction."""
    x, y = np.divide(direction, np.hypot(*direction)).tolist()
    return x, y


def left_normal(direction: tuple[float, float]) -> tuple[float, float]:
    """Return the unit vector to the left of a direction."""
    x, y = normalize(direction)
    return -y, x


def rotate(angle: Any, vector: Any) -> SX:
    """Return the vector (x, y), rotated counter-clockwise by `angle` [rad], as a column."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(c * vector[0] - s * vector[1], s * vector[0] + c * vector[1])


def measure_extent(bodies: Iterable[Any], attached: Iterable[Any] = ()) -> float:
    """Return the largest distance [m] between points of a drawing; 0 without points.

    Parameters
    ----------
    bodies
        Parts whose outlines count.
    attached
        Parts whose attachments count, such as joints and springs.
    """
    outlines = [np.reshape(x.outline, (-1, 2)) for x in bodies]
    points = [np.reshape(x.point, (1, 2)) for part in attached for x in part.attachments]
    return largest_distance(np.concatenate([np.zeros((0, 2)), *outlines, *points]))


def largest_distance(points: np.ndarray) -> float:
    """Return the largest distance [m] between two of `points` (k, 2) [m]; 0 without points."""
    if len(points) > _MAX_CACHED_POINTS:
        return _largest_distance(points)
    # Models are often built again with the same outlines.
    return _cached_largest_distance(np.asarray(points, float).tobytes())


@lru_cache(maxsize=256)
def _cached_largest_distance(points: bytes) -> float:
    return _largest_distance(np.frombuffer(points).reshape(-1, 2))


def _largest_distance(points: np.ndarray) -> float:
    if not len(points):
        return 0.0
    # Points far from the center first: the search ends once no remaining pair can be farther apart.
    radius = np.hypot(*(points - points.mean(axis=0)).T)
    largest, largest_radius = 0.0, radius.max()
    for k in np.argsort(-radius):
        if radius[k] + largest_radius <= largest:
            break
        largest = max(largest, float(np.max(np.hypot(*(points - points[k]).T))))
    return largest
