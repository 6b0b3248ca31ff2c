"""Positive part, smooth sign and checks of friction coefficients, for force formulas."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import (
    BeamdaeError,
    format_distinct,
    require_finite,
    require_positive,
    short_repr,
)
from beamdae.symbolic.scalar_expression import as_scalar
from beamdae.symbolic.signals import as_expression


def positive_part(x: Any) -> Any:
    """Return max(x, 0) of a number, an array or a symbol; its slope jumps at 0.

    `positive_part(x)**n` has n - 1 continuous derivatives and suits one-sided forces.

    Parameters
    ----------
    x
        A number, an array of any shape or a symbol.

    Returns
    -------
    float, ndarray or SX
        The values, with the shape of `x`.

    Raises
    ------
    BeamdaeError
        If `x` is not a number, an array of numbers or a symbol.

    Examples
    --------
    >>> import numpy as np
    >>> import beamdae as bd
    >>> bd.positive_part(np.array([-1.0, 2.0]))
    array([0., 2.])
    """
    x = _require_numeric("positive_part", x)
    return np.maximum(x, 0.0)


def smooth_sign(x: Any, scale: Any) -> Any:
    """Return tanh(x / scale), a smooth sign of `x` that reaches 0.96 at x = 2 scale.

    Parameters
    ----------
    x
        A number, an array of any shape or a symbol.
    scale
        A positive number or a symbol, in the unit of `x`.

    Returns
    -------
    float, ndarray or SX
        The values, with the shape of `x`.

    Raises
    ------
    BeamdaeError
        If `x` is not a number, an array of numbers or a symbol, or `scale` is neither a positive
        number nor a symbol.
    """
    x, scale = _require_numeric("smooth_sign", x), as_expression(scale)
    if not isinstance(scale, ca.SX):
        scale = require_positive("smooth_sign", "scale", scale)
    return np.tanh(x / as_scalar(scale))


def require_stribeck(
    part: str, name: str, kinetic: float, static: Any, stribeck: Any
) -> tuple[float | None, float | None]:
    """Return the static coefficient of friction and the Stribeck velocity [m/s], or None twice.

    Raises
    ------
    BeamdaeError
        If only one of them is given, a number is invalid, or the static coefficient is less than
        the kinetic coefficient, whose argument is called `name`, or combined with zero.
    """
    if (static is None) != (stribeck is None):
        raise BeamdaeError(
            f"{part}: static and stribeck must be given together; pass both or neither."
        )
    if static is None:
        return None, None
    static = require_finite(part, "static", static)
    stribeck = require_positive(part, "stribeck", stribeck)
    if not static >= kinetic > 0.0:
        static_text, kinetic_text = format_distinct(static, kinetic)
        raise BeamdaeError(
            f"{part}: static must be at least {name}, and {name} must be positive, got "
            f"{static_text} and {kinetic_text}."
        )
    return static, stribeck


def _require_numeric(name: str, x: Any) -> Any:
    x = as_scalar(as_expression(x))
    if isinstance(x, ca.SX):
        return x
    try:
        values = np.asarray(x)
        is_numeric = values.dtype.kind in "fiu"
    except Exception:  # Conversion of arbitrary objects may raise anything.
        is_numeric = False
    if not is_numeric:
        raise BeamdaeError(
            f"{name}: x must be a number, an array of numbers or a symbol of the formula, "
            f"got {short_repr(x)}."
        )
    return np.asarray(values, float)[()]
