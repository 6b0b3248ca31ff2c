"""Pan & Liu (2012): the stored tables are what the code gives, and what the paper's claims say."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from pan_liu_2012 import run, table_1, table_2
from pan_liu_2012.claims import summary
from pan_liu_2012.manoeuvre import EXACT, EXACT_PEAK, STEADY_EXTENSION
from pan_liu_2012.runs import deviation

RESULTS = Path(__file__).parents[1] / "validation" / "pan_liu_2012" / "results"
# Of tables that are no histories: what says nothing about the machine and the day, up to rounding.
ADAPTIVE = ("IDA", "wall time", "paper / wall", "against IDA", "late rms")
HISTORY_JOBS = [
    job
    for job in run.jobs()
    if job[0].startswith(("figure", "damping", "reach", "spin-up", "generalized-alpha"))
]


@cache
def stored(name):
    table = pd.read_csv(RESULTS / f"{name}.csv")
    return table.set_index("t [s]") if table.columns[0] == "t [s]" else table


@cache
def tables():
    return {path.stem: stored(path.stem) for path in RESULTS.glob("*.csv")}


def column(table, name):
    return stored(table)[name]


# The stored tables ----------------------------------------------------------------------------


@pytest.mark.slow(reason="runs of all models, half a minute on two cores")
@pytest.mark.parametrize(
    "job", HISTORY_JOBS, ids=lambda job: "-".join([job[0], *map(str, job[2])]).replace(" ", "-")
)
def test_histories_are_the_stored_ones_to_six_digits(job):
    _, function, given = job
    for name, table in function(*given).items():
        if not run.is_history(table) or "ida" in name:
            continue
        for header in table.columns:
            found, known = table[header].to_numpy(), stored(name)[header].to_numpy()
            # Fixed steps, Newton converged: another machine rounds differently, 2e-7 measured
            # between two sets of BLAS kernels.
            scale = 0.5 * (np.nanmax(known) - np.nanmin(known))
            assert_allclose(found, known, rtol=0, atol=1e-6 * scale, err_msg=f"{name}: {header}")


@pytest.mark.slow(reason="fifty runs of the hub beam")
def test_errors_over_the_number_of_elements_are_the_stored_ones():
    name, key = "generalized-alpha, 1e-3 s", (60.0, "circular")
    meshes = (4, 8, 16)
    found = table_2.errors(name, *key, meshes=meshes)["table_2_errors"]
    known = stored("table_2_errors")
    same = (known["integrator"] == name) & (known["subtended [deg]"] == key[0])
    known = known[same & (known["shape"] == key[1])]
    both = found.merge(known, on=["elements", "number"], suffixes=("", ", stored"))
    assert len(both) >= 11
    # Both are differences of runs that agree to 2e-7 on another machine.
    assert_allclose(both["error [-]"], both["error [-], stored"], rtol=1e-3, atol=1e-6)


def test_the_models_hold_the_data_of_the_paper():
    pd.testing.assert_frame_equal(table_1.table()["table_1"], stored("table_1"), rtol=1e-7)


def test_summary_is_made_from_the_stored_tables():
    found = summary(run.CLAIMS, tables())
    known = stored("summary")
    assert list(found["name"]) == list(known["name"])
    assert list(found["verdict"]) == list(known["verdict"])
    assert list(found["ours"].str[:10]) == list(known["ours"].str[:10])


def test_generalized_alpha_and_ida_agree_on_the_figures():
    apart = stored("second_method").set_index("column")["generalized-alpha against IDA [-]"]
    rates = apart.index.str.contains("flexible")
    # Half the paper's step against rtol 1e-6: both err by some 1e-4 in what moves slowly; the
    # linear rod on a flexible crank rings beyond what that step resolves.
    assert apart[~rates].max() < 2e-3
    assert apart[rates].max() < 5e-2


# The claims -----------------------------------------------------------------------------------


def needed(elements, criterion, integrator="gen"):
    table = stored("table_2")
    rows = table[table["integrator"].str.startswith(integrator) & (table["elements"] == elements)]
    return rows.set_index(["subtended [deg]", "shape"])[f"needed for {criterion:.1%}"]


def error(elements, subtended, number, shape="circular"):
    t = stored("table_2_errors")
    chosen = (t["elements"] == elements) & (t["number"] == number) & (t["shape"] == shape)
    chosen &= (t["subtended [deg]"] == subtended) & t["integrator"].str.startswith("gen")
    return float(t["error [-]"][chosen].iloc[0])


@pytest.mark.parametrize("integrator", ["gen", "IDA"])
@pytest.mark.parametrize("criterion", [0.01, 0.001])
def test_curved_elements_need_at_most_a_third_of_the_straight_ones(criterion, integrator):
    curved = needed("curved", criterion, integrator)
    assert curved.max() <= (3 if criterion == 0.01 else 5)
    for straight in ("straight, 4 nodes", "straight, 2 nodes"):
        # None of the meshes tried being fine enough is more elements still.
        other = needed(straight, criterion, integrator).fillna(np.inf)
        assert np.all(curved <= other / 3.0)


def test_curved_elements_as_printed_converge_with_the_numbers_of_table_2():
    printed = "curved, paper, full quadrature"
    # Measured 1.02, 0.43 and 0.15 %: "converged" in a figure.
    assert_allclose(error(printed, 30.0, 4), 0.0102, rtol=0.02)
    assert_allclose(error(printed, 60.0, 6), 0.0043, rtol=0.02)
    assert_allclose(error(printed, 60.0, 8), 0.00153, rtol=0.02)


def test_more_curvature_needs_more_elements():
    for elements in ("curved, paper, full quadrature", "straight, 4 nodes"):
        one = needed(elements, 0.01)
        assert one[60.0, "circular"] > one[30.0, "circular"]


def test_parabolic_beams_converge_like_circular_ones():
    for subtended in (30.0, 60.0):
        errors = [error("curved", subtended, 4, shape) for shape in ("circular", "parabolic")]
        assert_allclose(errors[1], errors[0], rtol=0.05)


def test_curved_and_straight_elements_give_the_same_figures_6_and_7():
    for angle, bound in ((30, 0.003), (60, 0.008)):
        for figure, c in (("6", "u"), ("7", "v")):
            table = stored(f"figure_{figure}_{angle}_degrees")
            straight = table[f"{c}, straight, 20 elements, 4 nodes [m]"]
            # The error of 20 straight elements, order 2.
            assert deviation(straight, table[f"{c}, curved, 8 elements [m]"]) < bound


def test_limits_of_curved_and_straight_elements_differ_by_the_curvature_in_the_quadratic_part():
    table = stored("table_2_limits")
    table = table[table["integrator"].str.startswith("gen")]
    apart = table.groupby("subtended [deg]")["curved against straight [-]"].max()
    # Elements with ((u' - v/R)^2 + (v' + u/R)^2)/2 meet the straight limit to 2e-7 (measured once
    # with a modified kernel); those of eq. (5) miss it by this.
    assert_allclose(apart[30.0], 1.6e-4, rtol=0.1)
    assert_allclose(apart[60.0], 1.0e-3, rtol=0.1)


def test_figure_5_linear_strain_is_off_and_angular_velocity_is_not():
    exact, linear = (
        column("figure_5a", f"gauge 1, lower, {strain}, damped [-]")
        for strain in ("nonlinear", "linear")
    )
    assert deviation(linear, exact) > 0.4
    assert_allclose(np.ptp(linear) / np.ptp(exact), 1.12, atol=0.02)
    exact, linear = (
        column("figure_5c", f"{strain}, damped [rad/s]") for strain in ("nonlinear", "linear")
    )
    assert deviation(linear, exact) < 0.1
    assert_allclose(np.ptp(linear) / np.ptp(exact), 1.0, atol=0.02)
    assert np.abs(exact).max() < 6.0


def test_figure_5b_cannot_be_met_with_gauge_2_where_it_is_printed():
    """A disagreement with the paper, held here so that nobody tunes it away."""
    scan = stored("gauge_scan")
    used = scan[scan["fills Fig. 5a"] & scan["fills Fig. 5c"]]
    assert "tangent 0.60 rad below the horizontal, bending up" in set(used["orientation"])
    assert not scan["fills Fig. 5b"].any()
    name = "lower, nonlinear, damped [-]"
    ratio = np.ptp(column("figure_5b", f"gauge 2, {name}"))
    ratio /= np.ptp(column("figure_5a", f"gauge 1, {name}"))
    assert_allclose(ratio, 1.10, atol=0.02)


def test_figure_9_curves_part_at_0_35_s_and_the_linear_one_swings_wider():
    exact, linear = (
        column("figure_9", f"{strain}, tangent, v, local [m]") for strain in ("nonlinear", "linear")
    )
    off = np.abs(linear - exact) / (0.5 * np.ptp(exact))
    assert off[:0.30].max() < 0.01
    assert off[:0.35].max() < 0.05
    assert off[:0.50].max() > 0.10
    assert_allclose(np.ptp(linear) / np.ptp(exact), 1.28, atol=0.02)


def test_figure_10_rates_differ_in_the_tangent_frame_alone():
    rates = stored("figure_10")
    tangent, chord = (
        deviation(rates[f"linear, {frame} [rad/s]"], rates[f"nonlinear, {frame} [rad/s]"])
        for frame in ("tangent", "chord")
    )
    assert tangent > 0.4
    assert chord < 0.05
    assert rates["nonlinear, tangent [rad/s]"].abs().max() < 1.5


def test_spin_up_holds_with_the_papers_strains_and_fails_with_linear_ones():
    """Simo & Vu-Quoc, J. Appl. Mech. 53 (1986) 855; published steady extension 5.14e-4 m."""
    table = stored("spin_up")
    steady = table.loc[15.0:, "u, nonlinear [m]"].mean()
    assert_allclose(steady, 5.14e-4, atol=5e-7)
    # eq. (5) leaves parts of the order of (v')^4 out: 0.1 % of the extension, 0.3 % of the peak.
    assert_allclose(steady, STEADY_EXTENSION, rtol=1.5e-3)
    assert_allclose(table["v, nonlinear [m]"].min(), EXACT_PEAK[0], rtol=4e-3)
    assert_allclose(table["u, nonlinear [m]"].min(), EXACT_PEAK[1], rtol=8e-3)
    known = stored("spin_up_against_exact")
    for component in "uv":
        error = known[f"{component}, nonlinear [m]"] - known[f"{component}, exact [m]"]
        assert np.abs(error).max() < 5e-3 * EXACT[f"{component}, exact [m]"].abs().max()
    assert table["v, linear [m]"].abs().max() > 10.0


def test_numerical_damping_takes_the_noise_and_leaves_the_motion():
    table = stored("generalized_alpha").set_index("integrator")
    plain = table[table.index.str.contains("plain start")]
    noise = plain["hinge force, above 200 Hz, rms [-]"].to_numpy()
    assert np.all(np.diff(noise) < 0.0), "falls with rho_inf"
    assert noise[0] > 0.05
    at_08 = table.loc["generalized-alpha, plain start, rho_inf 0.8"]
    assert at_08["hinge force, above 200 Hz, late rms [-]"] < 1e-3 * noise[0]
    assert abs(at_08["energy lost over largest kinetic [-]"]) < 1e-6
    assert at_08["error of the angle [-]"] < 1e-3
    cured = table.loc["generalized-alpha, cured start, rho_inf 0.8"]
    assert cured["hinge force, above 200 Hz, rms [-]"] < 0.5 * noise[4]
    assert table.loc["IDA, order 2, rtol 1e-05", "status"] == "ok"
    assert table.loc["IDA, order 5, rtol 1e-05", "status"].startswith("max_steps")


def test_reach_of_one_floating_frame():
    table = stored("reach").set_index("torque factor")
    one = table["error, 1 frame [-]"]
    assert_allclose(one, [0.0028, 0.0101, 0.0512, 0.250], rtol=0.02)
    # The error of each frame grows with the square of the deflection and more: halving the length
    # of the bodies takes it down at least fivefold.
    for more in ("2 frames", "4 frames", "8 frames"):
        less = table[f"error, {more} [-]"]
        assert np.all(one / less > 5.0)
        one = less
    assert np.all(table["error, linear, 1 frame [-]"] > 2.0 * table["error, 1 frame [-]"])


def test_both_frames_of_the_slider_crank_are_nearer_the_truth_than_the_linear_models():
    table = stored("reach_slider_crank").set_index(["frame", "bodies", "strain"])
    error = table["error of the slider [-]"]
    for frame, bound in (("tangent", 0.03), ("chord", 0.03)):
        assert error[frame, 1, "nonlinear"] < bound
        assert error[frame, 1, "nonlinear"] < error[frame, 1, "linear"]
        assert error[frame, 4, "nonlinear"] < 5e-4
