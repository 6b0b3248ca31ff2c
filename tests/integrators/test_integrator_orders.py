"""Observed orders, which reveal wrong formulas that small errors hide."""

import numpy as np
import pytest
from benchmarks.cases import AREVALO, CYCLOID, KNIFE_EDGE, ROTATING_ROD, pendulum, pendulum_motion
from mechanisms import balance_wheel
from numpy.testing import assert_allclose

import beamdae as bd
from beamdae.integrators.radau import stepper as radau_stepper

ANGLE, SPEED, GRAVITY = 0.4 * np.pi, 0.5, 9.81

# Away from rest and from turning points: the cured start corrects for the initial jerk.
SWING = pendulum(GRAVITY, ANGLE, SPEED).equations
CASES = {
    "Arevalo": (AREVALO.equations, AREVALO.answer, 1.5),
    "pendulum": (SWING, lambda t: pendulum_motion(GRAVITY, ANGLE, SPEED, t), 2.0),
    "brachistochrone": (CYCLOID.equations, CYCLOID.answer, 1.5),
    "knife edge": (KNIFE_EDGE.equations, KNIFE_EDGE.answer, 1.5),
    "rotating rod": (ROTATING_ROD.equations, ROTATING_ROD.answer, 1.5),
}


def largest_errors(case, steps, **settings):
    """Return the largest errors of q, v and lam over all steps of a run."""
    equations, answer, t_end = CASES[case]
    step = t_end / steps
    # Errors of Newton's iteration accumulate in lam if rho_inf is near 1.
    integrator = bd.GeneralizedAlpha(step=step, newton_tolerance=1e-10, **settings)
    solution = bd.simulate(equations, integrator, t_end, output_step=step)
    assert solution.status.success, solution.status.sentence
    exact = answer(solution.t)
    values = {"q": solution.q, "v": solution.v, "lam": solution.lam}
    return np.array([np.max(np.abs(values[name] - exact[name])) for name in ("q", "v", "lam")])


def observed_orders(case, steps, **settings):
    return np.log2(
        largest_errors(case, steps, **settings) / largest_errors(case, 2 * steps, **settings)
    )


@pytest.mark.parametrize(
    ("family", "rho_inf", "order"),
    [
        *(("generalized-alpha", rho_inf, 2.0) for rho_inf in (0.9, 0.6, 0.0)),
        *(("hht", rho_inf, 2.0) for rho_inf in (0.8, 0.5)),
        ("newmark", 0.8, 1.0),
    ],
)
@pytest.mark.parametrize(
    ("case", "formulation"),
    # Each once; the other pairs are slow tests.
    [
        ("Arevalo", "index3"),
        ("pendulum", "stabilized-index2"),
        # A constraint that changes with time, and a coordinate without inertia.
        ("rotating rod", "index3"),
        ("brachistochrone", "stabilized-index2"),
        pytest.param("Arevalo", "stabilized-index2", marks=pytest.mark.slow(reason="several runs")),
        pytest.param("pendulum", "index3", marks=pytest.mark.slow(reason="several runs")),
    ],
)
def test_order_in_positions_velocities_and_multipliers(case, formulation, family, rho_inf, order):
    # Arnold & Bruls 2007; Arnold, Bruls & Cardona 2015 for the multipliers at the start. The
    # higher orders still show at these steps, most of all for rho_inf = 0.
    settings = {"formulation": formulation, "family": family, "rho_inf": rho_inf}
    assert_allclose(observed_orders(case, 800, **settings), order, rtol=0.0, atol=0.1)


@pytest.mark.parametrize(
    "formulation",
    ["index3", pytest.param("stabilized-index2", marks=pytest.mark.slow(reason="several runs"))],
)
def test_without_the_cure_the_first_multipliers_are_of_first_order(formulation):
    # The start-up error is strongly damped. Many steps are needed for its remainder to exceed the
    # second-order error of the whole run. Positions and velocities do not need the cure.
    settings = {"formulation": formulation, "rho_inf": 0.6, "start": "plain"}
    orders = observed_orders("pendulum", 1600, **settings)
    assert_allclose(orders, [2.0, 2.0, 1.0], rtol=0.0, atol=0.1)


