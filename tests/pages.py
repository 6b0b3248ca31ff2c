"""Pages of made-up studies, and functions that read and use them in a browser."""

import base64
import json
import re
from importlib.resources import files

import numpy as np
import pytest

T = np.linspace(0.0, 2.0, 41)
RESOLUTION = 1e-6  # of the reference
ROUNDING = 1e-7  # of stored values, relative to them
ODD_LABEL = '</script><b>"it\'s" & <!-- Ida(rtol=0.01)'
FAILURE = "Newton did not converge at t = 1.2 s"


def read_page(path):
    """Return the data of a page with decoded arrays."""
    (text,) = re.findall(
        r'<script type="application/json" id="data">(.*?)</script>',
        path.read_text(encoding="utf-8"),
        re.DOTALL,
    )
    return json.loads(text, object_hook=decode)


def decode(value):
    return np.frombuffer(base64.b64decode(value[""]), "<f4") if "" in value else value


def build_curves(error, t=T):
    return {
        "t": t,
        "observed": {"tip.x [m]": np.cos(np.pi * t), "hinge.F [N]": 5.0 + error * t},
        "error": {"error": error * t / 2.0},
        "energy": {"kinetic": t**2, "imbalance": error * t},
        "drift": {"position drift": 1e-12 + 0.0 * t, "velocity drift": 1e-10 + 0.0 * t},
    }


def build_case(number, label, error, cost, group="bar", **entries):
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
        "curves": None if error is None else build_curves(error),
    } | entries


def bar_frames(frames=21):
    """Return the animation of a 2 m bar, hinged at (0, 0), that turns by 90 degrees with a bob."""
    angle = np.linspace(0.0, 0.5 * np.pi, frames)
    x, y = 2.0 * np.cos(angle), 2.0 * np.sin(angle)
    hinge, shares = np.zeros((frames, 1)), np.array([0.0, 0.5, 1.0])
    bodies = {
        "ground": ("ground", hinge, hinge),
        "bar": ("beam", x[:, None] * shares, y[:, None] * shares),
        "bob": ("point", x[:, None], y[:, None]),
    }
    return {
        "t": np.linspace(0.0, 0.5, frames),
        "glyphs": [
            {"name": name, "kind": kind, "x": x.ravel(), "y": y.ravel(), "points": x.shape[1]}
            for name, (kind, x, y) in bodies.items()
        ],
        "extent": [[0.0, 0.0], [2.0, 2.0]],
    }


def study_page():
    accepted_reference = {
        "uncertainty": RESOLUTION,
        "accepted": True,
        "sentence": "They agree.",
    }
    rejected_reference = {"uncertainty": None, "accepted": False, "sentence": "They do not agree."}
    number = {"unit": "", "kind": "number"}
    return {
        "title": f"Study {ODD_LABEL}",
        "subtitle": "nine cases",
        "made": {"beamdae": "0.1.0"},
        "notes": ["Errors are relative."],
        "groups": [
            {
                "id": "bar",
                "label": "bar()",
                "reference": accepted_reference,
                "frames": bar_frames(),
            },
            {
                "id": "rod",
                "label": "rod()",
                "reference": accepted_reference | rejected_reference,
                "frames": None,
            },
        ],
        "columns": [
            {"key": "steps", "label": "steps", **number},
            {"key": "note", "label": "note", "unit": "", "kind": "text"},
            {"key": "status", "label": "status", "unit": "", "kind": "status"},
        ],
        "cases": [
            build_case(2, "Ida(rtol=0.001)", 1e-3, 0.10),
            build_case(1, "Ida(rtol=1e-05)", 1e-5, 1.50),
            build_case(0, "Ida(rtol=1e-07)", 1e-6, 3.00, below=True),
            build_case(5, "GeneralizedAlpha(step=0.002)", 2e-3, 0.20),
            build_case(4, "GeneralizedAlpha(step=0.001)", 5e-4, 0.40),
            build_case(6, ODD_LABEL, 1e-2, 0.05, family="Ida"),
            build_case(3, "Radau(rtol=1e-06)", 7e-3, 0.30, status=FAILURE, limited=True),
            build_case(7, "Ida(rtol=0.01)", None, 0.20, group="rod"),
            build_case(
                8, "Radau(rtol=0.01)", None, None, group="rod", status="No consistent start"
            ),
        ],
    }


