"""Specification of a steady rotation of a whole mechanism: `bd.rotation`."""

from __future__ import annotations

from dataclasses import dataclass

from beamdae.errors import require_finite, require_point


@dataclass(frozen=True)
class Rotation:
    """Steady rotation at `speed` [rad/s] about the point `center` [m]; see `rotation`."""

    speed: float
    center: tuple[float, float] = (0.0, 0.0)


def rotation(speed: float, center: tuple[float, float] = (0.0, 0.0)) -> Rotation:
    """Specify a steady rotation of the whole mechanism, for `modes`, `linearize` and starts.

    The ground is a turntable: joints to the ground rotate with it, and drivers keep their value at
    the time `t` of the analysis. Coordinates refer to the corotating frame, so that frequencies are
    as measured by a strain gauge on the mechanism. Forces must rotate with the mechanism: weight,
    loads of fixed direction, and springs and dampers attached to the ground away from the center
    are rejected.

    As `start` of a mechanism, of `simulate` or `periodic`, all bodies turn at this speed, and beams
    are stretched and bent as in the steady rotation. Drivers must turn at the same speed. Forces
    that do not rotate, such as weight, act as at the start.

    Parameters
    ----------
    speed
        Angular speed [rad/s], positive counterclockwise.
    center
        Center of rotation (x, y) in the reference configuration [m].

    Returns
    -------
    Rotation
        Rotation to pass as `about` or `start`.

    Raises
    ------
    BeamdaeError
        If `speed` is not a finite number, or `center` is not a pair of finite numbers.

    Examples
    --------
    >>> import beamdae as bd
    >>> bd.rotation(6.0)
    Rotation(speed=6.0, center=(0.0, 0.0))
    """
    return Rotation(
        require_finite("rotation", "speed", speed), require_point("rotation", "center", center)
    )
