"""Statements that differ only in numbers share a kernel and keep their values."""

from pathlib import Path

import numpy as np
import pytest
from chains import chain_of_beams
from numpy.testing import assert_array_equal

import beamdae as bd
from beamdae.equations.formulations.first_order import formulate_first_order

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