def test_without_the_cure_the_multipliers_of_a_lightly_damped_run_are_of_first_order():
    settings = {"rho_inf": 0.9, "start": "plain"}
    plain = largest_errors("pendulum", 200, **settings)
    cured = largest_errors("pendulum", 200, rho_inf=0.9)
    orders = np.log2(plain / largest_errors("pendulum", 400, **settings))
    assert_allclose(orders, [2.0, 2.0, 1.0], rtol=0.0, atol=0.1)
    # 0.37 against 0.026 at this step.
    assert cured[2] < 0.1 * plain[2]
    assert_allclose(cured[:2], plain[:2], rtol=1e-3)


def test_undamped_generalized_alpha_keeps_the_energy_to_second_order():
    step = 0.01
    drift = []
    for h in (step, 0.5 * step):
        integrator = bd.GeneralizedAlpha(step=h, rho_inf=0.9, newton_tolerance=1e-10)
        solution = bd.simulate(SWING, integrator, 2.0, output_step=step)
        energy = 0.5 * np.sum(solution.v**2, axis=1) + GRAVITY * solution.q[:, 1]
        drift.append(np.max(np.abs(energy - energy[0])))
    assert_allclose(np.log2(drift[0] / drift[1]), 2.0, rtol=0.0, atol=0.1)


@pytest.mark.parametrize(
    ("case", "steps", "order"),
    # A constraint that depends on time only has a direction without error.
    [
        ("Arevalo", 40, 3),
        ("pendulum", 80, 3),
        ("brachistochrone", 40, 3),
        ("rotating rod", 40, 4),
        ("knife edge", 40, 3),
    ],
)
def test_radau_is_of_order_five_in_positions_and_velocities_three_in_multipliers(
    case, steps, order, monkeypatch
):
    # Hairer, Lubich & Roche 1989 for the index-2 form. At the loosest tolerance, all steps equal
    # max_step. Newton's iteration converges to rounding; its error would hide that of the method.
    monkeypatch.setattr(radau_stepper, "_MAX_ITERATION_FRACTION", 1e-12)
    monkeypatch.setattr(radau_stepper, "_MAX_STAGNATION_FRACTION", 1e-12)
    equations, answer, t_end = CASES[case]
    errors = []
    for count in (steps, 2 * steps):
        step = t_end / count
        solution = bd.simulate(equations, bd.Radau(0.1, max_step=step), t_end, output_step=step)
        (segment,) = solution.trajectory.intervals
        assert_allclose(np.diff(segment.t), step, rtol=1e-9)
        exact = answer(solution.t)
        values = {"q": solution.q, "v": solution.v, "lam": solution.lam}
        errors.append([np.max(np.abs(values[name] - exact[name])) for name in ("q", "v", "lam")])
    assert_allclose(np.log2(np.divide(*errors)), [5.0, 5.0, order], rtol=0.0, atol=0.1)


@pytest.mark.slow(reason="two seconds")
def test_long_steps_of_slender_beams_are_of_second_order():
    """Corrections of a step grow until the coils, which the prediction stretches, are bent."""
    wheel, step, start = balance_wheel(), 1e-3, {"wheel.angle": 3.0}

    def angles(integrator):
        run = bd.simulate(wheel, integrator, 0.3, step, start=start)
        assert run.status.success, run.status.sentence
        return run["wheel.angle"]

    exact = angles(bd.Radau(1e-6))
    coarse, fine = (angles(bd.GeneralizedAlpha(h)) - exact for h in (step, step / 2))
    assert_allclose(np.linalg.norm(coarse) / np.linalg.norm(fine), 4.0, rtol=0.1)


@pytest.mark.slow(reason="a hundred thousand steps of order 1")
@pytest.mark.parametrize(("max_order", "tightest"), [(1, 2e-5), (2, 1e-6)])
def test_ida_step_length_scales_with_its_order(max_order, tightest):
    # The local error, proportional to h^(k+1), is kept at the local tolerance, so that steps are
    # proportional to the power 1/(k+1) of the tolerance, apart from the start at order 1 and the
    # slow adaptation of step and order. From order 3 on, exponents of successive orders differ by
    # less than these effects.
    steps, tolerances = [], []
    for rtol in (1e-4, tightest):
        integrator = bd.Ida(
            rtol=rtol, error_control="positions", max_order=max_order, max_steps=100_000
        )
        solution = bd.simulate(SWING, integrator, 1.0)
        assert solution.status.success, solution.status.sentence
        steps.append(solution.statistics.steps)
        tolerances.append(solution.integrator["local_tolerance"])
    growth = np.log(steps[1] / steps[0]) / np.log(tolerances[0] / tolerances[1])
    assert_allclose(growth, 1.0 / (max_order + 1.0), rtol=0.12)
