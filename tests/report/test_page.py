"""The page of a study: what is stored in it, and what a browser makes of it."""

from __future__ import annotations

import base64
import json
import math
import re
import shutil
from copy import deepcopy

import numpy as np
import pytest
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.report.page.page import write_page

T = np.linspace(0.0, 2.0, 41)
RESOLVED = 1e-6
ODD = '</script><b>"it\'s" & <!-- Ida(rtol=0.01)'
SENTENCE = "Newton did not converge at t = 1.2 s"


def curves(error, t=T):
    return {
        "t": t.tolist(),
        "observed": {
            "tip.x [m]": np.cos(np.pi * t).tolist(),
            "hinge.F [N]": (5.0 + error * t).tolist(),
        },
        "error": (error * t / 2.0).tolist(),
        "energy": {"kinetic": (t**2).tolist(), "imbalance": (-error * t).tolist()},
        "position drift": [1e-12] * len(t),
        "velocity drift": [1e-10] * len(t),
    }


def case(number, label, error, cost, group="bar", **more):
    return {
        "id": f"case {number}",
        "group": group,
        "label": label,
        "family": label.partition("(")[0],
        "series": label.partition("(")[0],
        "status": "ok",
        "values": {"steps": 10**number, "note": f"note {number}"},
        "error": error,
        "cost": cost,
        "below": False,
        "limited": False,
        "curves": None if error is None else curves(error),
    } | more


def bar(frames=21):
    """A bar of 2 m that turns by a quarter, hinged at (0, 0), with a bob at its end."""
    angle = np.linspace(0.0, 0.5 * np.pi, frames)
    x, y = 2.0 * np.cos(angle), 2.0 * np.sin(angle)
    zero, halves = np.zeros(frames), np.array([0.0, 0.5, 1.0])
    bodies = {
        "ground": ("ground", zero[:, None], zero[:, None]),
        "bar": ("beam", x[:, None] * halves, y[:, None] * halves),
        "bob": ("point", x[:, None], y[:, None]),
    }
    return {
        "t": np.linspace(0.0, 0.5, frames).tolist(),
        "bodies": [
            {"name": name, "kind": kind, "x": x.tolist(), "y": y.tolist()}
            for name, (kind, x, y) in bodies.items()
        ],
    }


def study():
    known = {
        "methods": ["Radau(rtol=1e-7)", "GeneralizedAlpha(step=0.0001)"],
        "uncertainty": RESOLVED,
        "accepted": True,
        "sentence": "They agree.",
    }
    refused = known | {"uncertainty": None, "accepted": False, "sentence": "They do not agree."}
    number = {"unit": "", "kind": "number"}
    return {
        "title": f"Study {ODD}",
        "subtitle": "nine cases",
        "made": {"beamdae": "0.1.0"},
        "notes": ["Errors are relative."],
        "groups": [
            {"id": "bar", "label": "bar()", "reference": known, "frames": bar()},
            {"id": "rod", "label": "rod()", "reference": refused, "frames": None},
        ],
        "columns": [
            {"key": "steps", "label": "steps", **number},
            {"key": "note", "label": "note", "unit": "", "kind": "text"},
            {"key": "status", "label": "status", "unit": "", "kind": "status"},
        ],
        "cases": [
            case(2, "Ida(rtol=0.001)", 1e-3, 0.10),
            case(1, "Ida(rtol=1e-05)", 1e-5, 1.50),
            case(0, "Ida(rtol=1e-07)", 1e-8, 3.00, below=True),
            case(5, "GeneralizedAlpha(step=0.002)", 2e-3, 0.20),
            case(4, "GeneralizedAlpha(step=0.001)", 5e-4, 0.40),
            case(6, ODD, 1e-2, 0.05, family="Ida"),
            case(3, "Radau(rtol=1e-06)", 7e-3, 0.30, status=SENTENCE, limited=True),
            case(7, "Ida(rtol=0.01)", None, 0.20, group="rod"),
            case(8, "Radau(rtol=0.01)", None, None, group="rod", status="No consistent start"),
        ],
    }


