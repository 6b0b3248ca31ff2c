"""Charts of the page in a browser: reading, zooming, hiding, saving."""

import csv
import io
import re
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pages import T, classes, curves, odd_names, place, point, row, seen, study, until

PLOT = "[data-chart={}] .plot"
# Of places that are known to a pixel.
PIXEL = 0.01


def chosen(tab, *numbers):
    """Select cases, and no others."""
    tab.click("#clear")
    for number in numbers:
        row(tab, number).locator("td.label").click()


def test_curves_are_read_at_the_pointer_and_by_keys(show):
    tab = show(study())
    chosen(tab, 2)
    tab.mouse.move(*place(tab, "observed", 1.0, 0.5))
    said = tab.inner_text("#tip").split()
    assert float(said[2]) == pytest.approx(1.0, abs=0.02)
    assert float(said[-1]) == pytest.approx(-1.0, abs=1e-3)
    assert tab.locator("[data-chart=observed] .dot").count() == 1
    tab.locator(PLOT.format("observed")).focus()
    tab.keyboard.press("ArrowRight")
    said = tab.inner_text("#tip").split()
    # A hundredth of the run to the right: what is stored nearest to it is at t = 1.
    assert float(said[2]) == pytest.approx(1.02, abs=0.02)
    assert float(said[-1]) == pytest.approx(-1.0, abs=1e-3)
    for _ in range(50):
        tab.keyboard.press("ArrowRight")
    said = tab.inner_text("#tip").split()
    assert (float(said[2]), float(said[-1])) == (2.0, pytest.approx(1.0, abs=1e-3))
    tab.mouse.move(1, 1)
    tab.locator("#filter").focus()
    assert tab.locator("[data-chart=observed] .dot").count() == 0


def test_the_observed_column_is_chosen_and_kept(show):
    tab = show(study())
    choice = tab.get_by_label("Observed: which")
    assert choice.input_value() == "tip.x [m]"
    choice.select_option("hinge.F [N]")
    for _ in range(2):
        assert tab.locator("[data-panel=observed] .title").nth(1).text_content() == "hinge.F [N]"
        point(tab, 5).click()


def buttons(tab, key):
    return tab.locator(f"[data-chart={key}] .tools button")


def test_buttons_zoom_and_reset(show):
    tab = show(study())
    for key in ("scatter", "observed", "error"):
        whole = seen(tab, key)
        larger, smaller, reset = (buttons(tab, key).nth(k) for k in range(3))
        assert reset.is_disabled()
        larger.click()
        for near, far, log in zip(seen(tab, key), whole, logarithmic(key), strict=True):
            low, high, first, last = (np.log10 if log else np.asarray)([*near, *far])
            assert_allclose([high - low, high + low], [(last - first) / 1.5, last + first])
        smaller.click()
        assert_allclose(seen(tab, key), whole, atol=1e-12)
        smaller.click()
        reset.click()
        assert seen(tab, key) == whole
        assert reset.is_disabled()


def logarithmic(key):
    return {"scatter": (True, True), "error": (False, True)}.get(key, (False, False))


def test_zooming_ends_where_there_is_nothing_more(show):
    tab = show(study())
    for k, least, most in ((0, 1e-4, 2e-4), (1, 2.0, 4.0)):
        tab.locator(PLOT.format("observed")).press("0")
        (first, last), _ = seen(tab, "observed")
        for _ in range(40):
            buttons(tab, "observed").nth(k).click()
        (low, high), _ = seen(tab, "observed")
        assert least <= (high - low) / (last - first) <= most


def test_the_wheel_is_the_pages_until_a_chart_has_the_focus(show):
    tab = show(study())
    tab.mouse.move(*place(tab, "observed", 0.5, 0.0))
    whole, at = seen(tab, "observed"), tab.evaluate("scrollY")
    tab.mouse.wheel(0, 10)
    until(tab, f"scrollY > {at}")
    assert seen(tab, "observed") == whole
    tab.mouse.move(*place(tab, "observed", 0.5, 0.0))
    at = tab.evaluate("scrollY")
    tab.locator(PLOT.format("observed")).focus()
    tab.mouse.wheel(0, -100)
    until(tab, "state.views.observed.x !== null")
    (begin, end), (low, high) = seen(tab, "observed")
    # About the pointer.
    shrunk = np.exp(-0.25)
    assert_allclose([begin, end], [0.5 - 0.5 * shrunk, 0.5 + 1.5 * shrunk], atol=PIXEL)
    assert_allclose([low, high], np.array([-1.1, 1.1]) * shrunk, atol=PIXEL)
    assert tab.evaluate("scrollY") == at


