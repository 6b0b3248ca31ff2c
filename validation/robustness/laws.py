"""Laws of time and curves that are none."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

import beamdae as bd
from robustness.world import World

# Poles, jumps, what is no number from some time on, what grows without bound: T_END is 0.01 s.
LAWS: dict[str, Callable[[Any], Any]] = {
    "pole at the start": lambda t: 1.0 / t,
    "pole at 5 ms": lambda t: 1.0 / (t - 0.005),
    "even pole at 5 ms": lambda t: 1.0 / (t - 0.005) ** 2,
    "logarithm of zero": lambda t: np.log(t),
    "logarithm that ends": lambda t: np.log(0.005 - t),
    "root that ends": lambda t: np.sqrt(0.005 - t),
    "root of a negative number": lambda t: np.sqrt(-1.0 - t),
    "power that ends": lambda t: (0.005 - t) ** 0.3,
    "arc sine that ends": lambda t: np.arcsin(200.0 * t),
    "tangent": lambda t: np.tan(300.0 * t),
    "exp(1e5 t)": lambda t: np.exp(1e5 * t),
    "exp(exp)": lambda t: np.exp(np.exp(1e3 * t)),
    "1e300": lambda t: 1e300,
    "1e300 t": lambda t: 1e300 * t,
    "t**200 from the start": lambda t: (1e3 * t) ** 200,
    "noise": lambda t: np.sin(1e12 * t),
    "fast and large": lambda t: 1e9 * np.sin(1e6 * t),
    "if": lambda t: 1.0 if t < 0.005 else 0.0,
    "where": lambda t: np.where(t < 0.005, 1.0, 0.0),
    "sign": lambda t: np.sign(t - 0.005),
    "abs": lambda t: abs(t - 0.005),
    "floor": lambda t: np.floor(1e3 * t),
    "heaviside": lambda t: np.heaviside(t - 0.005, 0.0),
    "interpolated": lambda t: np.interp(t, [0.0, 1.0], [0.0, 1.0]),
    "math": lambda t: math.sin(t),
    "float of t": lambda t: float(t),
    "int of t": lambda t: int(t),
    "comparison": lambda t: t < 0.005,
    "complex": lambda t: 1j * t,
    "text": lambda t: "much",
    "list": lambda t: [t],
    "pair": lambda t: (t, t),
    "array": lambda t: np.array([1.0, 2.0]),
    "vector": lambda t: ca.vertcat(t, t),
    "foreign symbol": lambda t: t * ca.SX.sym("x"),
    "MX": lambda t: ca.MX.sym("x"),
    "nan": lambda t: math.nan * t,
    "nothing": lambda t: None,
    "error": lambda t: {}["no such key"],
    "recursion": lambda t: _endless(t),
    "stop": lambda t: _raised(StopIteration()),
}


def _endless(t: Any) -> Any:
    return _endless(t)


def _raised(problem: BaseException) -> Any:
    raise problem


CURVES: dict[str, Callable[[World], Any]] = {
    "function with a pole": lambda w: bd.Curve(lambda x: 1.0 / (x - 0.5), (0.0, 1.0)),
    "function with a jump": lambda w: bd.Curve(lambda x: float(x > 0.5), (0.0, 1.0)),
    "function with a kink": lambda w: bd.Curve(lambda x: abs(x - 0.5), (0.0, 1.0)),
    "function of noise": lambda w: bd.Curve(lambda x: math.sin(1e6 * x), (0.0, 1.0)),
    "vertical tangent": lambda w: bd.Curve(lambda x: math.sqrt(x), (0.0, 1.0)),
    "huge values": lambda w: bd.Curve(lambda x: 1e200 * x * x, (0.0, 1.0)),
    "tiny interval": lambda w: bd.Curve(lambda x: x * x, (0.0, 1e-300)),
    "interval backwards": lambda w: bd.Curve(lambda x: x * x, (1.0, 0.0)),
    "complex function": lambda w: bd.Curve(lambda x: (x - 0.5) ** 0.5, (0.0, 1.0)),
    "points in one place": lambda w: bd.Curve(points=[(0.0, 0.0)] * 5),
    "points back and forth": lambda w: bd.Curve(points=[(0, 0), (1, 0), (0.5, 0), (2, 0)]),
    "points near each other": lambda w: bd.Curve(
        points=[(0, 0), (1, 0), (1 + 1e-15, 0), (2, 0), (3, 1)]
    ),
    "huge points": lambda w: bd.Curve(points=[(0, 0), (1e200, 0), (2e200, 1e200), (3e200, 0)]),
    "points of text": lambda w: bd.Curve(points=["ab", "cd", "ef", "gh"]),
    "closed loop": lambda w: bd.Arc(1.0, 2.0 * math.pi, (0.0, 1.0)),
    "very tight arc": lambda w: bd.Arc(1e-9, 1e-9, (0.0, 1.0)),
    "arc far away": lambda w: bd.Arc(1.0, 1.0, (1e15, 1e15)),
    "line far away": lambda w: bd.Line((1e16, 0.0), (1e16 + 2.0, 0.0)),
    "high parabola": lambda w: bd.Parabola(1.0, 1e9, (0.0, 1.0)),
    "segment of nothing": lambda w: bd.Segment(bd.Arc(1.0, 1.0), 0.5, 0.5 + 1e-17),
    "own curve without a length": lambda w: _OwnCurve(math.nan),
    "own curve of length zero": lambda w: _OwnCurve(0.0),
    "own curve that fails": lambda w: _OwnCurve(1.0),
}


class _OwnCurve:
    """A user's own curve that does not give what is asked for."""

    def __init__(self, length: float) -> None:
        self.length = length

    def point(self, s: Any) -> Any:
        return np.zeros((*np.shape(s), 2)) if self.length == 1.0 else None

    def tangent_angle(self, s: Any) -> Any:
        return np.full(np.shape(s), np.nan)

    def curvature(self, s: Any) -> Any:
        return np.zeros(np.shape(s))
