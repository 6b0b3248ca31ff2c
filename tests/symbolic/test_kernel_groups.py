"""Statements that differ only in numbers share a kernel and keep their values."""

from pathlib import Path

import numpy as np
import pytest
from chains import STRIP, chain_of_beams, random_state
from numpy.testing import assert_allclose, assert_array_equal

import beamdae as bd
from beamdae.equations.assembly import building
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.symbolic.kernel_groups import KernelGroup
from beamdae.symbolic.statements import Quantity, Variable

MODELS = Path(__file__).parents[2] / "models"


def workshop():
    """Return a mechanism with three statements of each kind, with different numbers."""
    mech = bd.Mechanism(gravity=(0.3, -9.81))
    for k in (1, 2, 3):
        arc = bd.Arc(radius=0.8 + 0.1 * k, length=0.5, start=(k, 0.1 * k), angle=0.2 * k)
        beam = mech.add(bd.Beam(f"beam {k}", arc, STRIP, elements=2, frame="tangent"))
        body = mech.add(bd.RigidBody(f"body {k}", 1.0 + k, 0.1, center=(k, 0.3)))
        mech.add(bd.PointMass(f"mass {k}", 0.1 + k, on=beam.at(0.1 + 0.1 * k)))
        mech.add(bd.Revolute(f"hinge {k}", mech.ground.at(k, 0.1 * k), beam.start))
        mech.add(bd.Weld(f"weld {k}", beam.end, body.at(*beam.end.point)))
        side = mech.add(bd.RigidBody(f"side {k}", 2.0, 0.2, center=(k + 2.0, 1.0)))
        law = bd.sine(amplitude=0.1 + k, frequency=1.0 + k)
        mech.add(bd.Driver(f"driver {k}", mech.ground.at(0.0, 0.0), side.at(k, 1.0), law=law))
        line = mech.ground.at(k + 2.0, 1.0)
        mech.add(bd.PointOnLine(f"line {k}", line, side.at(k + 2.0, 1.0), direction=(1.0, 0.1 * k)))
        mech.add(bd.Moment(f"moment {k}", on=body.at(k, 0.3), law=law))
    return mech


def separate_groups(statements):
    return [KernelGroup(x.kernel, [k], x.data) for k, x in enumerate(statements)]


def numbers(equations, name):
    """Return residual and Jacobian of the first-order form `name` at a random state."""
    form = formulate_first_order(equations, name)
    q, v, a, _ = random_state(equations)
    rest = np.cos(np.arange(form.size - 2 * equations.n))
    y, yp = np.concatenate([q, v, rest]), np.concatenate([v, a, 2.0 * rest])
    time = np.array([0.7, 0.7])
    jacobian = form.pattern.copy()
    jacobian.data = form.jacobian(time, y, yp, 30.0)
    return form.residual(time, y, yp), jacobian.toarray()


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("name", ["stabilized-index1", "index1"])
def test_grouped_statements_have_the_same_values(name, monkeypatch):
    shared = bd.equations_of_motion(workshop())
    monkeypatch.setattr(building, "group_by_kernel", separate_groups)
    separate = bd.equations_of_motion(workshop())
    # Hinges, welds, drivers and lines; elements, bodies, masses and moments.
    assert (len(separate.joints), len(shared.joints)) == (12, 4)
    assert (len(separate.forces), len(shared.forces)) == (15, 4)
    for got, expected in zip(numbers(shared, name), numbers(separate, name), strict=True):
        assert_allclose(got, expected, rtol=1e-12, atol=1e-12 * np.max(np.abs(expected)))


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


def observe_scaled_point(factor):
    """Return function and values of a user-defined quantity, and the observed point."""
    mech = workshop()
    on = mech.part("beam 1").end

    def scale_position(local):
        return factor * on.position(local.q) + local.data[0]

    columns = (Variable("x", "m"), Variable("y", "m"))
    mech.observe("own", Quantity(columns, (on.piece,), scale_position, np.array([0.5])))
    mech.observe("point", on)
    equations = bd.equations_of_motion(mech)
    values = []
    for one in equations.observables:
        local = one.operator @ equations.q0
        rest = (np.zeros_like(local), equations.p[one.data], [])
        values.append(one.function(np.zeros((1, 2)), local, *rest).ravel())
    return equations.observables[0].function, values[0], values[1][:2]


def test_quantities_that_differ_in_numbers_share_a_function():
    (function, *_), (same, values, point) = observe_scaled_point(2.5), observe_scaled_point(3.5)
    assert function is same
    # The numbers follow the data; rounding errors differ by a few operations.
    assert_allclose(values, 3.5 * point + 0.5, rtol=1e-14)
