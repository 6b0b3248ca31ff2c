"""Units and descriptions of model parameters, and values with units."""

import math
import pickle
import re
from pathlib import Path

import pytest
from mechanisms import EARTH, free_ball, hinged_body, mass_on_rail

import beamdae as bd
from beamdae import quantities
from beamdae.cli.commands.list import read_outline
from beamdae.cli.model_file import example_names
from beamdae.model_parameters import (
    parse_unit,
    parse_value,
)


@bd.model(t_end=1.0)
def swing(
    length=bd.param(0.85, "m", "length of the rope"),
    mass=2.0,
    tilt=0.1,
    copies=bd.param(1, "-", "number of masses"),
    speed=3.0,
    factor=1.0,
    name="bob",
):
    """Release a `mass` [kg] at `tilt` [rad]. The list `name` [x, y] is no unit.

    Parameters
    ----------
    speed : float
        Speed of the support [rad/s],
        from the start on.
    """
    assert type(length) is float
    assert type(copies) is int
    mech = bd.Mechanism(gravity=EARTH)
    bob = mech.add(bd.PointMass(name, factor * mass, at=(length, tilt + 0.0 * speed)))
    mech.observe("bob", bob.point)
    return mech


def test_parameters_have_units_and_descriptions():
    info = swing.parameter_info
    assert list(info) == list(swing.parameters)
    assert info["length"] == ("length", 0.85, "m", "length of the rope")
    assert info["mass"] == ("mass", 2.0, "kg", "Release a `mass` [kg] at `tilt` [rad].")
    assert (info["tilt"].unit, info["factor"].unit, info["name"].unit) == ("rad", "", "")
    assert info["speed"][2:] == ("rad/s", "Speed of the support [rad/s], from the start on.")
    assert (info["copies"].unit, info["copies"].default) == ("-", 1)
    assert "length=0.85 m, mass=2 kg, tilt=0.1 rad, copies=1, " in repr(swing)
    assert "<td>length</td><td>0.85</td><td>m</td>" in swing._repr_html_()


def test_parameters_of_an_unexecuted_file_are_those_of_its_model():
    outlined = read_outline(Path(__file__)).models["swing"].parameters
    assert list(outlined) == list(swing.parameter_info)
    for name, x in swing.parameter_info.items():
        assert outlined[name] == x


def test_defaults_with_units_are_plain_numbers_in_the_model():
    assert all(type(x) in (int, float, str) for x in swing.parameters.values())
    swing()
    assert type(swing.complete({"mass": bd.param(3.0, "kg")})["mass"]) is float
    number = bd.param(0.85, "m", "radius\n  of the arc")
    assert number == 0.85
    assert math.sin(number) == math.sin(0.85)
    copy = pickle.loads(pickle.dumps(number))
    assert (copy, copy.unit, copy.description) == (0.85, "m", "radius of the arc")


VALUES = (
    ("850mm", "m", 0.85),
    ("-850 mm", "m", -0.85),
    ("1e3 mm", "m", 1.0),
    ("0.5 cm", "m", 0.005),
    ("2.5GPa", "Pa", 2.5e9),
    ("7.85 g/cm^3", "kg/m^3", 7850.0),
    ("3 N/mm", "N/m", 3000.0),
    ("3 µm²", "m^2", 3e-12),
    ("12 Nm/rad", "N m/rad", 12.0),
    ("180deg", "rad", math.pi),
    ("1 rad", "deg", 180.0 / math.pi),
    ("60 rpm", "rad/s", 2.0 * math.pi),
    ("5%", "-", 0.05),
    ("3 px", "px", 3.0),
    ("250 microstrain", "-", 250e-6),
    ("250 µm/m", "-", 250e-6),
    ("250 ppm", "-", 250e-6),
    ("0.25 ‰", "-", 250e-6),
    ("0.025 %", "µε", 250.0),
    ("0 mm", "m", 0.0),
    ("1e-999999999 mm", "m", 0.0),
    ("1e400 mm", "m", math.inf),
)


def test_values_with_units():
    for text, unit, value in VALUES:
        number = parse_value("swing", "length", text, unit)
        assert number == pytest.approx(value, rel=1e-14), text


def test_regression_texts_that_are_no_numbers_with_a_unit():
    for text in ("2.0", "5 m)", "5 (m", "5 N/(m/s)"):
        with pytest.raises(bd.BeamdaeError, match="swing: "):
            swing.complete({"copies": text})
    assert parse_value("swing", "length", "1e308 km", "m") == math.inf
    assert parse_value("swing", "rate", "5 1/s", "1/s") == 5.0