def stored(path):
    """The data in a file, with packed lists as lists."""
    (text,) = re.findall(
        r'<script type="application/json" id="data">(.*?)</script>', path.read_text(), re.DOTALL
    )
    return json.loads(text, object_hook=unpacked)


def unpacked(value):
    if "u16" not in value:
        return value
    codes = np.frombuffer(base64.b64decode(value["u16"]), "<u2")
    numbers = value["low"] + value["step"] * codes
    numbers = np.where(codes == 65535, math.nan, 10.0**numbers if value["log"] else numbers)
    return numbers


def test_what_is_written_is_read_again(tmp_path):
    page = study()
    before = deepcopy(page)
    path = write_page(tmp_path / "new" / "page.html", page)
    assert page == before
    data = stored(path)
    for name in ("title", "subtitle", "made", "notes", "columns"):
        assert data[name] == page[name]
    for one, given in zip(data["cases"], page["cases"], strict=True):
        assert one | {"curves": None, "series": None} == given | {"curves": None, "series": None}
    read, given = data["cases"][0]["curves"], page["cases"][0]["curves"]
    # Half of a 65534th of the range.
    assert_allclose(read["t"], T, rtol=0, atol=2.0 / 65534 / 2)
    for name, values in given["observed"].items():
        assert_allclose(read["observed"][name], values, rtol=0, atol=np.ptp(values) / 65534 / 2)
    frames = data["groups"][0]["frames"]
    assert [(b["name"], b["kind"], b["points"]) for b in frames["bodies"]] == [
        ("ground", "ground", 1),
        ("bar", "beam", 3),
        ("bob", "point", 1),
    ]
    places = np.array(page["groups"][0]["frames"]["bodies"][1]["x"])
    assert_allclose(frames["bodies"][1]["x"].reshape(-1, 3), places, atol=2.0 / 65534 / 2)


def test_errors_keep_their_digits_over_many_decades(tmp_path):
    error = [0.0, 1e-15, 3e-9, 2.5e-2]
    page = study()
    page["cases"] = [case(0, "Ida", 1.0, 1.0, curves={"t": [0, 1, 2, 3], "error": error})]
    read = stored(write_page(tmp_path / "page.html", page))["cases"][0]["curves"]["error"]["error"]
    assert math.isnan(read[0])
    # Half a step of 13 decades / 65534, times ln 10.
    assert_allclose(read[1:], error[1:], rtol=13.4 / 65534 / 2 * math.log(10))


def test_missing_and_infinite_numbers(tmp_path):
    odd = [1.0, math.nan, None, math.inf, -math.inf, 3.0]
    page = study()
    page["cases"] = [
        case(0, "Ida", math.nan, math.inf, curves={"t": [*range(6)], "observed": {"x": odd}})
        | {"values": {"steps": -math.inf}},
        case(1, "Ida", 1.0, 1.0, curves={"t": [0, 1], "observed": {"x": [None, math.nan]}}),
    ]
    one, other = stored(write_page(tmp_path / "page.html", page))["cases"]
    assert (one["error"], one["cost"], one["values"]["steps"]) == (None, None, None)
    assert_allclose(one["curves"]["observed"]["x"], [1.0, *[math.nan] * 4, 3.0])
    assert np.isnan(other["curves"]["observed"]["x"]).all()


def test_a_constant_is_stored_exactly(tmp_path):
    drift = [0.1] * 3
    page = study()
    page["cases"] = [case(0, "Ida", 1.0, 1.0, curves={"t": [0, 1, 2], "observed": {"x": drift}})]
    read = stored(write_page(tmp_path / "page.html", page))["cases"][0]["curves"]
    assert read["observed"]["x"].tolist() == drift


