"""Published cases and references of validation, by every integrator."""

import warnings

import numpy as np
import pandas as pd
import pytest
from benchmarks.cases import PARALLELOGRAM
from benchmarks.mechanism_cases import MECHANISM_CASES, moving_load
from benchmarks.orders import CURVES, FORMULATIONS, observe_orders
from benchmarks.systems import (
    car_axis,
    cycloid_slide,
    knife_edge,
    rotating_rod,
    spring_slider_crank,
)
from conformance import integrators
from mechanisms import rectangle
from numpy.testing import assert_allclose
from scipy.integrate import simpson
from scipy.optimize import brentq
from tolerances.cases import ALL
from tolerances.mechanisms import STEEL, cantilever
from tolerances.references import SUMMARY, reference_uncertainties, solve_small_vibrations

import beamdae as bd

ADAPTIVE = [bd.Ida(1e-6), bd.Radau(1e-6), bd.GeneralizedAlpha(rtol=1e-6)]


@pytest.mark.parametrize("integrator", ADAPTIVE, ids=lambda x: x.method)
@pytest.mark.parametrize("start", [-0.99, -0.3])
def test_descent_time_is_independent_of_the_start(start, integrator):
    solution = bd.simulate(cycloid_slide(start=start), integrator, 1.0)
    lowest = brentq(lambda t: np.interp(t, solution.t, solution.q[:, 2]), 0.4, 0.9)
    # Linear interpolation of the arc length is accurate to (1 ms * omega)^2 / 6.
    assert lowest == pytest.approx(np.pi * np.sqrt(0.5 / 9.81), rel=100e-6)
    # Energy is conserved without friction or driver.
    assert solution.quality.energy_imbalance < 1e-5


@pytest.mark.parametrize("integrator", ADAPTIVE, ids=lambda x: x.method)
def test_work_of_the_rod_driver_matches_closed_form(integrator):
    solution = bd.simulate(rotating_rod, integrator)
    work = solution.energies["energy.work_of_drivers [J]"]
    exact = 2.0**2 * 0.1**2 * np.sinh(2.0 * solution.t) ** 2
    # Work is quadratic in the motion.
    assert_allclose(work, exact, rtol=0.0, atol=200e-6 * exact[-1])


def test_energies_of_the_slider_crank_match_sundials():
    solution = bd.simulate(spring_slider_crank, bd.Radau(1e-8), output_step=5e-3)
    # idasSlCrank_ASAi_dns, integral of the kinetic energy, at a tolerance of 1e-6 per step.
    kinetic = solution.energies["energy.kinetic [J]"]
    assert simpson(kinetic, x=solution.t) == pytest.approx(3.3366160662909388, rel=1e-5)
    # Work of the force of 1 N along the path of the end of the rod.
    _, slider, rod = solution.q.T
    assert_allclose(
        solution.energies["energy.work_of_loads [J]"],
        (slider + np.cos(rod)) - (slider + np.cos(rod))[0],
        rtol=0.0,
        atol=1e-7,
    )


@pytest.mark.parametrize(
    "model", [car_axis, spring_slider_crank, cycloid_slide, rotating_rod, knife_edge]
)
@pytest.mark.parametrize("integrator", ADAPTIVE, ids=lambda x: x.method)
def test_energy_balance_closes(model, integrator):
    solution = bd.simulate(model, integrator)
    assert solution.quality.energy_imbalance < 100e-6


@pytest.mark.parametrize(
    "integrator",
    [bd.Ida(1e-5), bd.Radau(1e-5), bd.GeneralizedAlpha(1e-3), bd.GeneralizedAlpha(rtol=1e-5)],
    ids=["Ida", "Radau", "fixed", "GeneralizedAlpha"],
)
def test_parallelogram_stays_on_its_branch_at_change_points(integrator):
    """Its bars are collinear 19 times in 30 s, and each time another branch begins.

    Rounding errors decide whether Ida passes them: at 1e-5, the run ends with some BLAS kernels and
    stops with others, and so it does at other tolerances.
    """
    equations = PARALLELOGRAM.equations
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "simulate: the run was not", bd.BeamdaeWarning)
        solution = bd.simulate(equations, integrator, 30.0)
    if not (isinstance(integrator, bd.Ida) and "singular position" in solution.status.sentence):
        assert solution.status.success, solution.status.sentence
    exact = PARALLELOGRAM.answer(solution.t)
    # The error of the rate is 100 rtol or of second order in the step, over 60 rad.
    assert_allclose(solution.q, exact["q"], rtol=0.0, atol=100e-5)
    assert_allclose(solution.v, exact["v"], rtol=0.0, atol=2.0 * 100e-5)
    # The drift does not grow: constraints are enforced at every step.
    assert solution.quality.max_position_drift < 1e-5 * equations.length
    assert any("lose rank" in text or "singular" in text for text in solution.warnings)


STEP, RTOL = 2.5e-4, 1e-6


BEAM_CASES = ("moving load", "follower load")


every_case = pytest.mark.parametrize(
    "case",
    [
        pytest.param(
            case,
            marks=[pytest.mark.slow(reason="runs of seconds")] if case.name in BEAM_CASES else [],
        )
        for case in MECHANISM_CASES
    ],
    ids=lambda case: case.name,
)


@every_case
@integrators(RTOL, STEP, newton_tolerance=1e-9)
def test_motion_matches_closed_form(case, integrator):
    solution = case.run(integrator)
    # Fixed steps: ten times the phase error of the trapezoidal rule, because a reversal of friction
    # may occur within a step.
    phase_error = 10.0 * (case.rate * STEP) ** 2 / 12.0 * case.rate * case.t_end
    bound = 100.0 * RTOL if integrator.accuracy.name == "rtol" else phase_error
    for name, (published, computed) in case.compare(solution).items():
        error = np.max(np.abs(computed - published)) / np.max(np.abs(published))
        # The error test does not include forces.
        factor = 10.0 if "[N" in name else 1.0
        assert error < case.model_error + factor * max(bound, 1e-6), name
    # Work is quadratic in the motion.
    assert solution.quality.energy_imbalance < 10.0 * max(bound, 1e-5)


