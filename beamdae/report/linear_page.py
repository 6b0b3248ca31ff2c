"""HTML page of a linear model: poles and transfer functions."""

from __future__ import annotations

import numpy as np

from beamdae.analysis.linear_dynamics.bode_diagram import (
    Bode,
    TransferFunction,
    bode,
)
from beamdae.analysis.linear_dynamics.linear_model import LinearModel
from beamdae.errors import format_count
from beamdae.report.page.page_content import PageCase, PageContent, PageTable
from beamdae.results.storage.files import versions

_GROUP = "transfers"  # id of the only group of cases
_MAX_VIBRATIONS, _MAX_DECAYS = 16, 8  # the slowest ones; growing ones are listed, too


def build_linear_page(content: LinearModel | Bode, title: str) -> PageContent:
    """Return the page content of a linear model: its poles and one case per transfer function.

    The charts show magnitude and phase over the frequency (Bode diagram).
    """
    diagram = content if isinstance(content, Bode) else bode(content)
    model, transfers = diagram.model, diagram.transfer_functions
    poles = model.poles[model.poles.imag >= 0.0]
    # Adding zero changes -0 to 0.
    ratios = -poles.real / np.where(poles == 0.0, 1.0, np.abs(poles)) + 0.0
    columns = np.stack([poles.imag / (2.0 * np.pi), ratios, poles.real + 0.0], axis=1)
    is_decay = poles.imag == 0.0
    is_listed = (~is_decay & (np.cumsum(~is_decay) <= _MAX_VIBRATIONS)) | (poles.real > 0.0)
    is_listed |= is_decay & (np.cumsum(is_decay) <= _MAX_DECAYS)
    listed = np.flatnonzero(is_listed).tolist()
    rows = [[str(k + 1), *(f"{x:.6g}" for x in columns[k])] for k in listed]
    facts = {
        "about": model.about,
        "size": f"{format_count(len(model.states), 'state')}, "
        f"{format_count(len(model.inputs), 'input')}, "
        f"{format_count(len(model.outputs), 'output')}",
        "largest growth rate": f"{np.max(poles.real) + 0.0:.6g} 1/s" if len(poles) else "-",
    }
    if not is_listed.all():
        fastest = np.max(np.abs(poles[~is_listed]))
        facts["not listed"] = f"{np.sum(~is_listed)} poles, up to |p| = {fastest:.4g} 1/s"
    values = [
        [x.name, x.unit, "output", f"{y:.6g}"]
        for x, y in zip(model.outputs, model.output_values, strict=True)
    ]
    quantities = [*([x.name, x.unit, "input", "-"] for x in model.inputs), *values]
    tables: list[PageTable] = [
        {"title": "Linear model", "rows": list(facts.items())},
        {
            "title": "Poles",
            "head": ["pole", "frequency [Hz]", "damping ratio [-]", "growth rate [1/s]"],
            "rows": rows,
        },
        {
            "title": "Inputs and outputs",
            "head": ["name", "unit", "kind", "value at the state"],
            "rows": quantities,
        },
    ]
    return {
        "title": title,
        "subtitle": f"{facts['size']}, {format_count(len(transfers), 'transfer function')}",
        "made": versions(),
        "notes": list(diagram.warnings),
        "groups": [{"id": _GROUP}],
        "time": {"name": "frequency", "unit": "Hz", "log": True},
        "noun": "transfer functions",
        "axes": None,
        "columns": [
            {"key": "label", "label": "output / input", "unit": "", "kind": "text"},
            {"key": "largest", "label": "largest magnitude", "unit": "", "kind": "number"},
            {"key": "at", "label": "at frequency", "unit": "Hz", "kind": "number"},
        ],
        "tables": [table for table in tables if table["rows"]],
        "cases": [_build_transfer_case(diagram, x) for x in transfers],
    }


def _build_transfer_case(diagram: Bode, x: TransferFunction) -> PageCase:
    """Return a transfer function, without curves if it is zero but for rounding errors."""
    magnitude, largest = np.abs(x.response), int(np.argmax(np.abs(x.response)))
    return {
        "id": f"{x.output}-{x.input}",
        "group": _GROUP,
        "label": x.name,
        "family": diagram.model.inputs[x.input].name,
        "values": {"largest": float(magnitude[largest]), "at": float(diagram.frequencies[largest])},
        "curves": None
        if x.is_noise
        else {
            "t": diagram.frequencies,
            "magnitude": {f"magnitude [{x.unit}]": magnitude},
            "phase": {"phase [deg]": x.phase},
        },
    }
