"""Errors about unknown, missing and surplus arguments of public classes and functions."""

import inspect
import pickle
import re

import pytest

import beamdae as bd

PUBLIC = [getattr(bd, name) for name in bd.__all__]
CLASSES = [
    x
    for x in PUBLIC
    if inspect.isclass(x) and "__init__" in vars(x) and not issubclass(x, (Exception, tuple))
]
FUNCTIONS = [x for x in PUBLIC if inspect.isfunction(x)]


@bd.model(t_end=1.0)
def press(rpm=10.0, elements=8):
    mech = bd.Mechanism()
    body = mech.add(bd.PointMass("mass", 1.0, at=(rpm, 0.0)))
    mech.observe("mass", body.point)
    return mech


@pytest.mark.parametrize("cls", CLASSES, ids=lambda x: x.__name__)
def test_unknown_arguments_of_all_classes_are_named(cls):
    if any(x.kind is x.VAR_KEYWORD for x in inspect.signature(cls).parameters.values()):
        pytest.skip("takes any keyword")
    with pytest.raises(bd.BeamdaeError, match=rf"^{cls.__name__}: there is no argument 'color'"):
        cls(color="red")


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda x: x.__name__)
def test_unknown_arguments_of_all_functions_are_named(function):
    """`simulate(model, tend=1)` had a TypeError without the names of the arguments."""
    assert pickle.loads(pickle.dumps(function)) is function is getattr(bd, function.__name__)
    if any(x.kind is x.VAR_KEYWORD for x in inspect.signature(function).parameters.values()):
        pytest.skip("takes any keyword")
    name = function.__name__
    with pytest.raises(bd.BeamdaeError, match=f"^{name}: there is no argument 'qqq'; the arg"):
        function(qqq=1)


@pytest.mark.parametrize("analysis", [bd.simulate, bd.equilibrium, bd.modes, bd.check])
@pytest.mark.parametrize("values", [{"parameters": {"rpm": 12.0}}, {"rpm": 12.0}])
def test_regression_parameters_of_analyses_are_passed_to_the_model(analysis, values):
    with pytest.raises(bd.BeamdaeError, match=r"the model function, as in press\(rpm=12\.0\)\.$"):
        analysis(press, **values)


@pytest.mark.parametrize(
    "function",
    [bd.fit, bd.frequency_response, bd.gradient, bd.optimize, bd.sensitivities, bd.sweep],
)
def test_parameters_of_functions_that_vary_the_model_have_an_argument(function):
    """`bd.sweep` and `bd.fit` suggested a mechanism, press(rpm=12.0), which they reject."""
    with pytest.raises(
        bd.BeamdaeError, match=r"argument 'rpm'; pass parameters=\{'rpm': 12\.0\}\.$"
    ):
        function(press, rpm=12.0)


def test_regression_values_of_parameters_need_names():
    """The error was "takes 1 positional argument but 3 were given"."""
    with pytest.raises(bd.BeamdaeError, match=r"write press\(rpm=12\.0, elements=4\)\.$"):
        press(12.0, 4)
    with pytest.raises(bd.BeamdaeError, match=r"list or a number, write elements=None as default"):
        press(elements=[0.0, 0.1])


def test_regression_arguments_of_similar_parts_are_listed():
    """The error was a TypeError without the names of the arguments."""
    allowed = "the arguments are name, mass, inertia, center, velocity, angular_velocity and shape"
    with pytest.raises(TypeError, match=rf"RigidBody: there is no argument 'at'; {allowed}\.$"):
        bd.RigidBody("stage", mass=1.0, inertia=1.0, at=(0.0, 0.0))
    with pytest.raises(bd.BeamdaeError, match=r"Section\.rectangle: .* 'heigth' \(did you mean 'h"):
        bd.Section.rectangle(bd.Material.of("steel"), width=0.1, heigth=0.1)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: bd.Line(0.5),
            "Line: missing a required argument: 'end'; the arguments are start and end.",
        ),
        (lambda: bd.Arc(), "Arc: missing a required argument: 'radius'; the arguments are"),
        (
            lambda: bd.RigidBody("stage", mass=1.0),
            "RigidBody: missing a required argument: 'inertia'; the arguments are name, mass,",
        ),
        (lambda: bd.Beam("leaf"), "Beam: missing a required argument: 'curve'; the argum"),
        (lambda: bd.Line((0, 0), (1, 0), 7.0), "Line: too many positional arguments; the arg"),
        (
            lambda: bd.simulate(),
            "simulate: missing a required argument: 'model'; the arguments are mod",
        ),
        (
            lambda: bd.Section.rectangle(),
            "Section.rectangle: missing a required argument: 'material'; the a",
        ),
    ],
)
def test_regression_missing_and_surplus_arguments_are_named(call, message):
    """The errors were those of Python, such as "Line.__init__() missing 1 required ..."."""
    with pytest.raises(TypeError, match=re.escape(message)) as caught:
        call()
    assert isinstance(caught.value, bd.BeamdaeError)


@bd.model(t_end=1.0)
def weightless_ball():
    mech = bd.Mechanism()
    mech.add(bd.PointMass("ball", -1.0, at=(0.0, 0.0)))
    return mech


@bd.model(t_end=1.0)
def misspelled_ball():
    mech = bd.Mechanism()
    return mech.add(bd.PointMass("ball", 1.0, at=(0.0, 0.0))).pointt


@pytest.mark.parametrize("model", [weightless_ball, misspelled_ball], ids=lambda x: x.name)
def test_tracebacks_of_mistakes_in_model_functions_end_in_the_model(model):
    """They had nine frames of beamdae besides those of the user."""
    with pytest.raises((bd.BeamdaeError, AttributeError)) as caught:
        bd.simulate(model)
    frames = [x.name for x in caught.traceback]
    assert frames[-1] == model.name
    assert len(frames) <= 3


def test_unexpected_errors_keep_their_traceback(monkeypatch):
    monkeypatch.setattr("beamdae.simulation.as_equations", len)
    with pytest.raises(TypeError) as caught:
        bd.simulate(press)
    assert "simulate" in [x.name for x in caught.traceback][2:]
