"""The animation on a page and in a notebook, in a browser."""

import re

import numpy as np
import pytest
from mechanisms import hinged_beam, rectangle
from numpy.testing import assert_allclose
from pages import study_page, wait_until

import beamdae as bd
from beamdae.report.scene.run_scene import build_run_scene, export_run_frames, frame_times


def bar_ends(tab, k):
    """Return first and last point of a drawn bar: its initial position (0) or the frame (1)."""
    path = tab.locator("#stage .body.beam").nth(k).get_attribute("d")
    numbers = np.array(re.findall(r"-?[\d.]+", path), float).reshape(-1, 2)
    return numbers[[0, -1]]


def test_the_animation_has_equal_scales_and_a_slider(show):
    tab = show(study_page())
    assert tab.locator("#stage title").all_text_contents()[-3:] == ["ground", "bar", "bob"]
    (hinge, start), (_, initial) = bar_ends(tab, 1), bar_ends(tab, 0)
    assert_allclose(start, initial)
    tab.locator("#frame").fill("20")
    assert tab.inner_text("#time") == "t = 0.5 s"
    _, end = bar_ends(tab, 1)
    # 90 degrees counter-clockwise, with coordinates rounded to 0.1 pixels.
    arm = start - hinge
    assert arm[0] > 100.0
    assert_allclose(end - hinge, [arm[1], -arm[0]], atol=0.3)


def test_the_animation_plays_until_paused(show):
    tab = show(study_page())
    # An installed clock runs until it is paused.
    tab.clock.install(time=0)
    tab.clock.pause_at(3600)
    before = bar_ends(tab, 1)
    # The initial speed is the one that plays the 0.5 s in about 6 s.
    assert tab.locator("#speed").input_value().endswith(" 0.1")
    tab.click("#play")
    tab.clock.run_for(2000)
    assert tab.inner_text("#play") == "Pause"
    # 2 s show 0.2 s of the run; a frame lasts 0.025 s.
    assert int(tab.locator("#frame").input_value()) == pytest.approx(8, abs=1)
    assert not np.allclose(bar_ends(tab, 1), before)
    tab.click("#play")
    frame = tab.locator("#frame").input_value()
    tab.clock.run_for(1000)
    assert tab.locator("#frame").input_value() == frame
    tab.click("#play")
    tab.clock.run_for(3500)
    # It starts again after 5 s.
    assert int(tab.locator("#frame").input_value()) == pytest.approx(2, abs=1)


@pytest.fixture(scope="module")
def swing():
    """Return a run of a curved pendulum with a spring and of a rolling wheel, and its frames."""
    section = rectangle(0.01)
    mech, beam = hinged_beam(
        section, 1, bd.Arc(radius=1.0, length=1.0, start=(0.0, 0.0)), gravity=9.81
    )
    wheel = mech.add(bd.RigidBody("wheel", 1.0, 0.01, (-1.0, 0.2), velocity=(1.0, 0.0)))
    mech.add(bd.RollingOnLine("roll", mech.ground.at(-1.0, 0.0), wheel.at(-1.0, 0.2), 0.2))
    mech.add(bd.Spring("leg", mech.ground.at(0.8, -1.0), beam.end, 50.0, 1.0))
    mech.add(bd.Moment("twist", wheel.at(-1.0, 0.2), lambda t: 0.01 * (0.2 - t)))
    solution = bd.simulate(mech, bd.Radau(1e-4), t_end=0.4)
    return solution, export_run_frames(solution)


def read_paths(tab, kind):
    """Return the points, (n, 2), of each path of a kind."""
    paths = tab.locator(f"#stage > svg {kind}:not(.initial)").all()
    texts = [path.get_attribute("d") for path in paths]
    return [np.array(re.findall(r"-?[\d.]+", text), float).reshape(-1, 2) for text in texts]


