"""What beams bear as color along them."""

import numpy as np
import pytest
from hub_beam import hub_beam
from numpy.testing import assert_allclose
from pendulum import pendulum

import beamdae as bd
from beamdae.report.scene.beam_colors import compute_beam_colors
from beamdae.report.scene.mechanism_scene import SECTIONS
from beamdae.report.scene.outlines import frame_times

FRAMES = 11


def run(mechanism):
    return bd.simulate(mechanism, bd.GeneralizedAlpha(5e-3), 0.2, output_step=0.02)


@pytest.mark.parametrize("what", ["strain", "stress", "N", "Q", "M"])
def test_colors_are_the_observed_values_along_the_beam(what):
    mechanism = pendulum(elements=2)
    beam = mechanism.part("beam")
    s = beam.length / 4.0
    mechanism.observe("top", getattr(beam, what)(s, "top") if len(what) > 1 else beam.end)
    mechanism.observe("bottom", getattr(beam, what)(s, "bottom") if len(what) > 1 else beam.end)
    mechanism.observe("forces", beam.section_forces(s))
    solution = run(mechanism)
    found = compute_beam_colors("test", solution, what, frame_times(solution, FRAMES))
    here = found.values["beam"][:, (SECTIONS - 1) // 4]
    table = solution.observed
    if len(what) > 1:
        unit = {"strain": "-", "stress": "Pa"}[what]
        expected = table[[f"top [{unit}]", f"bottom [{unit}]"]].abs().max(axis=1)
    else:
        expected = table[next(c for c in table if c.startswith(f"forces.{what} "))]
    scale = np.max(np.abs(expected))
    # Times that agree to rounding, of strains that vibrate.
    assert_allclose(here * found.factor, expected, rtol=0, atol=1e-9 * scale)
    every = np.abs(found.values["beam"])
    assert every.max() <= found.limits[1] * (1.0 + 1e-12)
    assert found.limits[0] == (-found.limits[1] if len(what) == 1 else 0.0)


def test_colors_that_cannot_be_had_are_refused():
    solution = run(hub_beam(elements=1))
    with pytest.raises(bd.BeamdaeError, match="offset 'top' needs the height of the section"):
        solution.animate(color="stress")
    with pytest.raises(bd.BeamdaeError, match=r"animate: color must be .*'strian'"):
        solution.animate(color="strian")
    ball = bd.Mechanism()
    ball.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
    with pytest.raises(bd.BeamdaeError, match="color 'M' is that of beams, the mechanism has none"):
        run(ball).animate(color="M")