MISTAKES = {
    "length=3 N": "swing: length=3 N: the unit N measures another quantity; give the value in m.",
    "length=3 mn": "swing: length=3 mn: the unit mn is unknown",
    "length=3 mrpm": "swing: length=3 mrpm: the unit mrpm is unknown",
    "length=1,5 m": "swing: length=1,5 m: the number contains a comma; write a decimal point",
    "mass=3 t": "the unit t is unknown; give the",
    "mass=3 lb/in": "the unit lb/in is unknown",
    "tilt=3 Hz": "the unit Hz measures another quantity; give the value in rad.",
    "speed=3 Hz": "the unit Hz measures another quantity; give the value in rad/s.",
    "copies=3 m": "the unit m measures another quantity; give the number alone.",
    "factor=3 m": "swing: factor=3 m: the model states no unit of this parameter; give",
    "factor=heavy": "swing: factor must be of type float, got 'heavy'.",
    "copies=250%": "swing: copies must be of type int, got 2.5.",
    "length=1e400 mm": "swing: length must be finite, got inf.",
}


def test_wrong_units_are_one_sentence():
    for setting, sentence in MISTAKES.items():
        name, _, value = setting.partition("=")
        with pytest.raises(bd.BeamdaeError) as info:
            swing.complete({name: value})
        assert sentence in str(info.value)


def test_mistakes_in_param():
    for arguments in (("3", "m"), (True, "m"), (math.nan, "m"), (1.0, ""), (1.0, 3), (1.0, "m", 3)):
        with pytest.raises(bd.BeamdaeError, match="param: "):
            bd.param(*arguments)


@bd.model(t_end=1.0)
def leaf(thickness=bd.param([0.006, 0.004], "m", "thickness"), width=bd.param((40, 30.0), "mm")):
    mech = bd.Mechanism()
    mech.add(bd.PointMass("tip", thickness[0], at=(1e-3 * width[0], 0.0)))
    return mech


def test_regression_param_accepts_tuples_of_numbers():
    """The unit of a thickness at several points could only be written in the docstring."""
    assert leaf.parameters == {"thickness": (0.006, 0.004), "width": (40.0, 30.0)}
    assert type(leaf.parameters["thickness"]) is tuple
    assert leaf.parameter_info["thickness"][2:] == ("m", "thickness")
    assert leaf.complete({"thickness": ("5 mm", 0.003)})["thickness"] == (0.005, 0.003)
    assert pickle.loads(pickle.dumps(bd.param((1.0,), "m"))).unit == "m"
    assert leaf() is not None
    with pytest.raises(bd.BeamdaeError, match="an entry of thickness=5 kg: the unit kg measures"):
        leaf.complete({"thickness": ("5 kg", 0.003)})
    for default in ((), ("a",), (math.nan,), (True,), ((1.0,),)):
        with pytest.raises(bd.BeamdaeError, match="param: default must be a finite number or a"):
            bd.param(default, "m")


def test_regression_numbers_of_tuples_are_not_passed_on_unconverted():
    @bd.model(t_end=1.0)
    def unconverted(width=bd.param((40.0, 30.0), "mm")):
        mech = bd.Mechanism()
        mech.add(bd.PointMass("tip", 1.0, at=(width[0], 0.0)))
        return mech

    with pytest.raises(bd.BeamdaeError, match="got the parameter width in mm"):
        unconverted()


def test_all_numbers_of_the_examples_have_units():
    for name in example_names():
        for x in bd.load_model(f"example:{name}").parameter_info.values():
            if isinstance(x.default, float):
                assert parse_unit(x.unit) is not None, (name, x)
                assert x.description, (name, x)


def test_sweeps_convert_units():
    results = bd.sweep(swing, {"length": ["500 mm", 0.6]}, t_end=0.1)
    assert list(results.table["length [m]"]) == [0.5, 0.6]
    assert results.sweep.units == {"length": "m"}


def test_runs_record_the_units_of_their_parameters():
    model = bd.simulate(swing(length=0.5), t_end=0.1).metadata()["model"]
    assert model["parameters"]["length"] == 0.5
    assert model["units"] == {"length": "m", "mass": "kg", "tilt": "rad", "speed": "rad/s"}


