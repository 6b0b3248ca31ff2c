"""Drawing, description and data package of a mechanism; requires matplotlib, numpy and pandas."""

from __future__ import annotations

import hashlib
import json
import re
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from geometry import attachments, make_curve
from scorer import TIME, Reference

VERSION = "1.1.0"
_LINES_PER_PAGE = 60


def attachment_point(problem: dict[str, Any], attachment: dict[str, Any]) -> np.ndarray:
    """Return the position of an attachment in the reference configuration."""
    if "point" in attachment:
        return np.array(attachment["point"], dtype=float)
    body = next(x for x in problem["bodies"] if x["name"] == attachment["body"])
    curve = make_curve(body["curve"])
    return np.asarray(curve.point(attachment["fraction"] * curve.length), dtype=float)


def _find_attachments(problem: dict[str, Any], name: str) -> list[dict[str, Any]]:
    return [x for x in attachments(problem) if x["body"] == name]


def draw(problem: dict[str, Any], reference: pd.DataFrame | None, path: Path | None) -> Any:
    """Draw the reference configuration and the paths of the outputs; return the figure."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams["svg.hashsalt"] = problem["name"]
    figure, axis = plt.subplots(figsize=(5.5, 4.2), layout="constrained")
    if reference is not None:
        for k, output in enumerate(problem["outputs"]):
            x, y = (f"{output['name']}.{q} [m]" for q in "xy")
            if x in reference and y in reference:
                label = f"path of {output['name']}"
                axis.plot(reference[x], reference[y], color=f"C{k}", lw=0.9, alpha=0.7, label=label)
    for body in problem["bodies"]:
        if body["type"] == "beam":
            curve = make_curve(body["curve"])
            line = np.array([curve.point(s) for s in np.linspace(0.0, curve.length, 41)])
            axis.plot(*line.T, color="0.15", lw=2.5, solid_capstyle="round", zorder=3)
            continue
        points = [attachment_point(problem, x) for x in _find_attachments(problem, body["name"])]
        polygon = np.array([*points, body["center"]])
        axis.plot(*polygon.T, color="0.55", lw=6, solid_capstyle="round", zorder=2)
        axis.plot(*body["center"], "+", color="0.2", zorder=4)
    markers = {"revolute": "o", "weld": "s", "driver": "D", "point_on_line": "_"}
    for joint in problem["joints"]:
        point = attachment_point(problem, joint["b"])
        size = {"driver": 11, "point_on_line": 26}.get(joint["type"], 7)
        fixed = joint["a"]["body"] == "ground"
        axis.plot(
            *point,
            markers[joint["type"]],
            ms=size,
            mfc="none" if joint["type"] == "driver" else "#f0c040" if fixed else "white",
            mec="0.1",
            zorder=5,
        )
    for particle in problem.get("point_masses", []):
        axis.plot(*attachment_point(problem, particle["on"]), "o", ms=10, color="0.3", zorder=4)
    for spring in problem.get("springs", []):
        ends = np.array([attachment_point(problem, spring[end]) for end in "ab"])
        axis.plot(*ends.T, ":", color="C3", lw=2, zorder=4)
    for contact in problem.get("contacts", []):
        x, y = contact["a"]["point"]
        nx, ny = contact["normal"]
        half = 0.05 * max(np.ptp([axis.get_xlim(), axis.get_ylim()], axis=1))
        axis.plot([x - half * ny, x + half * ny], [y + half * nx, y - half * nx], color="C2", lw=3)
    for load in problem.get("loads", []):
        point = attachment_point(problem, load["on"])
        if load["type"] == "moment":
            axis.annotate("moment", point, (12, 12), textcoords="offset points", color="C3")
            continue
        direction = np.array([_law_sign(law) for law in load["components"]])
        axis.annotate(
            "force",
            point,
            -42.0 * direction,
            textcoords="offset points",
            ha="center",
            va="center",
            color="C3",
            arrowprops={"arrowstyle": "-|>", "color": "C3"},
        )
    axis.set_aspect("equal", adjustable="datalim")
    axis.margins(0.12)
    axis.set_xlabel("x [m]")
    axis.set_ylabel("y [m]")
    axis.grid(alpha=0.25)
    handles, _ = axis.get_legend_handles_labels()
    if handles:
        figure.legend(fontsize=8, loc="outside lower center", ncols=3)
    if path is not None:
        figure.savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)
        plt.close(figure)
    return figure


def _law_sign(law: Any) -> float:
    """Return the sign of the first nonzero value of a law."""
    if isinstance(law, int | float):
        return float(np.sign(law))
    values = [law["amplitude"]] if "amplitude" in law else law["values"]
    return float(np.sign(next((x for x in values if x), 0.0)))


def _format_law(law: Any) -> str:
    if isinstance(law, int | float):
        return f"{law:g}"
    values = ", ".join(
        f"{key} {value:.6g}" if isinstance(value, int | float) else f"{key} {value}"
        for key, value in law.items()
        if key != "type"
    )
    return f"{law['type']} ({values})"


def _format_place(attachment: dict[str, Any]) -> str:
    if "point" in attachment:
        return f"{attachment['body']} at ({', '.join(f'{x:.6g}' for x in attachment['point'])})"
    return f"{attachment['body']} at {attachment['fraction']:g} L"


def describe(problem: dict[str, Any], confirmation: dict[str, Any]) -> str:
    """Return the description in Markdown; the problem contains the same data in full."""
    end, step = problem["time"]["end"], problem["time"]["output_step"]
    is_static = problem.get("analysis") == "static"
    extent = "path of equilibria with the parameter t from 0 to" if is_static else "motion of"
    lines = [
        f"# {problem['title']}",
        "",
        problem["summary"],
        "",
        f"Gravity ({problem['gravity'][0]:g}, {problem['gravity'][1]:g}) m/s^2; {extent} "
        f"{end:g} s, rows every {step:g} s. Sources: {'; '.join(problem['sources'])}.",
        "",
    ]
    if problem["sections"]:
        lines += [
            "| section | E [Pa] | nu | rho [kg/m^3] | A [m^2] | I [m^4] | k_s | damping time [s] |",
            "|---|---|---|---|---|---|---|---|",
        ]
        for name, data in problem["sections"].items():
            material = problem["materials"][data["material"]]
            numbers = [*material.values(), data["area"], data["second_moment"]]
            numbers += [data["shear_coefficient"], data.get("damping_time", 0.0)]
            lines.append(f"| {name} | {' | '.join(f'{x:.6g}' for x in numbers)} |")
        lines.append("")
    lines += ["| part | kind | data |", "|---|---|---|"]
    for body in problem["bodies"]:
        data = {k: v for k, v in body.items() if k not in ("type", "name")}
        lines.append(f"| {body['name']} | {body['type']} | {_format_data(data)} |")
    for mass in problem.get("point_masses", []):
        place = _format_place(mass["on"])
        lines.append(f"| {mass['name']} | point mass | {mass['mass']:g} kg, {place} |")
    for joint in problem["joints"]:
        text = f"{_format_place(joint['a'])}; {_format_place(joint['b'])}"
        if "law" in joint:
            text += f"; {_format_law(joint['law'])} rad"
        lines.append(f"| {joint['name']} | {joint['type']} | {text} |")
    for load in problem.get("loads", []):
        laws = [_format_law(x) for x in load.get("components", [load.get("law")])]
        unit = "N m" if load["type"] == "moment" else "N"
        text = f"{_format_place(load['on'])}: {'; '.join(laws)} {unit}"
        lines.append(f"| {load['name']} | {load['type']} | {text} |")
    for spring in problem.get("springs", []):
        text = f"{_format_place(spring['a'])}; {_format_place(spring['b'])}; "
        text += f"{spring['stiffness']:g} N/m, {spring.get('damping', 0.0):g} N s/m, free length "
        lines.append(f"| {spring['name']} | spring | {text}{spring['free_length']:g} m |")
    for contact in problem.get("contacts", []):
        text = f"{_format_place(contact['a'])}; {_format_place(contact['b'])}; "
        text += _format_data({k: v for k, v in contact.items() if k not in ("name", "a", "b")})
        lines.append(f"| {contact['name']} | contact | {text} |")
    if "control" in problem:
        control = problem["control"]
        text = f"factor of {control['load']}: {control['quantity']} of "
        text += f"{_format_place(control['on'])} "
        text += (
            f"from ({control['from'][0]:g}, {control['from'][1]:g}) " if "from" in control else ""
        )
        text += f"changes by {_format_law(control['law'])}"
        lines.append(f"| path | control | {text} |")
    lines += ["", "## Reference", ""]
    lines += [
        f"Status: **{confirmation['status']}**. Largest uncertainty: "
        f"{confirmation['uncertainty']:.1e} of half the range of a column (own refinement: "
        f"{confirmation['refinement']:.1e}).",
        "",
        "| code | setting | largest difference / half range | column |",
        "|---|---|---|---|",
    ]
    for code in confirmation["codes"]:
        value = "failed" if code["largest"] is None else f"{code['largest']:.1e}"
        lines.append(f"| {code['tool']} | {code['setting']} | {value} | {code['column']} |")
    return "\n".join(lines) + "\n"


def _format_data(data: Any) -> str:
    text = json.dumps(data)
    text = re.sub(r"-?\d+\.\d{6,}(e-?\d+)?", lambda x: f"{float(x[0]):.6g}", text)
    return text.replace('"', "")[1:-1]


def checksum(problem: dict[str, Any]) -> str:
    """Return the checksum of a problem, independent of the form of its file."""
    data = {key: value for key, value in problem.items() if key != "$schema"}
    return f"sha256:{hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()}"


def write(
    folder: Path, problem: dict[str, Any], confirmation: dict[str, Any], reference: Reference
) -> None:
    """Write problem, confirmation, reference, description and drawing, with a data package."""
    (folder / "problem.json").write_text(json.dumps(problem, indent=2) + "\n")
    (folder / "confirmation.json").write_text(json.dumps(confirmation, indent=1) + "\n")
    (folder / "description.md").write_text(describe(problem, confirmation))
    solution, uncertainty = reference
    uncertainty = uncertainty.drop(columns=TIME).add_prefix("uncertainty of ")
    columns = [*solution, *uncertainty]
    texts = [solution.map("{:.10g}".format), uncertainty.map("{:.1e}".format)]
    pd.concat(texts, axis=1).to_csv(folder / "reference.csv", index=False)
    draw(problem, solution, folder / "drawing.svg")
    fields = [
        {
            "name": column,
            "type": "number",
            "unit": unit[1] if (unit := re.search(r"\[(.*)\]", column)) else "",
            "constraints": {"required": True},
        }
        for column in columns
    ]
    table = {
        "type": "table",
        "format": "csv",
        "mediatype": "text/csv",
        "encoding": "utf-8",
        "schema": {"fields": fields, "primaryKey": [TIME]},
    }
    resources = [
        {
            "name": file.name.replace(".", "-").lower(),
            "path": file.name,
            "bytes": file.stat().st_size,
            "hash": f"sha256:{hashlib.sha256(file.read_bytes()).hexdigest()}",
        }
        | (table if file.suffix == ".csv" else {})
        for file in sorted(folder.iterdir())
        if file.is_file() and file.name != "datapackage.json"
    ]
    package = {
        "name": problem["name"].replace("_", "-"),
        "title": problem["title"],
        "description": problem["summary"],
        "version": VERSION,
        "licenses": [
            {
                "name": "CC-BY-4.0",
                "title": "Creative Commons Attribution 4.0 International",
                "path": "https://creativecommons.org/licenses/by/4.0/",
            }
        ],
        "resources": resources,
    }
    (folder / "datapackage.json").write_text(json.dumps(package, indent=1) + "\n")


# Problems with filled forms of the IFToMM Library of Computational Benchmark Problems.
IFTOMM = (
    "drop_on_stop",
    "flexure_parallelogram",
    "four_bar_flexible",
    "slider_crank_flexible",
    "spin_up",
)
_MOTIVATION = {
    "drop_on_stop": "Contact of a flexible link excites its bending modes; the law of the stop is "
    "stated in full, so results of different codes are comparable.",
    "flexure_parallelogram": "Stages on leaf springs are closed loops in which bending and axial "
    "stiffness differ by six orders of magnitude.",
    "four_bar_flexible": "A closed loop with flexible links under large rotations, which rigid "
    "benchmark problems do not cover.",
    "slider_crank_flexible": "The most frequent example of flexible mechanisms in the literature, "
    "which no two papers state alike.",
    "spin_up": "The run-up of a flexible arm tests the stiffening by centrifugal forces.",
}
_METHOD = (
    "beamdae, refined to 0.1 %: elements, strains and tolerances refined until the measured errors "
    "of positions and angles are below 0.1 %; the time includes all refinements."
)
_MODEL = (
    "Beams are Reissner's planar beams: with the axes t and n of the section and the shear modulus "
    "G = E/(2 (1 + nu)), N = EA (r'.t - 1), Q = k_s GA r'.n and M = EI (theta' - theta0'). Each "
    "force contains its strain rate times the damping time and the stiffness. The mass per length "
    "rho A moves with the axis, and the rotary inertia rho I with the section. A place of a beam "
    "is a fraction of its length L. An angle is the rotation from the reference configuration. A "
    "contact (point of a line of the ground; contact point) with the penetration d > 0 and the "
    "slip s along the line has the normal force k d^e max(0, 1 + X d') with the stiffness k, the "
    "exponent e and the hysteresis X, and the friction m N tanh(s/w) with the friction m and the "
    "friction speed w. The file problem.schema.json defines curves and laws of time."
)
_ERROR = (
    "The error of a column is the largest difference from the reference over all rows, divided by "
    "half the range of the column in the reference. The error of a solution is that of its worst "
    "column."
)


def iftomm_sections(problem: dict[str, Any], confirmation: dict[str, Any]) -> dict[str, str]:
    """Return the sections of the description that the library requires."""
    end, step = problem["time"]["end"], problem["time"]["output_step"]
    data, _, _ = describe(problem, confirmation).partition("## Reference")
    rows = [line for line in data.splitlines() if line.startswith("|") and "---" not in line]
    table = [" ; ".join(cell.strip() for cell in row.strip("|").split("|")) for row in rows]
    columns = [
        f"{x['name']}.{q} [{'rad' if q == 'angle' else 'm'}]"
        for x in problem["outputs"]
        for q in x["quantities"]
    ]
    moving = [x["name"] for x in problem["bodies"] if x.get("initial")]
    start = "All bodies are at rest" if not moving else f"Initial motion: {', '.join(moving)}"
    return {
        "Motivation": f"{problem['summary']} {_MOTIVATION[problem['name']]}",
        "Sources": "; ".join(problem["sources"]) + ".",
        "Physical model": _MODEL,
        "Geometric and inertial data, joints and forces (SI units)": "\n".join(table),
        "Gravity": f"({problem['gravity'][0]:g}, {problem['gravity'][1]:g}) m/s^2.",
        "Initial conditions": f"{start} in the reference configuration, in which beams are free of "
        "stress and all joints are closed. All loads act from t = 0 on.",
        "Total simulation time": f"{end:g} s.",
        "Error definition": _ERROR,
        "Acceptance": "The error is at most 1e-2 (low precision) or 1e-4 (high precision). The "
        f"uncertainty of the reference is {confirmation['uncertainty']:.1e}.",
        "Objective": "Shortest processor time of the simulation for each precision.",
        "Results": f"Rows every {step:g} s of time [s] and {', '.join(columns)}.",
        "File format": "Text file with one header line; columns separated by blanks, ten digits.",
    }


def write_iftomm(
    folder: Path,
    problem: dict[str, Any],
    confirmation: dict[str, Any],
    reference: pd.DataFrame,
    result: Path,
    row: dict[str, Any],
) -> None:
    """Write description (PDF), results (text) and entries of both forms into folder/iftomm.

    `result` is the CSV file of the submitted solution, if it has run, and `row` its row of the
    scores.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.backends.backend_pdf import PdfPages

    target = folder / "iftomm"
    target.mkdir(exist_ok=True)
    lines: list[tuple[str, str]] = [(problem["title"], "title")]
    for title, text in iftomm_sections(problem, confirmation).items():
        lines.append((title, "heading"))
        for paragraph in text.split("\n"):
            lines += [(line, "text") for line in textwrap.wrap(paragraph, 105)]
    with PdfPages(target / "description.pdf", metadata={"CreationDate": None}) as pages:
        for first in range(0, len(lines), _LINES_PER_PAGE):
            figure = plt.figure(figsize=(8.27, 11.69))
            for i, (line, kind) in enumerate(lines[first : first + _LINES_PER_PAGE]):
                size = {"title": 14, "heading": 10.5, "text": 9}[kind]
                weight = "normal" if kind == "text" else "bold"
                text = line.replace("$", r"\$")
                figure.text(0.09, 0.94 - 0.0145 * i, text, size=size, weight=weight)
            pages.savefig(figure)
            plt.close(figure)
        drawing = draw(problem, reference, None)
        pages.savefig(drawing)
        plt.close(drawing)
    tables = {"reference": reference}
    if result.exists():
        tables["solution"] = pd.read_csv(result)
    for name, table in tables.items():
        columns = [column.replace(" ", "_") for column in table.columns]
        table.to_csv(
            target / f"{name}.txt", sep=" ", index=False, header=columns, float_format="%.10g"
        )
    form = ["# Form: problem", "", "| entry | value |", "|---|---|"]
    form += [f"| Title | {problem['title']} |", "| Authors | The beamdae developers |"]
    form += ["| Description file | description.pdf |", "| Reference file | reference.txt |"]
    form += [
        "",
        "# Form: solution",
        "",
        "| entry | value |",
        "|---|---|",
        f"| Title | Solution for {problem['title']} |",
        "| Authors | The beamdae developers |",
        f"| Accuracy | {row['error']:.1e} |",
        f"| CPU time | {row['processor_time']:.2f} s |",
        "| CPU / GPU | one core of an x86-64 server (2020s) |",
        "| Operating system | Linux |",
        f"| Method description | {_METHOD} |",
        "| Results file | solution.txt |",
        "| Additional material | problem.json, problem.schema.json, reference.csv |",
    ]
    (target / "forms.md").write_text("\n".join(form) + "\n")
