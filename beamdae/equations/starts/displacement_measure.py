"""Size of changes of the coordinates, independent of the orientation of the axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beamdae.equations.equations_of_motion import EquationsOfMotion
from beamdae.equations.starts.rigid_motions import collect_bodies

Array = np.ndarray


@dataclass(frozen=True)
class DisplacementMeasure:
    """Measures displacements: the x and y of a point count as one distance.

    Attributes
    ----------
    scale
        Natural size of each coordinate, (n,).
    point
        Index of the x coordinate of the point each coordinate belongs to, (n,); a coordinate that
        is not one of a point has its own index.
    """

    scale: Array
    point: Array

    @classmethod
    def of(cls, e: EquationsOfMotion) -> DisplacementMeasure:
        """Return the measure for the bodies of these equations."""
        point = np.arange(e.n)
        for body in collect_bodies(e):
            if body.nodes is not None:
                point[body.nodes[:, 1]] = body.nodes[:, 0]
            elif body.place is not None:
                point[body.place[1]] = body.place[0]
        return cls(e.position_scales, point)

    def distances(self, change: Array) -> Array:
        """Return the displacement of each coordinate, or of its point, (n,)."""
        squares = np.bincount(self.point, change**2, len(self.point))
        return np.asarray(np.sqrt(squares)[self.point])

    def farthest(self, change: Array) -> float:
        """Return the largest displacement in natural sizes."""
        return float(np.max(self.distances(change) / self.scale, initial=0.0))
