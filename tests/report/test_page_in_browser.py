"""Pages in a browser: tables, selection and the motion of the mechanism."""

import re

import numpy as np
import pytest
from mechanisms import hinged_beam, rectangle
from numpy.testing import assert_allclose
from pages import (
    FAILURE,
    ODD_LABEL,
    ODD_NAMES,
    build_case,
    click_point,
    count_curves,
    find_point,
    find_row,
    list_lines,
    odd_page,
    read_tooltip,
    screen_position,
    study_page,
    visible_labels,
    wait_until,
)

import beamdae as bd
from beamdae.report.scene.run_scene import build_run_scene, export_run_frames, frame_times


def test_page_opens_and_fits_its_window(show):
    tab = show(study_page())
    assert tab.title() == study_page()["title"]
    assert tab.inner_text("h1") == study_page()["title"]
    assert tab.inner_text("#versions") == "beamdae 0.1.0"
    assert tab.inner_text("#reference") == "They agree."
    for width in (1280, 600):
        tab.set_viewport_size({"width": width, "height": 800})
        # Charts follow the size of the window after it has changed.
        wait_until(tab, f"document.documentElement.scrollWidth <= {width}")


def test_points_have_tooltips_and_failures_are_listed(show):
    tab = show(study_page())
    tab.mouse.move(*find_point(tab, 4))
    tooltip = read_tooltip(tab)
    for text in ("GeneralizedAlpha(step=0.001)", "5.00e-4", "0.4 s", "10000"):
        assert text in tooltip
    unplotted = tab.inner_text("#unplotted")
    assert "Failed, not drawn: 1" in unplotted
    assert f"Radau(rtol=1e-06) limited {FAILURE}" in " ".join(unplotted.split())


def test_unresolved_errors_are_hollow_points_at_the_resolution(show):
    tab = show(study_page())
    assert "resolution of the reference: 1.0e-6" in tab.inner_text("#precision")
    tab.mouse.move(*find_point(tab, 0))
    assert "at most 1.0e-6" in read_tooltip(tab)
    fills = tab.evaluate("""state.charts.get("scatter").spec.series
        .filter(({type}) => type === "scatter")
        .flatMap(({data, color, itemStyle}) =>
            data.map((point) => [point[2], itemStyle.color ?? color]))""")
    # The hollow point lies above the filled one.
    assert dict(fills)["case 0"] == "#ffffff"
    assert dict(fills)["case 2"] == "#0072b2"


def describe_series(tab):
    """Return color, dashes and the ends of the lines between the points of the scatter plot."""
    return tab.evaluate("""state.charts.get("scatter").spec.series
        .filter(({type, data}) => type === "line" && data.length)
        .map(({color, lineStyle, data}) =>
            [color, lineStyle.type !== "solid", data.map(([x]) => x)])""")


def test_lines_join_the_cases_of_a_series(show):
    blue, orange = "#0072b2", "#e69f00"
    # Two lines between the three points of Ida, dashed where one is unresolved; one of
    # GeneralizedAlpha.
    assert describe_series(show(study_page())) == [
        [blue, False, [0.1, 1.5, None]],
        [blue, True, [1.5, 3.0, None]],
        [orange, False, [0.2, 0.4, None]],
    ]


def test_lines_and_labels_follow_the_ranks(show):
    """A finer run stays between its neighbors even if it is less accurate."""
    page = study_page()
    page["cases"] = [
        build_case(k, f"Ida(rtol={label})", error, cost, rank=rank, group=page["groups"][0]["id"])
        for k, (label, error, cost, rank) in enumerate(
            [("1e-05", 1e-3, 1.0, 1), ("0.001", 1e-2, 0.1, 0), ("1e-06", 3e-3, 10.0, 2)]
        )
    ]
    tab = show(page)
    assert [x for *_, x in describe_series(tab)] == [[0.1, 1.0, None, 1.0, 10.0, None]]
    tab.get_by_role("button", name="case", exact=True).click()
    assert visible_labels(tab) == ["Ida(rtol=0.001)", "Ida(rtol=1e-05)", "Ida(rtol=1e-06)"]


def test_rows_are_sorted_by_number_with_failures_last(show):
    tab = show(study_page())
    labels = {int(c["id"].split()[1]): c["label"] for c in study_page()["cases"]}
    order = {1: [0, 1, 2, 4, 5, 6, 3], -1: [6, 5, 4, 2, 1, 0, 3]}
    header = tab.get_by_role("button", name="steps", exact=True)
    for direction, name in ((1, "ascending"), (-1, "descending")):
        header.click()
        assert visible_labels(tab) == [labels[k] for k in order[direction]]
        assert tab.locator("th[aria-sort]:has-text('steps')").get_attribute("aria-sort") == name
    tab.get_by_role("button", name="case", exact=True).click()
    assert visible_labels(tab)[-1] == labels[3]
    assert visible_labels(tab)[1:3] == [labels[4], labels[5]]


def test_the_filter_hides_rows(show):
    tab = show(study_page())
    for words, count in (("alpha", 2), ("ida note", 4), ("newton CONVERGE", 1), ("nothing", 0)):
        tab.fill("#filter", words)
        assert len(visible_labels(tab)) == count
        assert tab.inner_text("#count") == f"{count} of 7 cases"
    tab.fill("#filter", "")
    assert len(visible_labels(tab)) == 7


