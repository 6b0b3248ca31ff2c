"""Functions for formulas of forces: of numbers, arrays and symbols alike."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np


def positive_part(x: Any) -> Any:
    """The larger of x and 0, of a number, an array or a symbol; its slope jumps at 0.

    `positive_part(x)**n` has n - 1 continuous derivatives: forces that push alone are made of it.
    """
    return ca.fmax(x, 0.0) if isinstance(x, ca.SX) else np.maximum(x, 0.0)


def smooth_sign(x: Any, scale: float) -> Any:
    """The sign of x, tanh(x / scale): it reaches 0.96 of a sign at x = 2 `scale`."""
    return ca.tanh(x / scale) if isinstance(x, ca.SX) else np.tanh(x / scale)
