"""How large a drawing is, wherever and however turned it is drawn."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def extent_of(points: Array) -> float:
    """The largest distance between two of the points (k, 2); 0 of none."""
    if not len(points):
        return 0.0
    # Those far from the middle first: beyond the first ones nothing is as far from anything.
    far = np.hypot(*(points - points.mean(axis=0)).T)
    found = 0.0
    for k in np.argsort(-far):
        if far[k] + far.max() <= found:
            break
        found = max(found, float(np.max(np.hypot(*(points - points[k]).T))))
    return found