def test_no_name_ends_the_data_and_nothing_is_loaded(tmp_path):
    text = write_page(tmp_path / "page.html", study()).read_text()
    assert text.count("</script>") == 2
    assert "<b>" not in text
    assert f"<title>{study()['title']}</title>" not in text
    # The namespace of SVG is a name, not an address.
    assert set(re.findall(r"https?://[^\s\"']*", text)) == {"http://www.w3.org/2000/svg"}
    assert not re.search(r"\b(src|href)\s*=|@import|url\((?!#)", text)


def test_placeholders_in_names_stay(tmp_path):
    page = study() | {"title": "{{script}} {{data}}"}
    path = write_page(tmp_path / "page.html", page)
    assert stored(path)["title"] == page["title"]
    assert "<title>{{script}} {{data}}</title>" in path.read_text()


def test_sixty_cases_of_two_hundred_points_are_far_less_than_a_megabyte(tmp_path):
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 1.0, 200).tolist()

    def noise(*names):
        return {name: rng.standard_normal(200).tolist() for name in names}

    drawn = {
        "t": t,
        "observed": noise(*"abcdefgh"),
        "energy": noise("kinetic", "strain", "imbalance"),
        **noise("error", "position drift", "velocity drift"),
    }
    page = study()
    page["cases"] = [case(k, f"Ida(rtol={k})", 1.0, 1.0, curves=drawn) for k in range(60)]
    page["groups"][0]["frames"] = bar(frames=120)
    assert write_page(tmp_path / "page.html", page).stat().st_size < 0.7e6


def test_only_what_is_said_to_be_a_series_is_joined(tmp_path):
    page = study()
    page["cases"] = [case(0, "Ida(rtol=1e-3)", 1.0, 1.0)]
    del page["cases"][0]["series"]
    page["cases"].append(case(1, "Ida(rtol=1e-4)", 1.0, 1.0, series="given"))
    data = stored(write_page(tmp_path / "page.html", page))
    assert [entry["series"] for entry in data["cases"]] == [None, "given"]


def test_all_but_ids_may_be_missing(tmp_path):
    page = {"groups": [{"id": "a"}], "cases": [{"id": "0", "group": "a"}]}
    data = stored(write_page(tmp_path / "page.html", page))
    assert data["title"] == ""
    assert data["groups"][0]["frames"] is None
    assert data["cases"][0]["status"] == "ok"
    assert data["cases"][0]["curves"] is None


