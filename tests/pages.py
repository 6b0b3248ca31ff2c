"""Pages of studies that no run made, and what is on them in a browser."""

import numpy as np

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
        "difference": {"observed": {"tip.x [m]": (-error * t).tolist()}},
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


def classes(locator):
    return [locator.nth(k).get_attribute("class") for k in range(locator.count())]


def seen(tab, key):
    """What is between the axes of a chart: ranges of x and y."""
    ends = "({x, y}) => [x, y].flatMap((axis) => [axis.back(axis.from), axis.back(axis.to)])"
    x0, x1, y0, y1 = tab.evaluate(f"({ends})(state.charts.get({key!r}))")
    return (x0, x1), (y0, y1)


def place(tab, key, x, y):
    """Where a value of a chart is in the window."""
    tab.locator(f"[data-chart={key}] .plot").scroll_into_view_if_needed()
    found = """([key, x, y]) => {
        const made = state.charts.get(key), at = made.plot.getBoundingClientRect();
        const zoom = at.width / made.box.width;
        return [at.left + zoom * made.x.at(x), at.top + zoom * made.y.at(y)];
    }"""
    return tab.evaluate(found, [key, x, y])


def until(tab, expression):
    """Wait for what a page makes true; its policy forbids playwright's own waiting."""
    for _ in range(100):
        if tab.evaluate(expression):
            return
        tab.wait_for_timeout(20)
    raise AssertionError(expression)


def chosen_options(choice):
    """What a list of choices shows."""
    return choice.evaluate("list => [...list.selectedOptions].map((one) => one.textContent)")
