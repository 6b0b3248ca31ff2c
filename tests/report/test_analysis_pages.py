"""Pages of equilibria, modes, buckling, periodic motions, responses and Campbell diagrams."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from mechanisms import cantilever, driven_blade, oscillator, rectangle, rotor_on_a_bearing, truss
from numpy.testing import assert_allclose
from pages import find_violations, reset_button, visible_labels, visible_ranges

import beamdae as bd
from beamdae.report.analysis_pages import (
    build_campbell_page,
    build_critical_loads_page,
    build_linear_page,
    build_modes_page,
    build_path_page,
)
from beamdae.report.pictures.mode_shapes import create_campbell_figure
from beamdae.report.run_pages import build_periodic_page, build_response_page
from beamdae.results.frequency_response import FrequencyResponse, ResponsePoint
from beamdae.results.outcome import Status

BAR = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.01)
COLUMN = bd.Line((0.0, 0.0), (0.0, 1.0))


@pytest.fixture(scope="module")
def path():
    return bd.equilibrium(truss(), to={"crown.y": 0.0})


@pytest.fixture(scope="module")
def column():
    return cantilever(2, COLUMN, BAR, load=(0.0, -1.0))


@pytest.fixture(scope="module")
def shaken():
    return bd.periodic(oscillator(400.0, 4.0, load=bd.sine(20.0, 2.0)), 0.5)


def shake(amplitude):
    """Return one period of a free vibration of 2 Hz."""
    rate = 4.0 * np.pi
    mech = oscillator(rate**2, damping=0.0, speed=rate * amplitude)
    return bd.simulate(mech, bd.GeneralizedAlpha(step=0.01), 0.5)


@pytest.fixture(scope="module")
def damped():
    return oscillator(200.0, 4.0, mass=2.0, speed=0.0)


def test_the_page_of_a_path_has_its_points_and_critical_points(path, tmp_path):
    page = build_path_page(path, "truss")
    assert page["time"] == {"name": "point", "unit": ""}
    assert (page["portrait"]["x"], page["portrait"]["y"]) == ("crown.y [m]", "load factor [-]")
    assert [mark["label"] for mark in page["portrait"]["marks"]] == ["limit point"]
    curves = page["cases"][0]["curves"]
    assert_allclose(curves["t"], np.arange(len(path.q)))
    assert_allclose(curves["observed"]["load factor [-]"], path.factors[:, -1])
    frames = page["groups"][0]["frames"]
    assert len(frames["t"]) == len(path.q)
    tables = {table["title"]: table for table in page["tables"]}
    assert tables["Critical points"]["rows"][0][:2] == ["limit point", "3.019147"]
    assert path.page(tmp_path / "path.html").stat().st_size > 10_000


def test_pages_open_on_the_chosen_columns(path, shaken):
    page = build_path_page(path, "truss", ["crown.x [m]"])
    assert page["featured"] == ["crown.x [m]"]
    assert page["portrait"]["x"] == "crown.x [m]"
    assert build_periodic_page(shaken, "one", ["mass.x_dot [m/s]"])["featured"] == [
        "mass.x_dot [m/s]"
    ]


@pytest.mark.slow(reason="a fifth of a second")
def test_the_page_of_modes_has_a_motion_for_each(column, tmp_path):
    modes = bd.modes(column, n=3)
    page = build_modes_page(modes, "column")
    assert [case["label"] for case in page["cases"]] == [modes.describe(k) for k in range(3)]
    assert_allclose([x["values"]["frequency [Hz]"] for x in page["cases"]], modes.frequencies)
    for case in page["cases"]:
        (beam,) = (x for x in case["frames"]["glyphs"] if x["kind"] == "beam")
        x = np.array(beam["x"])
        # One period, from its largest displacement; all modes have the same amplitude.
        sway = np.abs(x).max(axis=1)
        assert sway[0] == sway.max()
        assert_allclose(x[0], x[-1], atol=1e-4)
        assert np.abs(x).max() == pytest.approx(0.12, rel=0.02)
    assert modes.page(tmp_path / "modes.html").is_file()


def test_the_page_of_buckling_lists_the_factors(column, tmp_path):
    buckling = bd.buckling(column, 2)
    page = build_modes_page(buckling, "column")
    assert_allclose([x["values"]["load factor [-]"] for x in page["cases"]], buckling.factors)
    text = buckling.page(tmp_path / "buckling.html").read_text(encoding="utf-8")
    assert "<title>buckling modes about" in text


def test_the_page_of_a_periodic_motion_has_its_stability_first(shaken, tmp_path):
    page = build_periodic_page(shaken, "shaken")
    assert page["subtitle"] == "repeats after one period; stable"
    titles = [table["title"] for table in page["tables"] if table.get("section") != "solver"]
    assert titles == ["Periodic motion", "Amplitudes"]
    assert shaken.page(tmp_path / "periodic.html").is_file()


def test_regression_labels_of_critical_points_are_in_the_plot(path, show):
    """The label of a limit point, the highest point of a path, was cut at the upper edge."""
    tab = show(build_path_page(path, "truss"))
    chart = tab.locator("#portrait .plot")
    label, plot = chart.locator("text", has_text="point").bounding_box(), chart.bounding_box()
    assert label["y"] >= plot["y"]
    assert label["x"] + label["width"] <= plot["x"] + plot["width"]


def test_the_page_of_a_path_in_a_browser(path, show):
    tab = show(build_path_page(path, "truss"))
    dot = tab.locator("[data-chart=portrait] .time-dot")
    start = dot.bounding_box()["x"]
    tab.locator("#frame").fill(str(len(path.q) - 1))
    assert tab.inner_text("#time") == f"point = {len(path.q) - 1}"
    # The crown moves down, to the left in the chart.
    assert dot.bounding_box()["x"] < start - 100.0
    # Keys visit the points, and the motion follows.
    tab.locator("[data-chart=portrait] .plot").press("ArrowRight")
    assert tab.inner_text("#time") == "point = 0"
    # The guided coordinate, which stays zero, is not the first one.
    assert "crown.y [m]" in tab.locator("[data-panel=observed] option").first.inner_text()
    tab.get_by_label("Curve: horizontal axis").select_option("load factor [-]")
    assert "load factor [-]" in tab.locator("[data-chart=portrait] text").all_text_contents()


def test_the_page_of_modes_in_a_browser(column, show):
    tab = show(build_modes_page(bd.modes(column, n=3), "column"))
    assert tab.inner_text("#cases-title") == "All modes"
    assert not tab.locator("#curves").is_visible()
    shown = tab.inner_text("#shown")
    assert shown == visible_labels(tab)[0]
    tab.locator("#table tbody tr").nth(2).locator("td.label").click()
    assert tab.inner_text("#shown") == visible_labels(tab)[2]
    assert tab.locator("#sliders output").inner_text() == "3"
    tab.locator("#frame").fill("8")
    assert tab.inner_text("#time") == "phase = 0.25 periods"


@pytest.fixture(scope="module")
def response():
    """Return a response curve of four motions, which has a peak and unstable motions."""
    points = ((1.0, 0.1, 0.5), (2.0, 0.2, 2.0), (3.0, 0.5, 2.0), (4.0, 0.3, 0.5))
    return FrequencyResponse(
        "force",
        tuple(
            ResponsePoint(force, 0.5, shake(amplitude), np.array([multiplier]))
            for force, amplitude, multiplier in points
        ),
        Status("ok", "reached the end of the range"),
    )


@pytest.mark.slow(reason="a fifth of a second")
def test_the_page_of_a_response_has_a_motion_for_each_point(response, tmp_path):
    page = build_response_page(response, "shaken")
    assert page["subtitle"] == "periodic motions over force: reached the end of the range"
    assert page["axes"] == {"x": "force", "y": "mass.x half range [m]"}
    (overlay,) = (x for x in page["overlays"] if x["y"] == page["axes"]["y"])
    # The vertex of a parabola over the arc length, next to the largest motion.
    ((x, y),) = response.peaks("mass.x")
    assert overlay["marks"] == [{"label": f"{x:.4g}", "x": x, "y": y}]
    cases = page["cases"]
    assert [case["values"]["mass.x half range [m]"] for case in cases] == pytest.approx(
        response.curve("mass.x")[1]
    )
    assert [case["family"] for case in cases] == ["stable", "unstable", "unstable", "stable"]
    assert [case["values"]["stable"] for case in cases] == [True, False, False, True]
    assert all(len(case["frames"]["t"]) == 32 for case in cases)
    tables = {table["title"]: table for table in page["tables"]}
    # The guided coordinate moves by rounding alone.
    assert {row[0] for row in tables["Peaks"]["rows"]} == {"mass.x [m]", "mass.x_dot [m/s]"}
    facts = dict(tables["Response"]["rows"])
    assert (facts["curve"], facts["unstable"]) == ("4 points, force 1 to 4", "2 of 4 points")
    assert response.page(tmp_path / "response.html").stat().st_size > 10_000
    single = build_response_page(replace(response, points=response.points[:1]), "shaken")
    assert [table["title"] for table in single["tables"]] == ["Response"]
    empty = replace(response, points=(), status=Status("failed", "no first motion was found"))
    page = build_response_page(empty, "none")
    assert page["subtitle"] == "periodic motions over force: no first motion was found"


@pytest.mark.slow(reason="half a second")
def test_pages_and_pictures_of_responses_have_the_unit_of_the_parameter(response):
    unitless = build_response_page(response, "shaken")
    assert unitless["sliders"][0]["unit"] == ""
    newtons = replace(response, unit="N")
    page = build_response_page(newtons, "shaken")
    (column,) = (x for x in page["columns"] if x["key"] == "force")
    assert (column["label"], column["unit"]) == ("force", "N")
    assert page["sliders"][0]["unit"] == "N"
    assert page["cases"][1]["label"] == "force = 2 N"
    tables = {table["title"]: table for table in page["tables"]}
    assert tables["Peaks"]["head"][1] == "force [N]"
    (axis,) = newtons.plot("mass.x").figure.axes
    assert axis.get_xlabel() == "force [N]"
    (axis,) = response.plot("mass.x").figure.axes
    assert axis.get_xlabel() == "force"


def test_the_page_of_a_response_in_a_browser(response, show):
    tab = show(build_response_page(response, "shaken"))
    assert tab.inner_text("#selected-title") == "Selected motions"
    # The curve comes before the motions over time.
    scatter, panels = (tab.locator(x).bounding_box()["y"] for x in ("#precision", "#panels"))
    assert scatter < panels
    marks = (
        """state.charts.get("scatter").spec.series.find(({name}) => name === "marks").data.length"""
    )
    assert tab.evaluate(marks) == 1
    dashed = """state.charts.get("scatter").spec.series
        .filter(({type, lineStyle}) => type === "line" && lineStyle.type !== "solid")
        .map(({data}) => data.length / 3)"""
    assert tab.evaluate(dashed) == [3]
    tab.locator("#slider-0").evaluate(
        "slider => { slider.value = 2; slider.dispatchEvent(new Event('input')); }"
    )
    assert tab.locator("#sliders output").inner_text() == "3"
    axis = tab.get_by_label("y axis")
    axis.focus()
    axis.select_option("mass.x_dot half range [m/s]")
    assert axis.evaluate("select => select === document.activeElement")
    assert tab.evaluate(marks) == 1
    tab.get_by_label("x axis").select_option("period [s]")
    assert tab.evaluate(marks) == 0


def test_regression_unstable_motions_look_the_same_without_stable_ones(response, show):
    """Without stable motions, unstable ones had their marker, and there was no legend."""

    def find_markers(page):
        return show(page).evaluate("""Object.fromEntries(state.charts.get("scatter").spec.series
            .filter(({type}) => type === "scatter").map(({name, symbol}) => [name, symbol]))""")

    both = find_markers(build_response_page(response, "shaken"))
    unstable = replace(response, points=response.points[1:3])
    alone = find_markers(build_response_page(unstable, "shaken"))
    assert {*both} == {"stable", "unstable", "labels", "marks"}
    assert "stable" not in alone
    assert alone["unstable"] == both["unstable"] != both["stable"]


def test_the_page_of_a_linear_model_has_poles_and_transfer_functions(damped, tmp_path):
    linear = bd.linearize(damped, inputs=["load"])
    page = build_linear_page(linear, "oscillator")
    poles = next(table["rows"] for table in page["tables"] if table["title"] == "Poles")
    assert_allclose(np.array(poles, float), [[1, np.sqrt(99.0) / (2.0 * np.pi), 0.1, -1.0]], 1e-5)
    cases = {case["label"]: case for case in page["cases"]}
    case = cases["mass.x [m] / load.Fx [N]"]
    frequencies, (magnitude,) = case["curves"]["t"], case["curves"]["magnitude"].values()
    exact = 1.0 / (200.0 - 2.0 * (2.0 * np.pi * frequencies) ** 2 + 8j * np.pi * frequencies)
    assert_allclose(magnitude, np.abs(exact), rtol=1e-9)
    assert_allclose(case["curves"]["phase"]["phase [deg]"], np.degrees(np.angle(exact)), atol=1e-6)
    # The force has no effect across the rail.
    assert cases["mass.y [m] / load.Fx [N]"]["curves"] is None
    # The largest magnitude is 1 / (2 zeta sqrt(1 - zeta^2)) of the static one.
    assert case["values"]["largest magnitude"] == pytest.approx(
        0.005 / (0.2 * np.sqrt(0.99)), rel=1e-3
    )
    assert linear.page(tmp_path / "linear.html").stat().st_size > 10_000


def test_regression_fast_real_poles_do_not_fill_the_table():
    """Nineteen overdamped axial vibrations of leaves hid the vibrations after them."""
    mech = oscillator(2e10, 4.0, mass=2.0, speed=0.0)
    for k in range(12):
        mech.state(f"fast {k}").follows(-1e3 * (k + 1.0) * mech.part(f"fast {k}"))
    page = build_linear_page(bd.linearize(mech), "fast")
    tables = {table["title"]: table["rows"] for table in page["tables"]}
    numbers = [row[0] for row in tables["Poles"]]
    assert numbers == ["1", "2", "3", "4", "5", "6", "7", "8", "13"]
    assert tables["Poles"][-1][1] == f"{1e5 / (2.0 * np.pi):.6g}"
    assert dict(tables["Linear model"])["not listed"] == "4 poles, up to |p| = 1.2e+04 1/s"


def test_the_page_of_a_linear_model_in_a_browser(damped, show):
    tab = show(build_linear_page(bd.linearize(damped, inputs=["load"]), "oscillator"))
    panels = tab.locator("#panels .panel")
    assert panels.locator("h3").all_inner_texts() == ["Magnitude", "Phase"]
    assert tab.evaluate('state.charts.get("magnitude").spec.x.log')
    ticks = tab.evaluate(
        "state.charts.get('phase').instance.getModel().getComponent('yAxis').axis.scale.getTicks()"
    )
    assert len(ticks) > 2
    assert all(tick["value"] % 45 == 0 for tick in ticks)
    # Quantized on a logarithmic axis, the lowest frequency is exact.
    first = tab.evaluate("page.cases[0].curves.t[0]")
    assert first == pytest.approx(np.sqrt(100.0) / (2.0 * np.pi) / 10.0, rel=1e-3)
    # One step of the cursor is a hundredth of the axis.
    tab.locator("[data-chart=phase] .plot").focus()
    tab.keyboard.press("ArrowRight")
    assert tab.locator("#reading").text_content().startswith("frequency = 0.1")
    assert find_violations(tab) == []
    # Without inputs, the page lists the poles.
    tab = show(build_linear_page(bd.linearize(damped, inputs=[]), "oscillator"))
    assert "-1" in tab.inner_text("#result-facts")
    assert not tab.locator("#cases").is_visible()
    assert not tab.locator("#top").is_visible()


@pytest.mark.slow(reason="a quarter of a second")
def test_regression_transfer_functions_of_rounding_errors_are_not_drawn():
    """The angle of an inclined beam under an axial force had a phase and an axis in rad/N."""
    direction = np.array([np.cos(0.5), np.sin(0.5)])
    line = bd.Line((0.0, 0.0), tuple(0.4 * direction))
    mech = cantilever(2, line, rectangle(0.002, 0.03, damping=1e-4))
    axial = mech.input("axial", unit="N")
    mech.add(bd.Force("push", mech.part("beam").end, tuple(x * axial for x in direction)))
    cases = build_linear_page(bd.linearize(mech, inputs=["axial"]), "beam")["cases"]
    # The response of the input to itself is not listed.
    drawn = {case["label"].partition(" ")[0]: case["curves"] is not None for case in cases}
    for name in ("tip.x", "tip.y", "tip.angle"):
        for suffix in ("", "_dot"):
            assert drawn[name + suffix] == (name != "tip.angle")


def build_chain(stiffness, count):
    """Return undamped masses of 1 kg on a line, connected by springs, with a force on the first."""
    mech = bd.Mechanism()
    end = mech.ground.at(0.0, 0.0)
    for k in range(count):
        mass = mech.add(bd.PointMass(f"mass {k}", 1.0, at=(1.0 + k, 0.0)))
        mech.add(bd.PointOnLine(f"rail {k}", mech.ground.at(0.0, 0.0), mass.point, (1.0, 0.0)))
        mech.add(bd.Spring(f"spring {k}", end, mass.point, stiffness, free_length=1.0))
        end = mass.point
        if k == 0:
            mech.add(bd.Force("load", end, (0.0, 0.0)))
    mech.observe("end", end)
    return mech


@pytest.mark.parametrize(("stiffness", "count"), [(200.0, 1), (81.0, 1), (100.0, 1), (100.0, 3)])
def test_regression_undamped_linear_models_have_a_page(stiffness, count):
    """The middle of the frequencies was the pole of a single mass; peaks hid other phases."""
    model = bd.linearize(build_chain(stiffness, count), inputs=["load"])
    case = next(
        x
        for x in build_linear_page(model, "undamped")["cases"]
        if x["label"] == "end.x [m] / load.Fx [N]"
    )
    (magnitude,), (phase,) = (case["curves"][x].values() for x in ("magnitude", "phase"))
    assert np.isfinite(phase).all()
    assert_allclose(np.sin(np.radians(phase)), 0.0, atol=1e-6)
    frequencies = case["curves"]["t"]
    square = (2.0 * np.pi * frequencies) ** 2
    stiffnesses = stiffness * (2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1))
    stiffnesses[-1, -1] = stiffness
    exact = [np.linalg.inv(stiffnesses - x * np.eye(count))[-1, 0] for x in square]
    assert_allclose(magnitude, np.abs(exact), rtol=1e-6)


@pytest.fixture(scope="module")
def rotor():
    """Return a Campbell diagram of whirl with (10 - speed) and (10 + speed)."""
    return bd.campbell(rotor_on_a_bearing(), [6.0, 1.0, 3.0], n=3)


@pytest.mark.slow(reason="half a second and more")
def test_the_page_of_a_campbell_diagram_has_a_motion_for_each_mode(rotor, tmp_path):
    page = build_campbell_page(rotor, "rotor")
    cases = {(case["rank"], case["family"]): case for case in page["cases"]}
    assert len(cases) == 9
    for i, speed in enumerate((1.0, 3.0, 6.0)):
        frequencies = sorted(cases[i, f"mode {k}"]["values"]["frequency [Hz]"] for k in (1, 2, 3))
        expected = np.array([0.0, 10.0 - speed, 10.0 + speed]) / (2.0 * np.pi)
        assert_allclose(frequencies, expected, atol=1e-6)
    assert page["sliders"][0]["values"] == [1.0, 3.0, 6.0]
    (overlay,) = page["overlays"]
    assert [line["label"] for line in overlay["lines"]] == [f"{k}\u00d7" for k in (1, 2, 3, 4)]
    assert_allclose(overlay["lines"][1]["y"][-1], 2.0 * 6.0 / (2.0 * np.pi))
    # 10 - speed equals the speed at 5, twice the speed at 10 / 3, and four times the speed at 2.
    marks = sorted(mark["x"] for mark in overlay["marks"])
    assert_allclose(marks, [2.0, 2.5, 10.0 / 3.0, 10.0 / 3.0, 5.0, 5.0], rtol=1e-6)
    assert all(case["frames"] is not None for case in page["cases"])
    assert rotor.page(tmp_path / "campbell.html").stat().st_size > 10_000
    assert page["subtitle"] == "3 modes at 3 speeds"


@pytest.mark.slow(reason="two seconds")
def test_regression_campbell_diagrams_have_the_unit_of_their_speeds(rotor):
    """Speeds that were typed in rpm were drawn in rad/s."""
    diagram = replace(rotor, speed_unit="rpm")
    page, si_page = (build_campbell_page(x, "rotor") for x in (diagram, rotor))
    rpm = 30.0 / np.pi
    assert page["axes"]["x"] == "speed [rpm]"
    assert_allclose(page["sliders"][0]["values"], rpm * np.array([1.0, 3.0, 6.0]))
    (overlay,), (si_overlay,) = page["overlays"], si_page["overlays"]
    for mark, si_mark in zip(overlay["marks"], si_overlay["marks"], strict=True):
        assert (mark["x"], mark["y"]) == pytest.approx((rpm * si_mark["x"], si_mark["y"]))
    assert_allclose(overlay["lines"][1]["y"], si_overlay["lines"][1]["y"])
    assert page["cases"][0]["label"] == "mode 1 at 9.5493 rpm"
    axis, si_axis = (create_campbell_figure(x).axes[0] for x in (diagram, rotor))
    assert (axis.get_xlabel(), si_axis.get_xlabel()) == ("speed [rpm]", "speed [rad/s]")
    for line, si_line in zip(axis.lines, si_axis.lines, strict=True):
        assert_allclose(line.get_xdata(), rpm * np.array(si_line.get_xdata()))
        assert_allclose(line.get_ydata(), si_line.get_ydata())


@pytest.mark.slow(reason="a quarter of a second")
def test_modes_of_a_campbell_diagram_keep_their_phase_from_speed_to_speed():
    diagram = bd.campbell(driven_blade(0.0), [0.0, 20.0, 40.0, 60.0], n=3)
    page = build_campbell_page(diagram, "blade")
    for mode in ("mode 1", "mode 2"):
        tips = []
        for case in page["cases"]:
            if case["family"] == mode:
                (blade,) = (x for x in case["frames"]["glyphs"] if x["name"] == "blade")
                tips.append(np.array(blade["y"])[0, -1])
        assert np.abs(tips).min() > 0.05
        assert len(set(np.sign(tips))) == 1


def test_the_page_of_a_campbell_diagram_in_a_browser(rotor, show):
    tab = show(build_campbell_page(rotor, "rotor"))
    counts = """Object.fromEntries(state.charts.get("scatter").spec.series.map(
        ({name, data}) => [name, data.length]))"""
    numbers = tab.evaluate(counts)
    assert numbers["marks"] == 6
    assert {f"{k}\u00d7" for k in (1, 2, 3, 4)} < {*numbers}
    assert tab.inner_text("#selected-title") == "Selected modes"
    assert tab.locator("#panels").inner_text() == ""
    shown = tab.inner_text("#shown")
    tab.locator("#table tbody tr").last.locator("td.label").click()
    assert tab.inner_text("#shown") != shown


@pytest.mark.slow(reason="starts a browser")
@pytest.mark.parametrize("window", ["show", "phone"])
def test_regression_labels_of_multiples_of_the_speed_do_not_overlap(rotor, window, request):
    """They were at the right ends of the lines, over each other and over the markers."""
    page = build_campbell_page(rotor, "rotor")
    for case in page["cases"]:
        # Far above the multiples of the speed, whose ends are then close together.
        if case["family"] == "mode 3":
            case["values"]["frequency [Hz]"] = 60.0
    tab = request.getfixturevalue(window)(page)
    labels = [tab.locator("#precision text", has_text=f"{k}\u00d7") for k in (1, 2, 3, 4)]
    boxes = sorted((label.bounding_box() for label in labels), key=lambda box: box["x"])
    for left, right in pairwise(boxes):
        assert left["x"] + left["width"] < right["x"]


@pytest.mark.slow(reason="half a second and more")
def test_regression_labels_of_campbell_pictures_do_not_overlap(rotor):
    figure = rotor.plot().figure
    figure.draw_without_rendering()
    (axis,), (legend,) = figure.axes, figure.legends
    assert [x.get_text() for x in legend.get_texts()] == ["mode 1", "mode 2", "mode 3"]
    boxes = [text.get_window_extent() for text in axis.texts]
    assert len(boxes) == 4
    assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
    assert all(axis.bbox.containsx(x) for box in boxes for x in (box.x0, box.x1))


def test_regression_multiples_of_the_speed_are_drawn_from_speed_zero(show):
    """The frequency axis became logarithmic, on which the lines from zero have no position."""
    blade = cantilever(2, COLUMN, BAR)
    page = build_campbell_page(bd.campbell(blade, [0.0, 100.0], n=6), "beam")
    frequencies = [case["values"]["frequency [Hz]"] for case in page["cases"]]
    assert max(frequencies) > 50.0 * min(frequencies)
    tab = show(page)
    axes = tab.evaluate("(({x, y}) => [x.log, y.log])(state.charts.get('scatter').spec)")
    assert axes == [False, False]


@pytest.mark.slow(reason="opens seven pages")
@pytest.mark.parametrize(("scheme", "size"), [("light", (1366, 768)), ("dark", (390, 844))])
def test_pages_of_analyses_have_no_violations(
    path, column, shaken, response, rotor, damped, open_page, scheme, size
):
    pages = (
        build_path_page(path, "truss"),
        build_modes_page(bd.modes(column, n=3), "modes"),
        build_modes_page(bd.buckling(column), "buckling"),
        build_periodic_page(shaken, "shaken"),
        build_response_page(response, "shaken"),
        build_campbell_page(rotor, "rotor"),
        build_linear_page(bd.linearize(damped, inputs=["load"]), "oscillator"),
    )
    window = dict(zip(("width", "height"), size, strict=True))
    for page in pages:
        tab = open_page(page, viewport=window, color_scheme=scheme, bypass_csp=True)
        assert find_violations(tab) == []
        assert tab.evaluate("document.documentElement.scrollWidth") <= window["width"]
        tab.close()


def test_regression_modes_above_the_excitations_do_not_hide_the_resonances(show):
    """Ten modes up to 1300 Hz pressed the multiples of the speed, up to 38 Hz, onto the axis."""
    section = bd.Section.rectangle(
        bd.Material.of("aluminum"), width=0.04, height=0.005, damping=1e-4
    )
    diagram = bd.campbell(driven_blade(0.0, section=section), [0.0, 60.0], n=6)
    overdamped = ~diagram.frequencies.any(axis=0)
    assert overdamped.sum() == 1
    assert diagram.frequencies.max() > 500.0
    axis = diagram.plot().figure.axes[0]
    assert 100.0 < axis.get_ylim()[1] < 120.0
    assert axis.get_title() == "higher frequencies: modes 3 to 5"
    page = build_campbell_page(diagram, "Campbell diagram")
    assert [case["values"]["frequency [Hz]"] for case in page["cases"][-2:]] == [None, None]
    tab = show(page)
    assert "modes 3 to 5" in tab.inner_text("#subtitle")
    low, high = visible_ranges(tab, "scatter")[1]
    assert low <= 0.0
    assert high < 120.0
    reset_button(tab, "scatter").click()
    assert visible_ranges(tab, "scatter")[1][1] > 500.0


def test_small_displacements_of_equilibria_are_enlarged(column):
    path = bd.equilibrium(column)
    assert build_path_page(path, "column")["groups"][0]["frames"]["captions"] == ""
    path = bd.equilibrium(cantilever(2, section=BAR, load=(0.0, -1.0)))
    page = build_path_page(path, "cantilever")
    assert page["groups"][0]["frames"]["captions"] == "displacements \u00d7 100"
    # The chart over the points opens on the column that the path is drawn over.
    assert page["featured"] == ["tip.y [m]"]


def test_regression_texts_of_modes_do_not_stretch_the_rows(column, show):
    """A column of words, one per line, filled the height of the table with two rows."""
    page = build_modes_page(bd.modes(column, n=3), "modes")
    for case in page["cases"]:
        case["values"]["moves"] = (
            "first 30 %, second 20 %, third 20 %, fourth 10 %, fifth 10 %, sixth 10 %"
        )
    tab = show(page)
    heights = "rows => rows.map((row) => row.getBoundingClientRect().height)"
    # Three lines; twelve lines are 240 px.
    assert max(tab.locator("#table tbody tr").evaluate_all(heights)) < 100.0


def test_the_page_of_a_boundary_marks_its_special_points(show):
    values, status = np.array([1.0, 2.0, 1.0]), Status("ok", "reached the end")
    special = (bd.results.BoundaryPoint("cusp", 2.0, 5.0),)
    factors, q = np.array([3.0, 5.0, 6.0]), np.zeros((3, 1))
    unstable = np.zeros(3, int)
    boundary = bd.results.Boundary(
        "limit point", "rise", values, factors, special, unstable, q, status, ("press",)
    )
    tab = show(build_critical_loads_page(boundary, "limit loads"))
    assert "cusp" in tab.locator("#precision").inner_text()
    assert tab.inner_text("#cases-title") == "All points"
    assert not tab.locator("#motion").is_visible()
    assert not tab.locator("#curves").is_visible()
    assert find_violations(tab) == []


def test_the_page_of_knock_down_factors_starts_from_the_perfect_structure():
    curve = bd.results.KnockDown(
        np.array([1e-5, 1e-4]), np.array([2.0, np.nan]), ("limit point", ""), 4.0
    )
    page = build_critical_loads_page(curve, "arch")
    assert page["axes"] == {"x": "amplitude [m]", "y": "load factor [-]"}
    assert page["cases"][0]["values"]["knock-down factor [-]"] == 0.5
    assert page["tables"][0]["rows"] == [["load factor without imperfection", "4"]]
