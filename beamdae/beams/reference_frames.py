"""Frames that ride on a beam: on its start section ("tangent") or from end to end ("chord")."""

from __future__ import annotations

import numpy as np

from beamdae.curves.plane_curves import PlaneCurve
from beamdae.errors import BeamdaeError, require_choice

# Distance of the ends of a curve, over its length, from which on the line between them is a frame.
_MIN_DEFAULT_CHORD = 0.1
# Below it the line between them has no direction.
_MIN_CHORD = 1e-6


def chord_vector(curve: PlaneCurve) -> np.ndarray:
    """From start to end of a curve [m], shape (2,)."""
    ends = np.asarray(curve.point(np.array([0.0, curve.length])), float)
    return ends[1] - ends[0]


def has_chord(curve: PlaneCurve) -> bool:
    """Whether the ends lie far enough apart for a frame from one to the other."""
    return bool(np.hypot(*chord_vector(curve)) >= _MIN_DEFAULT_CHORD * curve.length)


def resolve_frame(part: str, curve: PlaneCurve, frame: str | None) -> str:
    """The frame asked for, or the one a beam on that curve has by default."""
    if frame is None:
        return "chord" if has_chord(curve) else "tangent"
    return str(require_choice(part, "frame", frame, ("tangent", "chord")))


def compute_frame_angle(part: str, curve: PlaneCurve, frame: str) -> float:
    """Angle of the frame in the drawing [rad]."""
    if frame == "tangent":
        return float(curve.tangent_angle(0.0))
    chord = chord_vector(curve)
    if np.hypot(*chord) < _MIN_CHORD * curve.length:
        raise BeamdaeError(
            f"{part}: frame 'chord' needs a curve whose ends lie apart, use frame='tangent' for a "
            "ring."
        )
    return float(np.arctan2(chord[1], chord[0]))
