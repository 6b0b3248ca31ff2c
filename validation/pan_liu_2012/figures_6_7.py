"""Figures 6 and 7: tip deformation of the hub beam by curved and straight elements."""

import pandas as pd
from hub_beam import hub_beam
from pan_liu_2012.claims import (
    BY_CONSTRUCTION,
    FIGURE_6,
    FIGURE_7,
    FILLS_TEXT,
    VISIBLE,
    VISIBLE_TEXT,
    Judgement,
    Tables,
    axis_share_of_difference,
    claim,
    fits_axis,
    judge_condition,
)
from pan_liu_2012.runs import (
    HUB_BEAM_T_END,
    SCHEME,
    SECOND_METHOD,
    compare_methods,
    format_range,
    measure_deviation,
    observe_run,
)

CURVES = {
    "curved, 8 elements": {"elements": 8},
    "straight, 20 elements, 4 nodes": {"elements": 20, "elements_shape": "straight"},
}


def compute_figures_6_7(subtended: float) -> dict[str, pd.DataFrame]:
    """Compute u and v of the tip every 5 ms, by element type."""

    def run(integrator: object, **parameters: object) -> pd.DataFrame:
        return observe_run(
            hub_beam(subtended=subtended, **parameters), HUB_BEAM_T_END, 5e-3, integrator
        )

    histories = {name: run(SCHEME, **parameters) for name, parameters in CURVES.items()}
    ida = run(SECOND_METHOD, **CURVES["curved, 8 elements"])
    tables, pairs = {}, {}
    for figure, component in (("6", "u"), ("7", "v")):
        column = f"deformation.{component} [m]"
        curves = {f"{component}, {name} [m]": run[column] for name, run in histories.items()}
        tables[f"figure_{figure}_{subtended:g}_degrees"] = pd.DataFrame(curves)
        pairs[f"{figure}, {subtended:g} degrees, {component} [m]"] = (
            histories["curved, 8 elements"][column],
            ida[column],
        )
    return tables | compare_methods(pairs)


@claim(
    "Curved and straight elements give the same tip deformation",
    "Figs. 6, 7",
    "the curves coincide",
    "circular hub beam, u and v of the tip over 2 s, 20 straight 4-node against 8 curved elements",
    VISIBLE_TEXT,
)
def same_results(tables: Tables) -> Judgement:
    deviations, axis_share = {}, 0.0
    for angle in (30, 60):
        deviations[angle] = 0.0
        for figure, component, axis in (("6", "u", FIGURE_6), ("7", "v", FIGURE_7)):
            table = tables[f"figure_{figure}_{angle}_degrees"]
            straight = table[f"{component}, straight, 20 elements, 4 nodes [m]"]
            curved = table[f"{component}, curved, 8 elements [m]"]
            deviations[angle] = max(deviations[angle], measure_deviation(straight, curved))
            axis_share = max(axis_share, axis_share_of_difference(straight, curved, axis).max())
    limits = tables["table_2_limits"]
    apart = limits["curved against straight [-]"].max()
    return Judgement(
        f"apart by {deviations[30]:.2%} (30 degrees) and {deviations[60]:.2%} (60 degrees) of "
        f"the amplitude, {axis_share:.2%} of the axes",
        judge_condition(axis_share < VISIBLE),
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
    good = fits_axis(u.min(), u.max(), FIGURE_6) and fits_axis(v.min(), v.max(), FIGURE_7)
    return Judgement(
        f"u {format_range(u)} m, v {format_range(v)} m",
        BY_CONSTRUCTION if good else judge_condition(good),
        "density, length and frequency of the torque were chosen by these axes (readings.csv)",
    )


CLAIMS = (
    same_results,
    tip_range,
)
