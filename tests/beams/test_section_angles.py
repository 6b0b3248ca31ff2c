"""Angles of sections as drawn."""

import numpy as np
import pytest
from mechanisms import clamped_beam, rectangle

import beamdae as bd

SECTION = rectangle(0.01)


@pytest.mark.parametrize("frame", ["tangent", "chord"])
@pytest.mark.parametrize("elements", [2, 4])
@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_section_of_an_arc_is_normal_to_the_curve(formulation, elements, frame):
    # The axis interpolated by two elements of a half circle is 0.03 rad off at its end.
    options = {"formulation": formulation, "frame": frame}
    mech, beam = clamped_beam(SECTION, elements, bd.Arc(1.0, np.pi), name="arc", **options)
    mech.observe("end", beam.end)
    mech.observe("middle", beam.at(1.0))
    columns = bd.equilibrium(mech).columns
    assert columns["end.angle [rad]"][-1] == pytest.approx(np.pi, abs=1e-12)
    assert columns["middle.angle [rad]"][-1] == pytest.approx(1.0, abs=1e-12)
