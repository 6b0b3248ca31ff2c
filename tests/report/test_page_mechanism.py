"""The mechanism on the page of a study, in a browser."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pages import study

import beamdae as bd
from beamdae.report.scene.frame_export import export_run_frames
from beamdae.report.scene.run_scene import build_run_scene, frame_times


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
    # Time goes on where a clock is but installed.
    tab.clock.install(time=0)
    tab.clock.pause_at(3600)
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


@pytest.fixture(scope="module")
def swing():
    """A run of a curved pendulum on a spring that stretches and a wheel that turns."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    section = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.01)
    arc = bd.Arc(radius=1.0, length=1.0, start=(0.0, 0.0))
    beam = mech.add(bd.Beam("beam", arc, section, elements=1))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), beam.start))
    wheel = mech.add(bd.RigidBody("wheel", 1.0, 0.01, (-1.0, 0.2), velocity=(1.0, 0.0)))
    mech.add(bd.RollingOnLine("roll", mech.ground.at(-1.0, 0.0), wheel.at(-1.0, 0.2), 0.2))
    mech.add(bd.SpringDamper("leg", mech.ground.at(0.8, -1.0), beam.end, 50.0, 1.0))
    mech.add(bd.Moment("twist", wheel.at(-1.0, 0.2), lambda t: 0.01 * (0.2 - t)))
    solution = bd.simulate(mech, bd.Radau(1e-4), t_end=0.4)
    return solution, export_run_frames(solution)


def paths(tab, kind):
    """Points of all paths of a kind, (k, 2) each, one after the other."""
    found = [
        path.get_attribute("d") for path in tab.locator(f"#stage > svg {kind}:not(.start)").all()
    ]
    return [np.array(re.findall(r"-?[\d.]+", path), float).reshape(-1, 2) for path in found]


def test_symbols_are_where_they_are_in_python(show, swing):
    solution, frames = swing
    tab = show({"groups": [{"id": "a", "frames": frames}], "cases": [{"id": "0", "group": "a"}]})
    tab.locator("#frame").fill("90")
    scene = build_run_scene("test", solution, frame_times(solution))
    places, pixels = [], []
    for kind in ("beam", "spring", "damper", "wheel", "surface", "joint", "load"):
        lines = [line[90] for glyph, line in scene.lines() if glyph.kind.split()[0] == kind]
        drawn = paths(tab, f".body.{kind}")
        assert len(drawn) == len(lines) > 0
        for path, line in zip(drawn, lines, strict=True):
            known = line[np.isfinite(line).all(axis=1)]
            assert len(path) == len(known)
            places.append(known)
            pixels.append(path)
    places, pixels = np.concatenate(places), np.concatenate(pixels)
    # One scale for both directions, y upward.
    unknown = np.stack(
        [
            np.concatenate([places[:, 0], -places[:, 1]]),
            np.repeat((1.0, 0.0), len(places)),
            np.repeat((0.0, 1.0), len(places)),
        ],
        axis=1,
    )
    given = pixels.T.ravel()
    found, *_ = np.linalg.lstsq(unknown, given)
    assert found[0] > 100.0
    # Tenths of a pixel, and steps of a 65534th of what is seen.
    assert_allclose(unknown @ found, given, atol=0.08)


def test_beams_are_colored_by_what_they_bear(show, swing):
    _, frames = swing
    tab = show({"groups": [{"id": "a", "frames": frames}], "cases": [{"id": "0", "group": "a"}]})
    choice = tab.locator("#color")
    assert choice.locator("option").all_text_contents()[0] == "none"
    titles = [color["title"] for color in frames["colors"]]
    assert choice.locator("option").all_text_contents()[1:] == titles
    whole = paths(tab, ".body.beam")
    tab.locator("#frame").fill("60")
    choice.select_option(titles[0])
    assert tab.locator("#frame").input_value() == "60"
    levels = paths(tab, ".body.beam")
    assert len(levels) == 24
    # All pieces of the beam, two points each.
    assert sum(map(len, levels)) == 2 * (len(whole[0]) - 1)
    values = np.array(frames["colors"][0]["values"]["beam"][60])
    share = 0.5 * (values[1:] + values[:-1]) / frames["colors"][0]["limits"][1]
    expected = np.bincount(np.clip(24 * share, 0, 23).astype(int), minlength=24)
    # Values at the bound of two levels fall to either.
    assert np.abs(np.array([len(x) // 2 for x in levels]) - expected).sum() <= 2
    bar = tab.locator(".color-bar")
    assert bar.get_attribute("aria-label").startswith(titles[0])
    choice.select_option("none")
    assert len(paths(tab, ".body.beam")) == 1
    assert bar.count() == 0


@pytest.mark.parametrize("width", [1366, 390])
def test_a_notebook_shows_a_player_of_its_own_height(browser, tmp_path, swing, width):
    solution, _ = swing
    shown = solution.animate(speed=0.25, color="stress", frames=11)
    path = tmp_path / "notebook.html"
    path.write_text(f"<!DOCTYPE html><body>{shown._repr_html_()}</body>", encoding="utf-8")
    tab = browser.new_page(viewport={"width": width, "height": 800})
    complaints = []
    tab.on("console", lambda message: complaints.append(message.text))
    tab.on("pageerror", lambda problem: complaints.append(str(problem)))
    tab.goto(path.as_uri())
    inside = tab.frame_locator("iframe")
    assert inside.locator("#play").inner_text() == "Pause"
    assert inside.locator("#speed").input_value().endswith(" 0.25")
    assert inside.locator("#color").input_value() == "largest stress [MPa]"
    tab.wait_for_function("document.querySelector('iframe').contentDocument.body.scrollHeight > 0")
    high = "f => f.contentDocument.documentElement.scrollHeight - f.clientHeight"
    assert abs(tab.locator("iframe").evaluate(high)) <= 1
    wide = "f => f.contentDocument.documentElement.scrollWidth - f.clientWidth"
    assert tab.locator("iframe").evaluate(wide) <= 0
    inside.locator("#play").click()
    inside.locator("#frame").fill("10")
    assert inside.locator("#time").inner_text() == "t = 0.4 s"
    assert complaints == []
    tab.close()
