"""Reference frames of a beam: on its start section ("tangent") or from end to end ("chord")."""

from __future__ import annotations

import numpy as np

from beamdae.curves.plane_curves import PlaneCurve
from beamdae.errors import BeamdaeError, require_choice

# Distances between the ends of a curve, relative to the length of the curve.
_MIN_DEFAULT_CHORD = 0.1  # for smaller distances, "tangent" is the default frame
_MIN_CHORD = 1e-6  # for smaller distances, the direction of the chord is undefined


def chord_vector(curve: PlaneCurve) -> np.ndarray:
    """Return the vector from the start to the end of a curve [m], shape (2,)."""
    ends = np.asarray(curve.point(np.array([0.0, curve.length])), float)
    return ends[1] - ends[0]


def has_chord(curve: PlaneCurve) -> bool:
    """Return True if the ends are far enough apart for "chord" to be the default frame."""
    return bool(np.hypot(*chord_vector(curve)) >= _MIN_DEFAULT_CHORD * curve.length)


def resolve_frame(part: str, curve: PlaneCurve, frame: str | None) -> str:
    """Return `frame`, or the default frame of the curve if `frame` is None.

    Raises
    ------
    BeamdaeError
        If `frame` is neither None, "tangent" nor "chord".
    """
    if frame is None:
        return "chord" if has_chord(curve) else "tangent"
    return str(require_choice(part, "frame", frame, ("tangent", "chord")))


def compute_frame_angle(part: str, curve: PlaneCurve, frame: str) -> float:
    """Return the angle of the frame in the reference configuration [rad].

    Raises
    ------
    BeamdaeError
        If `frame` is "chord" and the ends of the curve coincide.
    """
    if frame == "tangent":
        return float(curve.tangent_angle(0.0))
    chord = chord_vector(curve)
    if np.hypot(*chord) < _MIN_CHORD * curve.length:
        raise BeamdaeError(
            f"{part}: frame 'chord' requires a curve with separate ends; use "
            "frame='tangent' for a closed curve."
        )
    return float(np.arctan2(chord[1], chord[0]))
