"""Sums of kernels: shared kernels, directional derivatives, and the same bits in machine code."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from threading import Barrier

import numpy as np
import pytest
from chains import chain_of_beams
from mechanisms import hinged_beam, rectangle
from numpy.testing import assert_array_equal

import beamdae as bd
import beamdae.symbolic.formula
import beamdae.symbolic.kernel_groups
from beamdae.beams import damping, elements
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.equations.formulations.static_equations import plan_static_sums
from beamdae.equations.formulations.step_equations import formulate_step
from beamdae.equations.starts.state_evaluator import plan_balance, plan_motion, plan_state_sums
from beamdae.native.object_code import is_native_enabled
from beamdae.parts.bodies import rigid_body
from beamdae.symbolic.sums.kernel_sums import Kernel, evaluate_sum, set_time
from beamdae.symbolic.sums.sum_derivatives import directional_plan
from beamdae.symbolic.sums.sum_evaluator import SumEvaluator

MODELS = Path(__file__).parents[2] / "models"


@pytest.mark.parametrize("joint", [bd.Revolute, bd.Weld])
def test_number_of_kernels_is_independent_of_chain_length(joint):
    programs = []
    for beams in (5, 10):
        form = formulate_first_order(
            bd.equations_of_motion(chain_of_beams(beams, joint)), "stabilized-index1"
        )
        programs.append([len(total.batches) for total in form.sums])
    assert programs[0] == programs[1]


# Parameters that differ from the defaults of the models; parameters of curves rotate elements.
NUMBERS = {
    "hub_beam": {"torque": 11.0, "frequency": 1.2, "density": 2800.0},
    "pendulum": {"tip_mass": 0.07, "damping": 2e-4},
    "slider_crank": {"speed": 3.0, "density": 2800.0},
    "spin_up": {"speed": 3.0},
    "four_bar": {"speed": 3.0, "stiffness": 100.0},
    "quick_return": {"speed": 3.0, "coefficient": 0.2},
    "leaf_spring_vehicle": {"sprung_mass": 350.0, "damping": 1500.0},
    "sliding_mass": {"mass": 0.1, "height": 0.004},
    "ring_mount": {"motor_mass": 2.0, "frequency": 15.0},
    "governor": {"torque": 0.5, "coefficient": 0.2, "preload": 0.03},
    "shallow_arch": {"load": 30.0, "damping": 1e-4},
    "press": {"speed": 11.0, "ram_mass": 30.0},
    "voice_coil_stage": {"step": 0.2e-3, "kp": 20e3},
    "inverted_pendulum": {"tilt": 0.05},
    "active_damping": {"gain": 0.1, "frequency": 60.0},
}
CURVES = {
    "hub_beam": {"subtended": 61.0, "length": 5.0},
    "pendulum": {"radius": 0.9, "angle": -0.5},
}


def assemble_model(name, values):
    model = bd.load_model(MODELS / f"{name}.py", name)
    return bd.equations_of_motion(model(**values))


def test_every_model_has_other_numbers():
    assert set(NUMBERS) == {path.stem for path in MODELS.glob("*.py")}


@pytest.mark.parametrize("name", [*NUMBERS, *(f"{name} curve" for name in CURVES)])
def test_models_with_other_numbers_share_kernels_and_patterns(name):
    """Curves rotate elements, which changes the entries of operators."""
    model, _, changes_curve = name.partition(" ")
    values = (CURVES if changes_curve else NUMBERS)[model]
    one, other = assemble_model(model, {}), assemble_model(model, values)
    assert changes_curve or one.structure == other.structure
    assert not np.array_equal(one.p, other.p)
    for terms in zip(one.observables, other.observables, strict=True):
        assert len({term.function for term in terms}) == 1
    for terms in zip((*one.forces, *one.joints), (*other.forces, *other.joints), strict=True):
        assert len({id(term.kernel) for term in terms}) == 1
        x, y = (term.operator for term in terms)
        assert_array_equal(x.indptr, y.indptr)
        assert_array_equal(x.indices, y.indices)


# Directional derivatives of sums against central differences of the sums themselves.


def two_beams(formulation):
    """Return equations with a beam of several elements, a body, joints and a contact."""
    steel = rectangle(0.01, damping=1e-4)
    mech, beam = hinged_beam(steel, 3, gravity=9.81, formulation=formulation)
    disk = mech.add(bd.RigidBody.disk("disk", (1.0, 0.0), radius=0.1, mass=2.0))
    pin = mech.add(bd.Revolute("pin", beam.end, disk.at(1.0, 0.0)))
    mech.add(bd.Friction("rubbing", pin, 0.1, friction_speed=0.01, radius=0.05))
    floor = bd.LineSurface(mech.ground.at(0.0, -0.2), direction=(1.0, 0.0))
    mech.add(bd.Contact("floor", disk.at(1.0, -0.1), floor, stiffness=1e5))
    return bd.equations_of_motion(mech)


def evaluate(plan, p, x, size):
    total, result = plan.sum(False, p), np.zeros(size)
    set_time(total, 0.1, 0.1)
    evaluate_sum(total, x, result)
    return result


@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
def test_derivative_along_inputs_and_numbers(formulation):
    e = two_beams(formulation)
    plan, size, n_x = formulate_step(e, False).sums[0], e.n + e.m, 4 * e.n + 2 * e.m
    random = np.random.default_rng(1)
    x = np.concatenate([e.q0, np.zeros(n_x - e.n)]) + random.normal(size=n_x) * 1e-2
    dx, dp = random.normal(size=n_x) * 1e-2, random.normal(size=e.p.size) * 1e-2 * e.p
    derivative = evaluate(directional_plan(plan, n_x), e.p, np.concatenate([x, dx, dp]), size)
    h = 1e-3
    differences = [
        (
            evaluate(plan, e.p + k * h * dp, x + k * h * dx, size)
            - evaluate(plan, e.p - k * h * dp, x - k * h * dx, size)
        )
        / (2.0 * k * h)
        for k in (1, 2)
    ]
    expected = (4.0 * differences[0] - differences[1]) / 3.0
    # The error of extrapolated differences is of order h^4; forces of stiff beams are near 1e8.
    np.testing.assert_allclose(derivative, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_open_contact_has_no_derivative_by_its_exponent():
    # The derivative of x^n by n is x^n log x, which is NaN in floating-point numbers at x = 0.
    e = two_beams("floating frame")
    plan, n_x = formulate_step(e, False).sums[0], 4 * e.n + 2 * e.m
    x = np.concatenate([e.q0, np.zeros(n_x - e.n)])
    inputs = np.concatenate([x, np.zeros(n_x), np.ones(e.p.size)])
    assert np.isfinite(evaluate(directional_plan(plan, n_x), e.p, inputs, e.n + e.m)).all()


# Sums at single states have the same bits in CasADi's virtual machine and in machine code.

PLANS = {
    "motion": plan_motion,
    "balance": plan_balance,
    "gradients": lambda structure: plan_state_sums(structure).gradients,
    "saddle": lambda structure: plan_state_sums(structure).saddle,
    "static tangent": lambda structure: plan_static_sums(structure).tangent,
}


@pytest.fixture(scope="module")
def equations():
    """Equations of a hinged beam whose tip touches a floor."""
    section = rectangle(0.02, 0.01)
    mech, beam = hinged_beam(section, 2, (1.0, 0.2), gravity=9.81)
    mech.add(bd.Contact("tip", beam.end, bd.LineSurface(mech.ground.at(0.0, 0.25)), 1e6))
    return bd.equations_of_motion(mech)


@pytest.mark.skipif(not is_native_enabled(), reason="machine code is off")
@pytest.mark.parametrize("name", PLANS)
def test_evaluators_have_the_bits_of_machine_code(equations, name):
    plan, rng = PLANS[name](equations.structure), np.random.default_rng(1)
    x = rng.standard_normal(3 * equations.n + equations.m)
    x[: equations.n] = equations.q0 + 1e-3 * x[: equations.n]
    total, evaluator = plan.sum(True, equations.p), SumEvaluator(plan, equations.p)
    total.shared[:] = evaluator.shared[:] = rng.uniform(0.1, 1.0, plan.n_shared)
    size = 10 * len(x) ** 2  # larger than any result
    expected = np.zeros(size)
    for factor in (1.0, 2.0):
        evaluate_sum(total, factor * x, expected)
        assert np.any(expected)
        np.testing.assert_array_equal(evaluator(factor * x, size), expected)


def test_regression_many_evaluators_compile_nothing(equations, monkeypatch):
    """A run with 30 impacts compiled the sums at the states of impacts."""
    requests = []
    monkeypatch.setattr(Kernel, "load_native", lambda kernel, compiles: requests.append(compiles))
    plan = replace(plan_motion(equations.structure))
    for k in range(60):
        SumEvaluator(plan, equations.p + k)
    assert requests
    assert not any(requests)


# Concurrent threads share kernels, by whose identity structures are compared.


def test_structures_of_concurrent_threads_are_equal():
    """Sensitivities in threads were refused because kernels had been built twice."""
    for build in (
        beamdae.symbolic.formula._build_shared_kernel,
        beamdae.symbolic.kernel_groups._rebuild_kernel,
        damping._rayleigh_kernel,
        elements.element_kernel,
        rigid_body._rigid_body_kernel,
    ):
        build.cache_clear()
    barrier = Barrier(4)

    def assemble(_):
        section = rectangle(0.1, 0.1, material=bd.Material(E=1e7, nu=0.3, rho=2e3))
        mechanism, _ = hinged_beam(section, 3)
        barrier.wait(10.0)
        return bd.equations_of_motion(mechanism).structure

    with ThreadPoolExecutor(4) as pool:
        one, *others = pool.map(assemble, range(4))
    assert all(other == one for other in others)