def test_symbols_have_the_positions_of_the_scene(show, swing):
    solution, frames = swing
    tab = show({"groups": [{"id": "a", "frames": frames}], "cases": [{"id": "0", "group": "a"}]})
    tab.locator("#frame").fill("90")
    scene = build_run_scene("test", solution, frame_times(solution))
    points, pixels = [], []
    for kind in ("beam", "spring", "damper", "wheel", "surface", "joint", "load"):
        lines = [line[90] for glyph, line in scene.lines() if glyph.kind.split()[0] == kind]
        drawn = read_paths(tab, f".body.{kind}")
        assert len(drawn) == len(lines) > 0
        for path, line in zip(drawn, lines, strict=True):
            finite = line[np.isfinite(line).all(axis=1)]
            assert len(path) == len(finite)
            points.append(finite)
            pixels.append(path)
    points, pixels = np.concatenate(points), np.concatenate(pixels)
    # The drawing has one scale for both directions and an offset; y points up.
    matrix = np.stack(
        [
            np.concatenate([points[:, 0], -points[:, 1]]),
            np.repeat((1.0, 0.0), len(points)),
            np.repeat((0.0, 1.0), len(points)),
        ],
        axis=1,
    )
    expected = pixels.T.ravel()
    scale_and_offset, *_ = np.linalg.lstsq(matrix, expected)
    assert scale_and_offset[0] > 100.0
    # Coordinates are rounded to 0.1 pixels and stored in 65534 steps.
    assert_allclose(matrix @ scale_and_offset, expected, atol=0.08)


def test_beams_are_colored_by_strain_or_stress(show, swing):
    _, frames = swing
    tab = show({"groups": [{"id": "a", "frames": frames}], "cases": [{"id": "0", "group": "a"}]})
    choice = tab.locator("#color")
    assert choice.locator("option").all_text_contents()[0] == "none"
    titles = [color["title"] for color in frames["colors"]]
    assert choice.locator("option").all_text_contents()[1:] == titles
    uncolored = read_paths(tab, ".body.beam")
    tab.locator("#frame").fill("60")
    choice.select_option(titles[0])
    assert tab.locator("#frame").input_value() == "60"
    pieces = read_paths(tab, ".body.beam")
    assert len(pieces) == len(uncolored[0]) - 1
    values = np.array(frames["colors"][0]["values"]["beam"][60])
    share = 0.5 * (values[1:] + values[:-1]) / frames["colors"][0]["limits"][1]
    colors = tab.locator("#stage .body.beam:not(.initial)").evaluate_all(
        "all => all.map((piece) => piece.style.stroke)"
    )
    rgb = np.array([re.findall(r"\d+", color) for color in colors], float)
    scale = [[int(x[k : k + 2], 16) for k in (1, 3, 5)] for x in frames["colors"][0]["scale"]]
    at = np.linspace(0.0, 1.0, len(scale))
    expected = [np.interp(share, at, channel) for channel in np.transpose(scale)]
    assert_allclose(rgb.T, expected, atol=1.0)
    bar = tab.locator(".color-bar")
    assert bar.get_attribute("aria-label").startswith(titles[0])
    choice.select_option("none")
    assert len(read_paths(tab, ".body.beam")) == 1
    assert bar.count() == 0


@pytest.mark.parametrize("width", [1366, 390])
def test_notebooks_show_a_player_without_scroll_bars(browser, tmp_path, swing, width):
    solution, _ = swing
    animation = solution.animate(speed=0.25, color="stress", frames=11)
    path = tmp_path / "notebook.html"
    path.write_text(f"<!DOCTYPE html><body>{animation._repr_html_()}</body>", encoding="utf-8")
    tab = browser.new_page(viewport={"width": width, "height": 800})
    messages = []
    tab.on("console", lambda message: messages.append(message.text))
    tab.on("pageerror", lambda error: messages.append(str(error)))
    tab.goto(path.as_uri())
    player = tab.frame_locator("iframe")
    assert player.locator("#play").inner_text() == "Pause"
    assert player.locator("#speed").input_value().endswith(" 0.25")
    assert player.locator("#color").input_value() == "largest stress [MPa]"
    wait_until(tab, "document.querySelector('iframe').contentDocument.body.scrollHeight > 0")
    excess_height = "f => f.contentDocument.documentElement.scrollHeight - f.clientHeight"
    assert abs(tab.locator("iframe").evaluate(excess_height)) <= 1
    excess_width = "f => f.contentDocument.documentElement.scrollWidth - f.clientWidth"
    assert tab.locator("iframe").evaluate(excess_width) <= 0
    player.locator("#play").click()
    player.locator("#frame").fill("10")
    assert player.locator("#time").inner_text() == "t = 0.4 s"
    assert messages == []
    tab.close()
