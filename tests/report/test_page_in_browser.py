"""The page of a study in a browser."""

import pytest
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
