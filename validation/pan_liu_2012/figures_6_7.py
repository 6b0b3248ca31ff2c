"""Figures 6 and 7: tip deformation of the hub beam, curved beside straight elements."""

from __future__ import annotations

import pandas as pd
from hub_beam import hub_beam

from pan_liu_2012.axes import FIGURE_6, FIGURE_7, FILLS_TEXT, VISIBLE, VISIBLE_TEXT, fills, seen
from pan_liu_2012.claims import BY_CONSTRUCTION, Judgement, Tables, agrees, claim
from pan_liu_2012.runs import SCHEME, WITNESS, deviation, observed, second_method, span

CURVES = {
    "curved, 8 elements": {"elements": 8},
    "straight, 20 elements, 4 nodes": {"elements": 20, "elements_shape": "straight"},
}


def histories(subtended: float) -> dict[str, pd.DataFrame]:
    """Components u and v of the tip every 5 ms, by element type."""

    def run(integrator: object, **parameters: object) -> pd.DataFrame:
        return observed(hub_beam(subtended=subtended, **parameters), 2.0, 5e-3, integrator)

    found = {name: run(SCHEME, **parameters) for name, parameters in CURVES.items()}
    witness = run(WITNESS, **CURVES["curved, 8 elements"])
    tables, pairs = {}, {}
    for figure, component in (("6", "u"), ("7", "v")):
        column = f"deformation.{component} [m]"
        curves = {f"{component}, {name} [m]": run[column] for name, run in found.items()}
        tables[f"figure_{figure}_{subtended:g}_degrees"] = pd.DataFrame(curves)
        pairs[f"{figure}, {subtended:g} degrees, {component} [m]"] = (
            found["curved, 8 elements"][column],
            witness[column],
        )
    return tables | second_method(pairs)


@claim(
    "Curved and straight elements give the same tip deformation",
    "Figs. 6, 7",
    "the curves coincide",
    "circular hub beam, u and v of the tip over 2 s, 20 straight 4-node against 8 curved elements",
    VISIBLE_TEXT,
)
def same_results(tables: Tables) -> Judgement:
    found, shown = {}, 0.0
    for angle in (30, 60):
        found[angle] = 0.0
        for figure, component, axis in (("6", "u", FIGURE_6), ("7", "v", FIGURE_7)):
            table = tables[f"figure_{figure}_{angle}_degrees"]
            straight = table[f"{component}, straight, 20 elements, 4 nodes [m]"]
            curved = table[f"{component}, curved, 8 elements [m]"]
            found[angle] = max(found[angle], deviation(straight, curved))
            shown = max(shown, seen(straight, curved, axis).max())
    limits = tables["table_2_limits"]
    apart = limits["curved against straight [-]"].max()
    return Judgement(
        f"apart by {found[30]:.2%} (30 degrees) and {found[60]:.2%} (60 degrees) of the amplitude, "
        f"{shown:.2%} of the axes",
        agrees(shown < VISIBLE),
        f"their limits differ by up to {apart:.2%} of the amplitude, because eq. (5) leaves the "
        "curvature out of its quadratic part",
    )


@claim(
    "The tip deformation stays within the axes",
    "Figs. 6, 7",
    "u -0.10 .. 0.10 m, v -0.10 .. 0.12 m",
    "circular hub beam, 60 degrees, 8 curved elements",
    FILLS_TEXT,
)
def tip_range(tables: Tables) -> Judgement:
    u = tables["figure_6_60_degrees"]["u, curved, 8 elements [m]"]
    v = tables["figure_7_60_degrees"]["v, curved, 8 elements [m]"]
    good = fills(u.min(), u.max(), FIGURE_6) and fills(v.min(), v.max(), FIGURE_7)
    return Judgement(
        f"u {span(u)} m, v {span(v)} m",
        BY_CONSTRUCTION if good else agrees(good),
        "density, length and frequency of the torque were chosen by these axes (readings.csv)",
    )


CLAIMS = (
    same_results,
    tip_range,
)
