"""Texts with units, such as "8 mm", are converted or rejected by one sentence about SI units."""

import re

import pytest
from mechanisms import free_ball, mass_on_rail

import beamdae as bd
from beamdae import quantities


@bd.model(t_end=0.1)
def mass(spring=bd.param(50.0, "N/m"), weight=2.0):
    mech, bob = mass_on_rail(weight, 1.0, name="bob", spring=(spring, 0.0, 1.0))
    mech.add(bd.Force("push", bob.point, (1.0, 0.0)))
    mech.observe("bob", bob.point)
    return mech


REJECTED = {
    "t_end": lambda: bd.simulate(mass, t_end="50 ms"),
    "output_step": lambda: bd.simulate(mass, output_step="1ms"),
    "model": lambda: bd.model(t_end="5 s"),
    "check": lambda: bd.check(mass, t_end="10 ms"),
    "mass": lambda: bd.PointMass("m", "3 kg"),
    "modulus": lambda: bd.Material(E="210 GPa", nu=0.3, rho=7850.0),
    "radius": lambda: bd.Arc(radius="8 mm", length=1.0, start=(0.0, 0.0), angle=0.0),
    "angle": lambda: bd.Arc(radius=1.0, length=1.0, start=(0.0, 0.0), angle="30 °"),
    "point": lambda: bd.Line(("0 mm", 0.0), (1.0, 0.0)),
    "gravity": lambda: bd.Mechanism(gravity=(0.0, "-9.81 m/s^2")),
    "step": lambda: bd.GeneralizedAlpha(step="1 ms"),
    "max_step": lambda: bd.Ida(max_step="1 ms"),
    "sine": lambda: bd.sine("3 N", 5.0),
    "frequency": lambda: bd.sine(3.0, "5 Hz"),
    "rotation": lambda: bd.rotation("3000 rpm"),
    "table": lambda: bd.table(["1 mm", "2 mm"], [1.0, 2.0]),
    "period": lambda: bd.periodic(mass, "20 ms"),
    "accuracy": lambda: bd.simulate(mass, accuracy="1 %"),
    "start": lambda: bd.simulate(mass(), t_end=0.1, start={"bob.x": "1 mm"}),
}


@pytest.mark.parametrize("call", REJECTED.values(), ids=REJECTED)
def test_other_arguments_are_numbers_in_si_units(call):
    with pytest.raises(bd.BeamdaeError, match=r"must be a number in SI units, got .*omit the unit"):
        call()


@pytest.mark.parametrize(
    ("unit", "exponent", "message"),
    [
        ("N/m", {}, "in N/m^1.5 with exponent=1.5, got the parameter k in N/m; pass exponent=1 "),
        ("kN/mm", {}, "or a stiffness in N/m^1.5"),
        ("N/m", {"exponent": 2}, "must be in N/m^2 with exponent=2"),
        ("N/mm", {"exponent": 1}, "must be in SI units, got the parameter k in N/mm"),
        ("N/m", {"exponent": 1}, None),
        ("N/m^1.5", {}, None),
        ("-", {}, None),
    ],
)
def test_regression_stiffnesses_of_nonlinear_contacts_are_not_in_newton_per_meter(
    unit, exponent, message
):
    """A contact with 5e3 N/m had an 18th of its force, without a message."""

    @bd.model(t_end=0.1)
    def drop(k=bd.param(5e3, unit)):
        mech, ball = free_ball((0.0, 0.01), 0.2)
        floor = bd.LineSurface(mech.ground.at(0.0, 0.0))
        stop = mech.add(bd.Contact("stop", ball.point, floor, k, **exponent))
        assert type(stop.stiffness) is float
        return mech

    if message is None:
        assert isinstance(drop(), bd.Mechanism)
        return
    with pytest.raises(bd.BeamdaeError, match=re.escape(message)):
        drop()


@pytest.mark.slow(reason="a sweep")
def test_values_of_parameters_may_have_units():
    assert mass.complete({"spring": "5 N/cm"})["spring"] == pytest.approx(500.0)
    swept = bd.sweep(mass, {"spring": ["40 N/m", "0.05 N/mm"]}, t_end=0.01, jobs=1)
    for value in ("0.04 N/mm", "40", 40.0):
        assert swept.run(spring=value).parameters["spring"] == 40.0
    with pytest.raises(bd.BeamdaeError, match=r"the unit mm measures another quantity"):
        swept.run(spring="8 mm")


def optimize(*limits, **options):
    return bd.optimize(mass, quantities.Mass(), ["weight"], limits, **options)


@pytest.mark.slow(reason="optimizations")
@pytest.mark.parametrize(
    ("limit", "bounds"),
    [
        (quantities.at_least(quantities.Mass(), "1500 g"), None),
        (quantities.at_most(quantities.Frequency(1, about="equilibrium"), "1 Hz"), None),
        (quantities.at_least(quantities.Mass(), "1.5"), {"weight": ("1", "50")}),
    ],
)
def test_regression_limits_may_have_units(limit, bounds):
    """They had to be numbers, and bounds without units could not be texts."""
    result = optimize(limit, bounds=bounds)
    assert result.constraints[0].margin == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(
    ("limit", "message"),
    [
        (
            lambda: quantities.at_least(quantities.Mass(), "15 mm"),
            r"the limit of mass is in mm, but .* in kg",
        ),
        (
            lambda: quantities.at_most(quantities.EndValue("bob.x"), "1 s"),
            r"is in s, but the quantity is in m;",
        ),
        (
            lambda: quantities.at_most(quantities.EquilibriumValue("bob.x"), "1 Pa"),
            r"but the quantity is in m;",
        ),
        (
            lambda: quantities.at_most(
                quantities.LargestOf([quantities.EndValue("bob.x")]), "1 Pa"
            ),
            "but the quantity is in m;",
        ),
        (
            lambda: quantities.at_least(2.0 * quantities.Mass(), "1 kg"),
            "but the quantity has no known unit",
        ),
        (
            lambda: quantities.at_least(quantities.Mass(), "1 elephant"),
            r"must be a number in SI units",
        ),
        (lambda: quantities.at_least(quantities.Mass(), "a"), r"must be a number, got 'a'"),
    ],
)
def test_limits_in_units_of_other_quantities_are_rejected(limit, message):
    with pytest.raises(bd.BeamdaeError, match=message):
        optimize(limit())