@pytest.mark.slow(reason="the whole spectrum of a beam")
@integrators(1e-4, 2e-3)
def test_load_in_the_opposite_direction_gives_the_same_deflection(integrator):
    forward, backward = (
        bd.simulate(moving_load(speed=speed), integrator, 4.0 / 3.0, 0.05) for speed in (3.0, -3.0)
    )
    y = "middle.y [m]"
    amplitude = np.abs(forward.columns[y]).max()
    np.testing.assert_allclose(
        backward.columns[y], forward.columns[y], rtol=0.0, atol=1e-3 * amplitude
    )


BY_NAME = {case.name: case for case in ALL}


@pytest.mark.slow(reason="a fifth of a second")
def test_references_have_all_rows_and_columns():
    assert len({case.name for case in ALL}) == len(ALL)
    for case in ALL:
        reference = case.load_reference(("t [s]", *case.compared))
        assert reference.shape[0] == case.rows
        assert_allclose(reference[:, 0], case.times, rtol=1e-8)
        assert np.all(np.isfinite(reference))
        assert np.all(np.ptp(reference, axis=0) > 0.0)


@pytest.mark.slow(reason="a fifth of a second")
def test_two_methods_agree_on_every_reference():
    uncertainties = reference_uncertainties()
    assert set(uncertainties.index.get_level_values("case")) == set(BY_NAME)
    disagreements = pd.Series(
        {name: uncertainties[name][list(case.columns)].max() for name, case in BY_NAME.items()}
    )
    # The second method is less accurate for angles with undamped modes after a step:
    # generalized-alpha at large bending (Radau converges to 5e-7), Radau at its tightest tolerance
    # where the beam moves 0.05 mm.
    assert disagreements.pop("cantilever_10N") < 5e-4
    assert disagreements.pop("cantilever_30mm") < 3e-5
    assert disagreements.max() < 1e-5
    # The newer set compares with errors down to 1e-5 of the amplitude.
    for case in ALL:
        if case.set != "new":
            continue
        guaranteed = uncertainties[case.name][list(case.columns + case.deflections)]
        # Here Radau stalls below 1e-9, where a deflection of 0.07 mm has five digits left.
        assert guaranteed.max() < (2e-5 if case.name == "watt_six_bar_undamped" else 1e-6)


def test_references_end_at_published_numbers():
    summary = pd.read_csv(SUMMARY)
    ends = summary[summary["method 2"] == "published, at the end"].set_index(["case", "column"])
    published_cases = [case for case in ALL if case.published]
    assert len(published_cases) == 4
    for case in published_cases:
        for column, value in case.published.items():
            deviation = abs(case.load_reference((column,))[-1, 0] - value)
            disagreement = ends.loc[(case.name, column), "disagreement"]
            amplitude = 0.5 * np.ptp(case.load_reference((column,)))
            # References are stored with nine digits, SUNDIALS prints five.
            assert deviation < (1e-4 if case.name == "spring_slider_crank" else 3e-6) * amplitude
            assert disagreement == pytest.approx(deviation / amplitude, abs=1e-7, rel=0.1)


@pytest.mark.parametrize("case", [case for case in ALL if case.exact], ids=lambda c: c.name)
def test_references_match_closed_forms(case):
    # Nine digits of numbers up to 2.
    assert_allclose(case.reference, case.exact(case.times), rtol=0.0, atol=5.1e-9)


def test_small_vibrations_decay_to_the_static_deflection():
    times = np.linspace(0.0, 400.0, 5)
    columns = solve_small_vibrations(cantilever(damping=1e-4), times)
    section = rectangle(0.01, material=STEEL)
    deflection = 0.1 / (3.0 * section.EI) + 0.1 / section.GA
    # Cubic elements are exact for an end load; after 400 s the vibration has decayed.
    assert_allclose(columns["tip.y [m]"][[0, -1]], [0.0, deflection], rtol=1e-6, atol=1e-15)
    assert columns["root.M [N m]"][-1] == pytest.approx(-0.1, rel=1e-6)


# Orders of energy, tip and moment: (straight, curved). Twice the degree of the shape functions on a
# straight axis; for moments the order of their interpolation between quadrature points. Curved axes
# are interpolated: the angles of their sections and tangents differ by the fourth order.
EXPECTED = {
    "exact": ((6, 6, 3), (4, 4, 3)),
    "exact, full": ((6, 6, 3), (5, 5, 3)),
    "exact, 3 nodes": ((4, 4, 2), (4, 4, 2)),
    "exact, 2 nodes": ((2, 2, 1), (2, 2, 1)),
    "frame, exact strain": ((6, 6, 3), (4, 4, 3)),
    "frame, green": ((6, 6, 3), (4, 4, 3)),
    # The strains of the paper neglect the curvature.
    "frame, nonlinear": ((np.nan,) * 3, (2, 2, 2)),
    "frame, nonlinear, local": ((np.nan,) * 3, (2, 2, 2)),
}


@pytest.mark.slow(reason="shooting to 1e-12, and meshes of 4 to 32 elements")
@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("curve", CURVES)
def test_orders_match_theory(curve, formulation):
    expected = np.array(EXPECTED[formulation][curve != "straight"])
    orders = observe_orders(curve, formulation)
    # Slopes over 8 to 32 elements are below the limit. NaN: rounding errors only.
    assert np.all(np.isnan(orders) | (orders > expected - 0.35)), orders
