"""The mechanism on the page of a study, in a browser."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pages import study


def ends(tab, k):
    """First and last point of the moving bar, in pixels of its drawing."""
    path = tab.locator("#stage .body.beam").nth(k).get_attribute("d")
    numbers = np.array(re.findall(r"-?[\d.]+", path), float).reshape(-1, 2)
    return numbers[[0, -1]]


def test_the_animation_has_equal_scales_and_a_slider(show):
    tab = show(study())
    assert tab.locator("#stage title").all_text_contents()[-3:] == ["ground", "bar", "bob"]
    (hinge, start), (_, still) = ends(tab, 1), ends(tab, 0)
    assert_allclose(start, still)
    tab.locator("#frame").fill("20")
    assert tab.inner_text("#time") == "t = 0.5 s"
    _, end = ends(tab, 1)
    # A quarter turn to the left, to rounding to tenths of a pixel.
    arm = start - hinge
    assert arm[0] > 100.0
    assert_allclose(end - hinge, [arm[1], -arm[0]], atol=0.3)


def test_play_moves_the_mechanism_until_paused(show):
    tab = show(study())
    tab.clock.install()
    before = ends(tab, 1)
    # The run of 0.5 s at the speed that comes nearest to 6 s; two seconds of it.
    assert tab.locator("#speed").input_value().endswith(" 0.1")
    tab.click("#play")
    tab.clock.run_for(2000)
    assert tab.inner_text("#play") == "Pause"
    # A frame lasts 0.025 s, a step of the animation 0.0016 s.
    assert int(tab.locator("#frame").input_value()) == pytest.approx(8, abs=1)
    assert not np.allclose(ends(tab, 1), before)
    tab.click("#play")
    frame = tab.locator("#frame").input_value()
    tab.clock.run_for(1000)
    assert tab.locator("#frame").input_value() == frame
    tab.click("#play")
    tab.clock.run_for(3500)
    # It began again after 5 s.
    assert int(tab.locator("#frame").input_value()) == pytest.approx(2, abs=1)