def test_rows_of_a_long_table_are_created_when_they_are_seen_found_or_printed(show):
    page = study_page()
    page["cases"] += [
        build_case(k, f"Ida(rtol={k})", 1e-3, 1.0, curves=None, values={"steps": k})
        for k in range(10, 360)
    ]
    tab = show(page)
    rows = tab.locator("#table tbody tr")
    assert rows.count() == 100
    assert tab.inner_text("#count") == "357 of 357 cases"
    tab.evaluate("table.closest('.scroll').scrollTop = 1e6")
    wait_until(tab, "table.tBodies[0].rows.length === 200")
    # The filter and sorting include rows that have not been created.
    tab.fill("#filter", "rtol=359")
    assert visible_labels(tab) == ["Ida(rtol=359)"]
    rows.first.locator("td.label").click()
    tab.fill("#filter", "")
    assert rows.count() == 100
    tab.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert rows.count() == 357
    assert tab.locator("tr.selected").count() == 8
    assert len(set(tab.locator("#table tbody td.label").all_inner_texts())) == 357


def test_clicks_select_cases_and_draw_their_curves(show):
    tab = show(study_page())
    # Initially, the curves of all cases are drawn.
    assert count_curves(tab) == [7, 7, 7, 7]
    tab.get_by_role("button", name="Clear the selection").click()
    assert tab.locator(".panel").count() == 0
    assert "Select cases" in tab.inner_text("#panels")
    click_point(tab, 2)
    assert count_curves(tab) == [1, 1, 1, 1]
    find_row(tab, 5).locator("td.label").click()
    find_row(tab, 1).locator("input").press("Space")
    assert count_curves(tab) == [3, 3, 3, 3]
    assert tab.locator("tr.selected .badge").all_text_contents() == ["1", "3", "2"]
    # Selected cases are colored by their number.
    colors = [color for _, color, _ in list_lines(tab)]
    assert colors == ["#0072b2", "#e69f00", "#009e73"]
    click_point(tab, 2)
    assert count_curves(tab) == [2, 2, 2, 2]
    assert not find_row(tab, 2).locator("input").is_checked()


def test_points_are_reached_and_selected_by_keys(show):
    tab = show(study_page())
    tab.click("#clear")
    tab.locator("[data-chart=scatter] .plot").focus()
    tab.keyboard.press("Enter")  # No point is reached yet.
    # From left to right.
    for label in (ODD_LABEL, "Ida(rtol=0.001)", "GeneralizedAlpha(step=0.002)"):
        tab.keyboard.press("ArrowRight")
        assert label in tab.locator("#reading").text_content()
    top = screen_position(tab, "scatter", 0.2, 2e-3)[1]
    tab.keyboard.press("Space")
    assert find_row(tab, 5).locator("input").is_checked()
    assert count_curves(tab) == [1, 1, 1, 1]
    # The key does not scroll: the point stays where it is in the window.
    assert screen_position(tab, "scatter", 0.2, 2e-3)[1] == pytest.approx(top, abs=1.0)
    assert tab.evaluate("document.activeElement.closest('.chart').dataset.chart") == "scatter"


def test_a_group_without_errors_curves_and_animation(show):
    tab = show(study_page())
    tab.select_option("#group", "rod()")
    assert visible_labels(tab) == ["Ida(rtol=0.01)", "Radau(rtol=0.01)"]
    assert tab.inner_text("#reference") == "Reference not accepted. They do not agree."
    placeholders = " ".join(tab.locator(".empty").all_inner_texts())
    for text in ("No case of this model has both", "No animation", "No case of this model has c"):
        assert text in placeholders
    assert "No consistent start" in tab.inner_text("#unplotted")
    assert "Without error or wall time, not drawn: 1" in tab.inner_text("#unplotted")
    assert not tab.locator("#player").is_visible()


SINGLE_CASE = build_case(0, "Ida", 1e-3, 1.0, group="a")


@pytest.mark.parametrize(
    ("page", "text"),
    [
        ({}, "This study has no cases."),
        ({"groups": [{"id": "a"}]}, "This study has no cases."),
        (
            {"groups": [{"id": "a"}], "cases": [{"id": "0", "group": "a"}]},
            "No case of this model has curves.",
        ),
        (
            {"groups": [{"id": "a"}], "columns": study_page()["columns"], "cases": [SINGLE_CASE]},
            "1 of 1 cases",
        ),
    ],
    ids=["empty", "no cases", "minimal case", "one case"],
)
def test_pages_with_missing_entries(show, page, text):
    assert text in show(page).inner_text("main")


def test_odd_names_are_shown(show):
    tab = show(odd_page())
    assert tab.title().startswith("u16")
    assert visible_labels(tab)
    choice = tab.get_by_label("Observed: quantity")
    for k in range(len(ODD_NAMES)):
        choice.select_option(index=k)
        assert list_lines(tab)
    first = tab.locator("#table tr[data-case='case 2'] td").all_inner_texts()
    # The only odd column with a value is u16: inherited properties of JavaScript are no values.
    assert [text for text in first[-len(ODD_NAMES) :] if text != "\N{EN DASH}"] == ["u16"]


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
