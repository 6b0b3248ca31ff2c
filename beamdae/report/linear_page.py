"""HTML page of a linear model: poles and transfer functions."""

from __future__ import annotations

from typing import Any

import numpy as np

from beamdae.analysis.linear_dynamics.bode_diagram import (
    Bode,
    TransferFunction,
    bode,
)
from beamdae.analysis.linear_dynamics.linear_model import LinearModel
from beamdae.errors import format_count
from beamdae.report.page.page_content import Content
from beamdae.report.page_parts import create_cases, describe_columns, describe_page, fact_table

_MAX_VIBRATIONS, _MAX_DECAYS = 16, 8  # the slowest ones; growing ones are listed, too


def build_linear_page(content: LinearModel | Bode, title: str) -> Content:
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
    import pandas as pd

    largest = [int(np.argmax(np.abs(x.response))) for x in transfers]
    table = pd.DataFrame(
        {
            "largest magnitude": [
                float(np.abs(x.response[k])) for x, k in zip(transfers, largest, strict=True)
            ],
            "at frequency [Hz]": diagram.frequencies[largest],
        }
    )
    curves = [
        {"family": model.inputs[x.input].name, "curves": _select_response(diagram, x)}
        for x in transfers
    ]
    return describe_page(
        title,
        f"{facts['size']}, {format_count(len(transfers), 'transfer function')}",
        diagram.warnings,
        [
            fact_table("Linear model", facts),
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
        ],
        time={"name": "frequency", "unit": "Hz", "log": True},
        noun="transfer functions",
        axes=None,
        columns=describe_columns("output / input", table),
        cases=create_cases(table, [x.name for x in transfers], *curves),
    )


def _select_response(diagram: Bode, x: TransferFunction) -> dict[str, Any] | None:
    """Return the curves of a transfer function; None if it is zero but for rounding errors."""
    if x.is_noise:
        return None
    return {
        "t": diagram.frequencies,
        "magnitude": {f"magnitude [{x.unit}]": np.abs(x.response)},
        "phase": {"phase [deg]": x.phase},
    }
