"""What is built from equations of motion is built once for the same ones."""

import pytest

import beamdae as bd
from beamdae.equations import measures
from beamdae.equations.formulations.first_order import FIRST_ORDER, formulate_first_order
from beamdae.equations.formulations.step_equations import formulate_step


def falling():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    mech.add(bd.PointMass("bob", 1.0, at=(0.0, 0.0)))
    return bd.equations_of_motion(mech)


@pytest.mark.parametrize(
    "build",
    [
        *(lambda e, form=form: formulate_first_order(e, form) for form in FIRST_ORDER),
        lambda e: formulate_step(e, True),
        lambda e: formulate_step(e, False),
        measures.plan_balance,
    ],
)
def test_it_is_built_once_and_for_others_anew(build):
    equations = falling()
    built = build(equations)
    assert build(equations) is built
    assert build(falling()) is not built


def test_forms_are_kept_apart():
    equations = falling()
    assert len({id(formulate_first_order(equations, form)) for form in FIRST_ORDER}) == len(
        FIRST_ORDER
    )
    assert formulate_step(equations, True) is not formulate_step(equations, False)
