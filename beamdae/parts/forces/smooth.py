"""Functions for formulas of forces: of numbers, arrays and symbols alike."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from beamdae.errors import BeamdaeError, require_positive, short_repr


def positive_part(x: Any) -> Any:
    """The larger of x and 0, of a number, an array or a symbol; its slope jumps at 0.

    `positive_part(x)**n` has n - 1 continuous derivatives: forces that push alone are made of it.

    Raises
    ------
    BeamdaeError
        If x is none of these.

    Examples
    --------
    >>> import numpy as np
    >>> import beamdae as bd
    >>> bd.positive_part(np.array([-1.0, 2.0]))
    array([0., 2.])
    """
    x = _value("positive_part", x)
    return ca.fmax(x, 0.0) if isinstance(x, ca.SX) else np.maximum(x, 0.0)


def smooth_sign(x: Any, scale: Any) -> Any:
    """The sign of x, tanh(x / scale): it reaches 0.96 of a sign at x = 2 `scale`.

    Raises
    ------
    BeamdaeError
        If x is no number, array or symbol, or `scale` neither a positive number nor a symbol.
    """
    x = _value("smooth_sign", x)
    if not isinstance(scale, ca.SX):
        scale = require_positive("smooth_sign", "scale", scale)
    symbolic = isinstance(x, ca.SX) or isinstance(scale, ca.SX)
    return ca.tanh(x / scale) if symbolic else np.tanh(x / scale)


def _value(name: str, x: Any) -> Any:
    if isinstance(x, ca.SX):
        return x
    try:
        values = np.asarray(x)
        numeric = values.dtype.kind in "fiu"
    except Exception:  # Whatever an array cannot be made of.
        numeric = False
    if not numeric:
        raise BeamdaeError(
            f"{name}: x must be a number, an array of numbers or a symbol of the formula, "
            f"got {short_repr(x)}."
        )
    return np.asarray(values, float)[()]
