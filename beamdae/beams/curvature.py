"""How sharply a beam is curved for its elements and its section, and what it is warned of."""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np

from beamdae.beams.mesh import Mesh
from beamdae.beams.sections import Section
from beamdae.beams.varying_section import VaryingSection
from beamdae.errors import BeamdaeWarning

# Curvature times element length at which the compliance of an arc is off by 1 %, by nodes and
# straight ones (measured: 6e-3 at 1.6, of order 4; 9e-5 at 0.4, of order 4; 8e-3 at 0.2, of order
# 2; see tests/beams/test_castigliano.py).
_MOST_OF_ELEMENT = {4: 1.6, 3: 1.2, 2: 0.2}
_MOST_STRAIGHT = 0.2
# Curvature times height at which the bending stiffness of a rectangle (Winkler & Bach's over
# EI, 1 + 0.15 (h/R)^2) is off by 1 %; the stress at the inner surface is by h / (3 R), 8 %.
_MOST_OF_HEIGHT = 0.26


def curvature_facts(mesh: Mesh, section: Section | VaryingSection) -> Mapping[str, float]:
    """Largest curvature times the length of an element, and times the height of the section."""
    s = mesh.gauss_arc_lengths(mesh.nodes)
    curvature = np.abs(mesh.curve.curvature(s))
    length = mesh.curve.length / mesh.elements
    found = {"largest curvature times element length": float(curvature.max()) * length}
    heights = (
        np.full(len(s), section.height, float)
        if isinstance(section, Section)
        else np.array([section.at(x).height for x in s.tolist()], float)
    )
    if not np.isnan(heights).any():
        found["largest curvature times section height"] = float(np.max(curvature * heights))
    return found


def warn_of_curvature(part: str, mesh: Mesh, section: Section | VaryingSection) -> None:
    """Warn where elements or a section are too large for the curvature of a beam."""
    by_length, *by_height = curvature_facts(mesh, section).values()
    straight = mesh.shape == "straight"
    most = _MOST_STRAIGHT if straight else _MOST_OF_ELEMENT[mesh.nodes]
    if by_length > most:
        enough = int(np.ceil(mesh.elements * by_length / most))
        sentence = (
            f"{part}: its curve turns by {by_length:.2g} rad within an element, more than the "
            f"{most:g} rad at which deflections are off by 1 %; take elements={enough} or more."
        )
        warnings.warn(sentence, BeamdaeWarning, stacklevel=3)
    if by_height and by_height[0] > _MOST_OF_HEIGHT:
        sentence = (
            f"{part}: its section is {by_height[0]:.2g} times as high as the radius of its curve, "
            f"where the bending stiffness of beams is off by {0.15 * by_height[0] ** 2:.1%} and "
            f"the stress at the inner surface by {by_height[0] / 3.0:.0%}."
        )
        warnings.warn(sentence, BeamdaeWarning, stacklevel=3)