@bd.model(t_end=0.1)
def foreign(
    swing=bd.param(40.0, "deg"),
    stiffness=bd.param(60.0, "N/mm"),
    share=bd.param(5.0, "%"),
    converts="all",
):
    """Spring and driver with parameters that are not in SI units."""
    mech, wheel = hinged_body(1.0, 1.0, name="wheel")
    at = mech.ground.at(0.0, 0.0), wheel.at(0.0, 0.0)
    angle = swing if converts == "stiffness" else math.radians(swing)
    mech.add(bd.Driver("motor", *at, bd.sine(angle, 2.0)))
    stiffness = stiffness if converts == "swing" else 1e3 * stiffness
    mech.add(bd.TorsionSpring("spring", *at, stiffness, 0.01 * share))
    mech.observe("wheel", wheel.at(0.0, 0.0))
    return mech


def test_regression_parameters_in_other_units_must_be_converted():
    """Angles in degrees were used as radians, and N/mm as N/m."""
    for converts, words in (
        ("stiffness", "amplitude must be in SI units, got the parameter swing in deg"),
        ("swing", "spring: stiffness must be in SI units, got the parameter stiffness in N/mm"),
    ):
        with pytest.raises(bd.BeamdaeError, match=words):
            foreign(converts=converts)


def test_converted_parameters_in_other_units_are_numbers():
    solution = bd.simulate(foreign(swing="1 rad", stiffness="60 kN/m"))
    assert solution["wheel.angle"].max() == pytest.approx(math.sin(0.4 * math.pi), rel=1e-3)
    parameters = solution.metadata()["model"]["parameters"]
    assert parameters["stiffness"] == 60.0
    assert type(parameters["stiffness"]) is float

    @bd.model(t_end=0.1)
    def outer(swing=bd.param(40.0, "deg")):
        return foreign(swing=swing)

    outer()


@pytest.mark.parametrize(
    "text",
    [
        "5mm,6mm",
        "(5 mm, 6 mm)",
        "[5 mm, 0.6 cm]",
        "('5 mm', '6 mm')",
        "(0.005, 0.006)",
        "5 mm, 6mm,",
    ],
)
def test_regression_texts_of_tuples_may_contain_units(text):
    """Of tuples, only plain numbers were accepted as one text."""
    assert leaf.complete({"thickness": text})["thickness"] == pytest.approx((0.005, 0.006))


@pytest.mark.parametrize("text", ["5mm", "5,5,6mm", "5,5mm,6mm", "5mm,,6mm", "thin,thick", ""])
def test_texts_that_are_no_tuples_are_rejected_with_the_syntax(text):
    message = r"thickness must be of type tuple, got .*thickness='\[0.006 m, 0.004 m\]'"
    with pytest.raises(bd.BeamdaeError, match=message):
        leaf.complete({"thickness": text})
    with pytest.raises(bd.BeamdaeError, match="an entry of thickness=6 kg: the unit kg measures"):
        leaf.complete({"thickness": "5 mm, 6 kg"})


# Texts with units, such as "8 mm", are converted or rejected by one sentence about SI units.


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


# Mechanisms remember the model function and the parameters that built them ------------------------

ALPHA = bd.GeneralizedAlpha(step=0.05)


@bd.model(t_end=0.2)
def falling_ball(mass=2.0):
    """Return a ball in free fall."""
    mech = bd.Mechanism(gravity=EARTH)
    mech.add(bd.PointMass("ball", mass, at=(0.0, 2.0)))
    return mech


def test_a_mechanism_has_the_end_time_and_the_parameters_of_its_model():
    run = bd.simulate(falling_ball(mass=3.0), ALPHA)
    assert run.t[-1] == 0.2
    assert run.model == {"name": "falling_ball", "parameters": {"mass": 3.0}, "t_end": 0.2}
    assert "falling_ball by GeneralizedAlpha" in run._repr_html_()
    assert bd.simulate(falling_ball(mass=3.0), ALPHA, t_end=0.1).t[-1] == 0.1
    assert bd.simulate(falling_ball, ALPHA).model["parameters"] == {"mass": 2.0}
    assert bd.check(falling_ball(mass=3.0), predict=False).name == "falling_ball"


def test_resuming_a_run_requires_the_same_parameters():
    half = bd.simulate(falling_ball(mass=3.0), ALPHA, t_end=0.1)
    assert bd.simulate(falling_ball(mass=3.0), ALPHA, start=half).t[-1] == 0.2
    with pytest.raises(bd.BeamdaeError, match="mass"):
        bd.simulate(falling_ball, ALPHA, start=half)


def test_a_mechanism_without_a_model_has_no_end_time():
    with pytest.raises(bd.BeamdaeError, match="no end time; pass t_end="):
        bd.simulate(falling_ball.build(), ALPHA)