def test_the_wheel_with_control_zooms_beside_an_axis_along_it_alone(show):
    tab = show(study())
    below = place(tab, "observed", 1.0, -1.25)
    tab.mouse.move(*below)
    tab.keyboard.down("Control")
    tab.mouse.wheel(0, -100)
    tab.keyboard.up("Control")
    until(tab, "state.views.observed.x !== null")
    assert tab.evaluate("state.views.observed.y") is None
    assert_allclose(seen(tab, "observed")[0], 1.0 + np.array([-1, 1]) * np.exp(-0.25), atol=PIXEL)


def dragged(tab, start, end):
    tab.mouse.move(*start)
    tab.mouse.down()
    tab.mouse.move(*np.mean([start, end], axis=0))
    tab.mouse.move(*end)
    tab.mouse.up()


def test_dragging_moves_and_a_double_click_shows_all(show):
    tab = show(study())
    whole = seen(tab, "observed")
    dragged(tab, place(tab, "observed", 1.0, 0.0), place(tab, "observed", 0.5, 0.5))
    (begin, end), (low, high) = seen(tab, "observed")
    assert_allclose([begin, end, low, high], [0.5, 2.5, -1.6, 0.6], atol=PIXEL)
    tab.mouse.dblclick(*place(tab, "observed", 1.0, 0.0))
    assert seen(tab, "observed") == whole


def test_shift_and_dragging_zooms_into_a_box(show):
    tab = show(study())
    start, end = place(tab, "observed", 0.5, 0.5), place(tab, "observed", 1.0, -0.5)
    tab.keyboard.down("Shift")
    tab.mouse.move(*start)
    tab.mouse.down()
    tab.mouse.move(*end)
    assert tab.locator(".zoom-box").count() == 1
    tab.mouse.up()
    tab.keyboard.up("Shift")
    assert_allclose(seen(tab, "observed"), [(0.5, 1.0), (-0.5, 0.5)], atol=PIXEL)
    assert tab.locator(".zoom-box").count() == 0


def test_a_drag_that_ends_on_a_point_selects_nothing(show):
    tab = show(study())
    before = tab.locator("tr.selected").count()
    box = point(tab, 2).bounding_box()
    start = np.array([box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])
    dragged(tab, start, [start[0] + 60.0, start[1] + 20.0])
    assert tab.locator("tr.selected").count() == before
    assert_allclose(point(tab, 2).bounding_box()["x"], box["x"] + 60.0, atol=1.0)
    point(tab, 2).click()
    assert tab.locator("tr.selected").count() == before + 1


def test_keys_zoom_move_and_reset(show):
    tab = show(study())
    whole = seen(tab, "observed")
    tab.locator(PLOT.format("observed")).focus()
    tab.keyboard.press("+")
    assert_allclose(seen(tab, "observed")[0], [1 / 3, 5 / 3])
    tab.keyboard.press("Shift+ArrowRight")
    assert_allclose(seen(tab, "observed")[0], np.array([1 / 3, 5 / 3]) + 2 / 15)
    tab.keyboard.press("-")
    tab.keyboard.press("0")
    assert seen(tab, "observed") == whole


def test_a_point_keeps_the_focus_while_keys_zoom(show):
    tab = show(study())
    point(tab, 2).focus()
    tab.keyboard.press("+")
    assert tab.evaluate("document.activeElement.dataset.case") == "case 2"


def test_all_panels_show_the_same_time(show):
    tab = show(study())
    buttons(tab, "observed").first.click()
    times = [seen(tab, key)[0] for key in ("observed", "error", "energy", "drift")]
    assert_allclose(times, [[1 / 3, 5 / 3]] * 4)
    buttons(tab, "drift").nth(2).click()
    assert seen(tab, "observed")[0] == (0.0, 2.0)
    # Each keeps what it shows of its own values.
    assert tab.evaluate("state.views.observed.y") is not None


