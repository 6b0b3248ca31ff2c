"""What is built from equations of motion is built once for the same ones."""

import pytest

import beamdae as bd
from beamdae.equations import measures
from beamdae.equations.formulations import FIRST_ORDER, first_order
from beamdae.equations.step_equations import step_equations


def falling():
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    mech.add(bd.PointMass("bob", 1.0, at=(0.0, 0.0)))
    return bd.equations_of_motion(mech)


@pytest.mark.parametrize(
    "build",
    [
        *(lambda e, form=form: first_order(e, form) for form in FIRST_ORDER),
        lambda e: step_equations(e, True),
        lambda e: step_equations(e, False),
        measures.balance,
    ],
)
def test_it_is_built_once_and_for_others_anew(build):
    equations = falling()
    built = build(equations)
    assert build(equations) is built
    assert build(falling()) is not built


def test_forms_are_kept_apart():
    equations = falling()
    assert len({id(first_order(equations, form)) for form in FIRST_ORDER}) == len(FIRST_ORDER)
    assert step_equations(equations, True) is not step_equations(equations, False)
