"""How far changes of the coordinates carry things, however the axes are turned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.rigid_motions import collect_bodies

Array = np.ndarray


@dataclass(frozen=True)
class DisplacementMeasure:
    """Distances of changes of the coordinates: x and y of a point count as one.

    Attributes
    ----------
    scale
        Natural size of each coordinate, (n,).
    point
        The x of the point each coordinate belongs to, (n,); of what is no point itself.
    """

    scale: Array
    point: Array

    @classmethod
    def of(cls, e: EquationsOfMotion) -> DisplacementMeasure:
        """That of the bodies of these equations."""
        point = np.arange(e.n)
        for body in collect_bodies(e):
            if body.nodes is not None:
                point[body.nodes[:, 1]] = body.nodes[:, 0]
            elif body.place is not None:
                point[body.place[1]] = body.place[0]
        return cls(e.position_scales, point)

    def distances(self, change: Array) -> Array:
        """How far each coordinate, or its point, is carried, (n,)."""
        squares = np.bincount(self.point, change**2, len(self.point))
        return np.asarray(np.sqrt(squares)[self.point])

    def farthest(self, change: Array) -> float:
        """The largest of them, in natural sizes."""
        return float(np.max(self.distances(change) / self.scale, initial=0.0))
