"""Colors along beams equal the observed values."""

import re

import numpy as np
import pytest
from hub_beam import hub_beam
from numpy.testing import assert_allclose
from pendulum import pendulum
from test_animation import simulate

import beamdae as bd
from beamdae.report.scene.beam_colors import available_colors
from beamdae.report.scene.mechanism_scene import MAX_BEAM_SECTIONS
from beamdae.report.scene.run_scene import frame_times

FRAMES = 11


@pytest.mark.parametrize("what", ["strain", "stress", "N", "Q", "M"])
def test_colors_equal_the_observed_values_along_the_beam(what):
    mechanism = pendulum(elements=2)
    beam = mechanism.part("beam")
    s = beam.length / 4.0
    mechanism.observe("top", getattr(beam, what)(s, "top") if len(what) > 1 else beam.end)
    mechanism.observe("bottom", getattr(beam, what)(s, "bottom") if len(what) > 1 else beam.end)
    mechanism.observe("forces", beam.section_forces(s))
    solution = simulate(mechanism)
    colors = available_colors(solution, frame_times(solution, FRAMES), what)[0]
    values = colors.values["beam"][:, (MAX_BEAM_SECTIONS - 1) // 4]
    table = solution.observed
    if len(what) > 1:
        unit = {"strain": "-", "stress": "Pa"}[what]
        expected = table[[f"top [{unit}]", f"bottom [{unit}]"]].abs().max(axis=1)
    else:
        expected = table[next(c for c in table if c.startswith(f"forces.{what} "))]
    scale = np.max(np.abs(expected))
    # Rounding of the times, amplified by the rates of vibrating strains.
    prefix = re.search(r"\[(10[⁻⁰-⁹]+|[nµmkMG])?", colors.title)[1]
    factor = {None: 1.0, "m": 1e-3, "k": 1e3, "M": 1e6, "10⁻³": 1e-3, "10⁻⁶": 1e-6}[prefix]
    assert_allclose(values * factor, expected, rtol=0, atol=1e-9 * scale)
    sizes = np.abs(colors.values["beam"])
    assert sizes.max() <= colors.limits[1] * (1.0 + 1e-12)
    assert colors.limits[0] == (-colors.limits[1] if len(what) == 1 else 0.0)


def test_unavailable_colors_are_rejected():
    solution = simulate(hub_beam(elements=1))
    with pytest.raises(bd.BeamdaeError, match="offset 'top' requires the height of the section"):
        solution.animate(color="stress")
    with pytest.raises(bd.BeamdaeError, match=r"animate: color must be .*'strian'"):
        solution.animate(color="strian")
    ball = bd.Mechanism()
    ball.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0)))
    with pytest.raises(
        bd.BeamdaeError, match="color 'M' requires a beam, but the mechanism has none; omit color"
    ):
        simulate(ball).animate(color="M")