def test_a_view_stays_when_cases_are_added_and_goes_with_another_quantity(show):
    tab = show(study())
    buttons(tab, "observed").first.click()
    near = seen(tab, "observed")
    row(tab, 5).locator("td.label").click()
    assert seen(tab, "observed") == near
    tab.get_by_label("Observed: which").select_option("hinge.F [N]")
    times, values = seen(tab, "observed")
    assert times == near[0]
    assert values[0] > 4.0


def test_lines_differ_by_color_dashes_and_marks(show):
    tab = show(study())
    chosen(tab, 2, 1, 5, 4)
    panel = tab.locator("[data-panel=observed]")
    lines = [tuple(c.split()[1:]) for c in classes(panel.locator("path.curve"))]
    assert len(lines) == 4
    assert len({line[1:] for line in lines}) == 4
    marks = panel.locator(".line-mark")
    # Six on each.
    assert marks.count() == 24
    shapes = [marks.nth(k).get_attribute("d") for k in range(24)]
    assert len(set(shapes)) == 4
    chosen(tab, 2)
    assert panel.locator(".line-mark").count() == 0


def test_legends_hide_and_show(show):
    tab = show(study())
    chosen(tab, 2, 5)
    tab.get_by_role("button", name="Ida(rtol=0.001)", exact=False).and_(
        tab.locator(".switch")
    ).click()
    assert tab.locator("[data-panel=observed] path.curve").count() == 1
    assert row(tab, 2).locator("input").is_checked()
    switch = tab.locator("#chosen .switch").first
    assert switch.get_attribute("aria-pressed") == "false"
    # It has the focus still.
    tab.keyboard.press("Enter")
    assert tab.locator("[data-panel=observed] path.curve").count() == 2
    tab.get_by_role("button", name="1 Ida(rtol=0.001), remove").click()
    assert not row(tab, 2).locator("input").is_checked()
    families = tab.locator("#families .switch")
    assert families.all_inner_texts() == ["Ida", "GeneralizedAlpha"]
    families.first.click()
    assert tab.locator(".run").count() == 2
    assert tab.locator("#table tbody tr:visible").count() == 7
    families.first.click()
    assert tab.locator(".run").count() == 6


def test_all_curves_of_a_unit_are_shown_together(show):
    page = study()
    page["cases"] = page["cases"][:2]
    for one in page["cases"]:
        one["curves"]["observed"] = {
            "a [m]": T.tolist(),
            "b [m]": (2 * T).tolist(),
            "c [N]": T.tolist(),
        }
    tab = show(page)
    choice = tab.get_by_label("Observed: which")
    assert choice.locator("option").all_inner_texts() == ["a [m]", "b [m]", "c [N]", "all in m"]
    choice.select_option("all in m")
    panel = tab.locator("[data-panel=observed]")
    colors = [c.split()[1] for c in classes(panel.locator(".plot path.curve"))]
    assert colors == ["color-0", "color-1"]
    panel.locator(".switch", has_text="b [m]").click()
    assert panel.locator(".plot path.curve").count() == 1
    chosen(tab, 1, 2)
    # Two runs: colors are theirs, dashes those of names.
    panel.locator(".switch", has_text="b [m]").click()
    looks = [c.split()[1:] for c in classes(panel.locator(".plot path.curve"))]
    assert [len(look) for look in looks] == [1, 2, 1, 2]
    assert looks[0] != looks[2]


def test_the_difference_to_the_reference_is_shown_for_what_has_one(show):
    tab = show(study())
    chosen(tab, 5)
    panel = tab.locator("[data-panel=observed]")
    panel.get_by_label("difference to the reference").check()
    assert panel.locator(".title").nth(1).text_content() == "difference of tip.x [m]"
    # -2e-3 t.
    low, high = seen(tab, "observed")[1]
    assert_allclose([low, high], [-4.2e-3, 0.2e-3], rtol=1e-4)
    tab.get_by_label("Observed: which").select_option("hinge.F [N]")
    assert "difference to the reference" in panel.locator(".empty").inner_text()
    panel.get_by_label("difference to the reference").uncheck()
    assert panel.locator("path.curve").count() == 1
    assert tab.locator("[data-panel=drift] input").count() == 0