ODD_NAMES = [
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


def odd_page():
    """Return a study in which every name that users choose is odd."""
    page = study_page()
    page["title"] = "".join(ODD_NAMES)
    page["notes"] = list(ODD_NAMES)
    page["columns"] += [{"key": n, "label": n, "unit": n, "kind": "number"} for n in ODD_NAMES]
    for k, case in enumerate(page["cases"]):
        case["values"] |= {n: n for n in ODD_NAMES[: 1 + k]}
        case["label"] += ODD_NAMES[k]
        if case["curves"]:
            case["curves"]["observed"] = {n: np.cos(k * T) for n in ODD_NAMES}
    for group in page["groups"]:
        if group["frames"]:
            group["frames"]["glyphs"][1]["name"] = "".join(ODD_NAMES)
    return page


SPEEDS, HEIGHTS = (1.0, 2.0, 4.0), (0.1, 0.2, 0.3)


def sweep_page(without=()):
    """Return a sweep over three speeds and three heights; `without` lists cases without curves.

    The motion of the four corners is stored: a bar whose length is its speed.
    """
    cases = []
    for k, (i, j) in enumerate(np.ndindex(3, 3)):
        frames = bar_frames() | {"extent": [[0.0, 0.0], [2.0 * SPEEDS[i], 2.0 * SPEEDS[i]]]}
        for body in frames["glyphs"]:
            for axis in ("x", "y"):
                body[axis] = SPEEDS[i] * body[axis]
        values = {"speed": SPEEDS[i], "height": HEIGHTS[j], "tip.y max [m]": 10.0 * i + j}
        cases.append(
            build_case(
                k,
                f"speed={SPEEDS[i]:g}, height={HEIGHTS[j]:g}",
                None,
                0.1,
                at=[i, j],
                family=f"height={HEIGHTS[j]:g}",
                series=f"height={HEIGHTS[j]:g}",
                values=values | {"residuals": 1000 + k},
                curves=None if k in without else build_curves(k),
                frames=frames if i != 1 and j != 1 else None,
                file=f"trajectories/{k}.csv",
            )
        )
    number = {"kind": "number", "section": "results"}
    return {
        "title": "sweep",
        "groups": [{"id": "bar"}],
        "columns": [
            {"key": "label", "label": "case", "unit": "", "kind": "text"},
            {"key": "speed", "label": "speed", "unit": "rad/s", **number},
            {"key": "height", "label": "height", "unit": "m", **number},
            {"key": "tip.y max [m]", "label": "tip.y max", "unit": "m", **number},
            {"key": "residuals", "label": "residuals", "unit": "", **number, "section": "solver"},
        ],
        "axes": {"x": "speed", "y": "tip.y max [m]"},
        "sliders": [
            {"label": "speed", "unit": "rad/s", "values": list(SPEEDS)},
            {"label": "height", "unit": "m", "values": list(HEIGHTS)},
        ],
        "sequential": True,
        "cases": cases,
    }


def visible_labels(tab):
    """Return the labels of the visible rows of the case table."""
    return tab.locator("#table tbody tr:visible td.label").all_inner_texts()


def find_point(tab, number):
    """Return the position in the window of the point of a case."""
    entry = """(id) => state.charts.get("scatter").spec.series
        .flatMap(({data}) => data).find(([, , other]) => other === id)"""
    x, y, *_ = tab.evaluate(entry, f"case {number}")
    return screen_position(tab, "scatter", x, y)


def click_point(tab, number):
    tab.mouse.click(*find_point(tab, number))


def find_row(tab, number):
    return tab.locator(f"#table tr[data-case='case {number}']")


def list_lines(tab, key="observed"):
    """Return the name, color and dashes of each line of a chart over time."""
    lines = """(key) => (state.charts.get(key)?.spec.series ?? []).filter(({data}) => data.length)
        .map(({name, color, lineStyle}) => [name, color, String(lineStyle?.type)])"""
    return tab.evaluate(lines, key)


def count_curves(tab):
    """Return the number of curves in each panel."""
    return [len(list_lines(tab, key)) for key in ("observed", "energy", "error", "drift")]


def read_tooltip(tab):
    """Return the text of the visible tooltip, or ""."""
    tab.wait_for_timeout(50)
    readings = tab.locator(".reading:visible")
    return readings.first.inner_text() if readings.count() else ""


def visible_ranges(tab, key):
    """Return the visible ranges of x and y of a chart, of logarithmic axes as powers of ten."""
    extents = """(key) => ["xAxis", "yAxis"].map((axis) =>
        state.charts.get(key).instance.getModel().getComponent(axis).axis.scale.getExtent())"""
    return tuple(map(tuple, tab.evaluate(extents, key)))


def screen_position(tab, key, x, y):
    """Return the position of a point of a chart in the window."""
    tab.locator(f"[data-chart={key}] .plot").scroll_into_view_if_needed()
    position = """([key, x, y]) => {
        const { instance, spec, plot } = state.charts.get(key);
        const area = plot.getBoundingClientRect();
        const point = [fromValue(spec.x, x), fromValue(spec.y, y)];
        const [u, v] = instance.convertToPixel({ xAxisIndex: 0, yAxisIndex: 0 }, point);
        return [area.left + u, area.top + v];
    }"""
    return tab.evaluate(position, [key, x, y])


def wait_until(tab, expression):
    """Wait for a condition; the policy of the page forbids playwright's own `wait_for_function`."""
    for _ in range(1000):
        if tab.evaluate(expression):
            return
        tab.wait_for_timeout(20)
    raise AssertionError(expression)


def selected_options(choice):
    """Return the texts of the selected options of a list."""
    return choice.evaluate("list => [...list.selectedOptions].map((one) => one.textContent)")


def reset_button(tab, key):
    """Return the button of a chart that shows all."""
    return tab.locator(f"[data-chart={key}] .tools button")


def find_violations(tab):
    """Return the accessibility rules that a page in a browser violates, as axe-core tests them."""
    # The script is in the package of PyPI, so that nothing is downloaded.
    axe = pytest.importorskip("axe_playwright_python", reason="it needs axe-playwright-python")
    tab.evaluate(files(axe).joinpath("axe.min.js").read_text(encoding="utf-8"))
    return tab.evaluate(
        """async () => (await axe.run(document, {
            runOnly: ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"],
            rules: {
                "label-content-name-mismatch": {enabled: true},
                "target-size": {enabled: true},
            },
        })).violations.map(({id, nodes}) => [id, nodes.map(({html}) => html).slice(0, 3)])"""
    )


def open_tab(context, address, messages, requests):
    """Open an address and record the messages of its console and its requests."""
    tab = context.new_page()
    tab.on("console", lambda message: messages.append(message.text))
    tab.on("pageerror", lambda problem: messages.append(str(problem)))
    tab.on("request", lambda request: requests.append(request.url))
    tab.goto(address)
    return tab