@pytest.mark.parametrize(
    ("page", "message"),
    [
        (
            {"cases": [{"id": "0", "group": "a"}]},
            r"^page: the case '0' belongs to no group\.$",
        ),
        (
            {"groups": [{"id": "a"}, {"id": "a"}]},
            r"^page: the id 'a' of a group is taken\.$",
        ),
        (
            {"groups": [{"id": "a"}], "cases": [{"id": "0", "group": "a"}] * 2},
            r"^page: the id '0' of a case is taken\.$",
        ),
    ],
)
def test_refusals(tmp_path, page, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        write_page(tmp_path / "page.html", page)
    assert not list(tmp_path.iterdir())


def test_page_that_cannot_be_written(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(bd.BeamdaeError, match=r"page\.html: it cannot be written"):
        write_page(tmp_path / "file" / "page.html", study())


# In a browser.

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)
NEEDED = "it needs Debian's package chromium and Python's playwright"


@pytest.fixture(scope="module")
def browser():
    api = pytest.importorskip("playwright.sync_api", reason=NEEDED)
    if CHROMIUM is None:
        pytest.skip(NEEDED)
    with api.sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture
def show(browser, tmp_path):
    """Open a page; at the end, nothing may have been complained of or loaded from elsewhere."""
    complaints, loaded = [], []
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    context.set_default_timeout(5000)
    tab = context.new_page()
    tab.on("console", lambda message: complaints.append(message.text))
    tab.on("pageerror", lambda problem: complaints.append(str(problem)))
    tab.on("request", lambda request: loaded.append(request.url))

    def shown(page):
        path = write_page(tmp_path / "page.html", page)
        tab.goto(path.as_uri())
        return tab

    yield shown
    context.close()
    assert complaints == []
    assert loaded == [(tmp_path / "page.html").as_uri()]


def rows(tab):
    """Labels of the rows of the table that are seen."""
    return tab.locator("#table tbody tr:visible td.label").all_inner_texts()


def point(tab, number):
    return tab.locator(f".run[data-case='case {number}']")


def row(tab, number):
    return tab.locator(f"#table tr[data-case='case {number}']")


def numbers_of_curves(tab):
    """Lines drawn in each panel."""
    panels = tab.locator(".panel")
    return [panels.nth(k).locator("path.curve").count() for k in range(4)]


def test_page_opens_and_fits_its_window(show):
    tab = show(study())
    assert tab.title() == study()["title"]
    assert tab.inner_text("h1") == study()["title"]
    assert tab.inner_text("#made") == "beamdae 0.1.0"
    assert tab.inner_text("#reference") == "They agree."
    for width in (1280, 600):
        tab.set_viewport_size({"width": width, "height": 800})
        assert tab.evaluate("document.documentElement.scrollWidth") <= width


def test_points_say_what_they_are_and_failures_are_listed(show):
    tab = show(study())
    assert tab.locator(".run").count() == 6
    point(tab, 4).hover()
    said = tab.inner_text("#tip")
    for text in ("GeneralizedAlpha(step=0.001)", "5.00e-4", "0.4 s", "10000"):
        assert text in said
    tab.mouse.move(1, 1)
    assert not tab.locator("#tip").is_visible()
    listed = tab.inner_text("#unplotted")
    assert "Failed, not drawn: 1" in listed
    assert f"Radau(rtol=1e-06) limited {SENTENCE}" in " ".join(listed.split())


def test_what_the_reference_does_not_resolve_is_drawn_hollow_at_its_limit(show):
    tab = show(study())
    hollow = tab.locator(".run.hollow")
    assert hollow.count() == 1
    assert hollow.locator(".arrow").count() == 1
    height = float(tab.locator("#precision-plot .resolution").get_attribute("y1"))
    at = float(re.findall(r"[\d.]+", hollow.get_attribute("transform"))[1])
    # Rounded to a tenth of a pixel; the error itself, two decades less, would be far below.
    assert at == pytest.approx(height, abs=0.06)
    hollow.hover()
    assert "at most 1.0e-6" in tab.inner_text("#tip")
    fill = "element => getComputedStyle(element.querySelector('.mark')).fill"
    assert hollow.evaluate(fill) == "rgb(255, 255, 255)"
    assert point(tab, 2).evaluate(fill) == "rgb(0, 114, 178)"


def test_lines_join_the_runs_of_a_series(show):
    lines = show(study()).locator("#precision-plot .series")
    # Two from Ida's three points, the one that ends below the limit in dashes; one of the others.
    assert [(" dashed" in c, c.split()[1]) for c in classes(lines)] == [
        (False, "color-1"),
        (False, "color-0"),
        (True, "color-0"),
    ]


def classes(locator):
    return [locator.nth(k).get_attribute("class") for k in range(locator.count())]


def test_rows_are_sorted_by_a_click_as_numbers_and_failures_last(show):
    tab = show(study())
    labels = {int(c["id"].split()[1]): c["label"] for c in study()["cases"]}
    order = {1: [0, 1, 2, 4, 5, 6, 3], -1: [6, 5, 4, 2, 1, 0, 3]}
    header = tab.get_by_role("button", name="steps", exact=True)
    for way, name in ((1, "ascending"), (-1, "descending")):
        header.click()
        assert rows(tab) == [labels[k] for k in order[way]]
        assert tab.locator("th[aria-sort]:has-text('steps')").get_attribute("aria-sort") == name
    tab.get_by_role("button", name="case", exact=True).click()
    assert rows(tab)[-1] == labels[3]
    assert rows(tab)[1:3] == [labels[4], labels[5]]


def test_filter_hides_rows(show):
    tab = show(study())
    for words, count in (("alpha", 2), ("ida note", 4), ("newton CONVERGE", 1), ("nothing", 0)):
        tab.fill("#filter", words)
        assert len(rows(tab)) == count
        assert tab.inner_text("#count") == f"{count} of 7 cases"
    tab.fill("#filter", "")
    assert len(rows(tab)) == 7


def test_clicks_select_and_draw_curves(show):
    tab = show(study())
    # The least error that is resolved is shown first.
    assert tab.locator("tr.selected").count() == 1
    tab.get_by_role("button", name="Clear the selection").click()
    assert tab.locator(".panel").count() == 0
    assert "Select cases" in tab.inner_text("#panels")
    point(tab, 2).click()
    assert numbers_of_curves(tab) == [1, 1, 1, 1]
    row(tab, 5).locator("td.label").click()
    row(tab, 1).locator("input").press("Space")
    assert numbers_of_curves(tab) == [3, 3, 3, 3]
    assert classes(tab.locator("tr.selected")) == ["selected"] * 3
    assert tab.locator(".run.selected .number").all_text_contents() == ["2", "1", "3"]
    colors = [re.search(r"color-\d", c)[0] for c in classes(tab.locator("#chosen .curve"))]
    # The first of a family has its color; no other gets that of another family.
    assert colors == ["color-0", "color-1", "color-3"]
    point(tab, 2).click()
    assert numbers_of_curves(tab) == [2, 2, 2, 2]
    assert not row(tab, 2).locator("input").is_checked()


def test_a_failed_run_is_drawn_as_far_as_it_got(show):
    page = study()
    page["cases"][6]["curves"] = curves(7e-3, T[:20])
    tab = show(page)
    tab.click("#clear")
    tab.locator("#unplotted button").click()
    # A line and a cross at its end.
    assert numbers_of_curves(tab) == [2, 2, 2, 2]


def test_the_plot_is_used_by_keys(show):
    tab = show(study())
    tab.click("#clear")
    first = tab.locator(".run[tabindex='0']")
    assert first.count() == 1
    first.focus()
    assert ODD in tab.inner_text("#tip")
    tab.keyboard.press("ArrowRight")
    assert "GeneralizedAlpha(step=0.002)" in tab.inner_text("#tip")
    at = tab.evaluate("scrollY")
    tab.keyboard.press("Space")
    assert tab.evaluate("scrollY") == at
    assert point(tab, 5).get_attribute("aria-pressed") == "true"
    assert numbers_of_curves(tab) == [1, 1, 1, 1]


def test_curves_are_read_at_the_pointer_and_by_keys(show):
    tab = show(study())
    tab.click("#clear")
    point(tab, 2).click()
    plot = tab.locator("[data-panel=observed] svg[role=group]")
    box = plot.bounding_box()
    # The axes begin at 62 and end at 626 of 640: the middle is t = 1.
    plot.hover(position={"x": box["width"] * 344 / 640, "y": 60})
    said = tab.inner_text("#tip").split()
    assert float(said[2]) == pytest.approx(1.0, abs=0.02)
    assert float(said[-1]) == pytest.approx(-1.0, abs=1e-3)
    plot.focus()
    tab.keyboard.press("ArrowRight")
    said = tab.inner_text("#tip").split()
    # A hundredth of the run to the right: what is stored nearest to it is at t = 1.
    assert float(said[2]) == pytest.approx(1.02, abs=0.02)
    assert float(said[-1]) == pytest.approx(-1.0, abs=1e-3)
    for _ in range(50):
        tab.keyboard.press("ArrowRight")
    said = tab.inner_text("#tip").split()
    assert (float(said[2]), float(said[-1])) == (2.0, pytest.approx(1.0, abs=1e-3))


def test_the_observed_column_is_chosen_and_kept(show):
    tab = show(study())
    choice = tab.get_by_label("Observed: which")
    assert choice.input_value() == "tip.x [m]"
    choice.select_option("hinge.F [N]")
    for _ in range(2):
        assert tab.locator("[data-panel=observed] .title").nth(1).text_content() == "hinge.F [N]"
        point(tab, 5).click()


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


def test_another_model_without_errors_curves_and_animation(show):
    tab = show(study())
    tab.select_option("#group", "rod()")
    assert rows(tab) == ["Ida(rtol=0.01)", "Radau(rtol=0.01)"]
    assert tab.inner_text("#reference") == "Reference not accepted. They do not agree."
    said = " ".join(tab.locator(".empty").all_inner_texts())
    for text in ("No case of this model has both", "No animation", "No case of this model has c"):
        assert text in said
    assert "No consistent start" in tab.inner_text("#unplotted")
    assert "Without an error or a wall time, not drawn: 1" in tab.inner_text("#unplotted")
    assert not tab.locator("#player").is_visible()


@pytest.mark.parametrize(
    ("page", "said"),
    [
        ({}, "This study has no cases."),
        ({"groups": [{"id": "a"}]}, "No reference: errors are not known."),
        (
            {"groups": [{"id": "a"}], "cases": [{"id": "0", "group": "a"}]},
            "No case of this model has curves.",
        ),
        (
            {"groups": [{"id": "a"}], "cases": [case(0, "Ida", 1e-3, 1.0, group="a")]},
            "1 of 1 cases",
        ),
    ],
    ids=["nothing", "no cases", "bare case", "one case"],
)
def test_little_to_show(show, page, said):
    assert said in show(page).inner_text("main")


NAMES = [
    "u16",
    "__proto__",
    "constructor",
    "hasOwnProperty",
    "low [m]",
    "bell \x07 escape \x1b[31m null \x00",
    "line\u2028separator",
    "lone \ud800 surrogate",
    "</script><script>document.title = 'injected'</script>",
    "<!-- <script>",
    "[/b] :smile: $x_1^{2}\\",
]


def odd_names():
    """A study in which every name a user chooses is odd."""
    page = study()
    page["title"] = "".join(NAMES)
    page["notes"] = list(NAMES)
    page["columns"] += [{"key": n, "label": n, "unit": n, "kind": "number"} for n in NAMES]
    for k, one in enumerate(page["cases"]):
        one["values"] |= {n: n for n in NAMES[: 1 + k]}
        one["label"] += NAMES[k]
        if one["curves"]:
            one["curves"]["observed"] = {n: np.cos(k * T).tolist() for n in NAMES}
    for group in page["groups"]:
        if group["frames"]:
            group["frames"]["bodies"][1]["name"] = "".join(NAMES)
    return page


def test_names_of_users_are_stored_as_they_are(tmp_path):
    text = write_page(tmp_path / "page.html", odd_names()).read_text(encoding="utf-8")
    assert text.count("</script>") == 2
    assert not set(map(chr, [*range(9), *range(14, 32), 0x2028])) & set(text)
    (stored_text,) = re.findall(r'id="data">(.*?)</script>', text, re.DOTALL)
    data = json.loads(stored_text)
    assert data["title"] == "".join(NAMES)
    assert data["cases"][4]["values"]["u16"] == "u16"


def test_names_of_users_are_shown_whatever_they_are(show):
    tab = show(odd_names())
    assert tab.title().startswith("u16")
    assert rows(tab)
    choice = tab.get_by_label("Observed: which")
    for k in range(len(NAMES)):
        choice.select_option(index=k)
        assert tab.locator("[data-panel=observed] path.curve").count() == 1
    first = tab.locator("#table tr[data-case='case 2'] td").all_inner_texts()
    # Its only odd value is that of u16: no name of JavaScript's own has one.
    assert [text for text in first[-len(NAMES) :] if text != "\N{EN DASH}"] == ["u16"]