def test_cases_are_drawn_by_any_two_numbers(show):
    page = study()
    page["columns"] += [{"key": "speed", "label": "speed", "unit": "m/s", "kind": "number"}]
    for k, one in enumerate(page["cases"]):
        one["values"]["speed"] = 2.0 + k
    tab = show(page)
    tab.get_by_label("x axis").select_option("speed [m/s]")
    assert tab.inner_text("#precision h2") == "Error over speed"
    assert_allclose(seen(tab, "scatter")[0], [2.0 - 0.25, 7.0 + 0.25])
    tab.get_by_label("y axis").select_option("steps")
    # No errors, no limit of them.
    assert tab.locator("#precision .resolution").count() == 0
    assert tab.locator(".run.hollow").count() == 0
    point(tab, 1).hover()
    assert "speed [m/s]\t3" in tab.inner_text("#tip")


def test_a_page_may_say_what_cases_are_drawn_by_first(show):
    page = study() | {"axes": {"x": "error", "y": "steps"}}
    tab = show(page)
    assert tab.inner_text("#precision h2") == "steps over error"


def saved(tab, key, kind):
    with tab.expect_download() as download:
        buttons(tab, key).filter(has_text=kind).click()
    return download.value


def test_charts_are_saved_as_numbers(show, tmp_path):
    tab = show(study())
    chosen(tab, 2, 5)
    tab.locator("#chosen .switch").first.click()
    file = saved(tab, "observed", "CSV")
    assert file.suggested_filename.endswith("_tip.x_m_.csv")
    head, *rows = csv.reader(io.StringIO(file.path().read_text()))
    assert head == ["case", "quantity", "t [s]", "value"]
    # What is hidden is not saved.
    assert {r[0] for r in rows} == {"GeneralizedAlpha(step=0.002)"}
    assert_allclose([float(r[3]) for r in rows], np.cos(np.pi * T), atol=2e-5)
    head, *rows = csv.reader(io.StringIO(saved(tab, "scatter", "CSV").path().read_text()))
    assert head == ["case", "wall time [s]", "error", "below what the reference resolves"]
    assert rows[0] == ["Ida(rtol=0.001)", "0.1", "0.001", "no"]
    assert rows[2] == ["Ida(rtol=1e-07)", "3", "0.000001", "yes"]
    assert len(rows) == 6


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_charts_are_saved_as_pictures_of_their_own(opened, scheme):
    tab = opened(study(), color_scheme=scheme)
    chosen(tab, 2, 5)
    text = saved(tab, "observed", "SVG").path().read_text()
    root = ElementTree.fromstring(text)
    words = ["".join(one.itertext()) for one in root.iter() if one.tag.endswith("text")]
    # The legend says which is which.
    for said in ("tip.x [m]", "t [s]", "Ida(rtol=0.001)", "GeneralizedAlpha(step=0.002)"):
        assert said in words
    # Colors of paper, in the file itself, also from a dark screen.
    assert "rgb(0, 114, 178)" in text
    assert "var(" not in text
    assert tab.evaluate("document.documentElement.className") == ""
    image = saved(tab, "scatter", "PNG").path().read_bytes()
    assert image[:8] == b"\x89PNG\r\n\x1a\n"
    width, _ = (int.from_bytes(image[k : k + 4]) for k in (16, 20))
    assert width == 2 * round(tab.evaluate("state.charts.get('scatter').box.width"))


def test_names_of_users_are_saved_whatever_they_are(show):
    page = odd_names()
    tab = show(page)
    chosen(tab, 2)
    choice = tab.get_by_label("Observed: which")
    # Letters that XML has no room for, and those it would take for its own.
    for k in (5, 7, 8):
        choice.select_option(index=k)
        ElementTree.fromstring(saved(tab, "observed", "SVG").path().read_text())
        rows = list(csv.reader(io.StringIO(saved(tab, "observed", "CSV").path().read_text(), "")))
        assert {len(row) for row in rows} == {4}
    assert saved(tab, "observed", "PNG").path().stat().st_size > 1000


def test_a_failed_run_has_its_cross_and_no_more(show):
    page = study()
    page["cases"][6]["curves"] = curves(7e-3, T[:20])
    tab = show(page)
    chosen(tab, 3, 2)
    panel = tab.locator("[data-panel=observed]")
    ends = [
        float(re.findall(r"[\d.]+", t)[0])
        for t in panel.locator(".line-mark").evaluate_all(
            "all => all.map((one) => one.getAttribute('transform'))"
        )[:6]
    ]
    assert len(ends) == 6
    assert panel.locator("path.curve").count() == 3
