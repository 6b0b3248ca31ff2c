"""Ordinary mistakes and hostile objects end in one sentence that names the part and the value."""

import inspect
import pickle
import re
import traceback

import casadi as ca
import pytest
from command_line import invoke
from mechanisms import EARTH, free_ball, hinged_body, rectangle, symbols
from robustness.judge import check_sentence

import beamdae as bd


def falling(name="ball"):
    mech = bd.Mechanism(gravity=EARTH)
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
    mech.observe(name, ball.point)
    return mech


def run(name="ball", **settings):
    return bd.simulate(falling(name), t_end=0.1, output_step=0.05, **settings)


def frame_with(**settings):
    strip = rectangle(0.01, 0.01)
    points = {"A": (0.0, 0.0), "B": (1.0, 0.0)}
    return bd.frame(bd.Mechanism(), "portal", points, ["AB"], strip, **settings)


def driven(rate):
    mech, disk = hinged_body(1.0, 1.0, name="disk")
    law = lambda t: rate * t  # noqa: E731
    mech.add(bd.Driver("drive", mech.ground.at(0.0, 0.0), disk.at(0.0, 0.0), law))
    return bd.simulate(mech, t_end=0.1)


def saved(tmp_path):
    return bd.load(run().save(tmp_path / "run.beamdae"))


MISTAKES = {
    "activate without a part": (lambda _: bd.activate(), "activate: expected joints and forces"),
    "difference without common columns": (
        lambda _: run().difference(run("other")),
        "difference: the runs have no observed column in common",
    ),
    "enormous rate of a driver": (
        lambda _: driven(1e300),
        "simulate: a number exceeds the range of floating-point numbers",
    ),
    "law at a text": (lambda _: bd.sine(1.0, 1.0).at("x"), "Law.at: t must be a number, got 'x'"),
    "law that is no number": (
        lambda _: bd.results.Law((lambda t: "much",)).at(1.0),
        "Law.at: the law at t = 1 s must be a number",
    ),
    "unknown setting of a frame": (
        lambda _: frame_with(bogus=1),
        "portal: there is no argument 'bogus'",
    ),
    "misspelled setting of a frame": (lambda _: frame_with(element=1), "did you mean 'elements'"),
    **{
        f"{name} of a saved run": (
            lambda folder, name=name: getattr(saved(folder), name),
            f"SavedRun: {name} needs the equations of the run",
        )
        for name in ("observe", "q", "trajectory", "section_forces")
    },
}


def test_misspelled_public_names_have_one_suggestion():
    """Tracebacks suggested the name, but not the text of the error."""
    with pytest.raises(AttributeError) as caught:
        _ = bd.Revolut
    assert str(caught.value).endswith("no attribute 'Revolut' (did you mean 'Revolute'?)")
    with pytest.raises(AttributeError, match=r"no attribute 'Damper'$"):
        _ = bd.Damper  # a taper is not similar
    (line,) = traceback.format_exception_only(caught.value)
    assert line.endswith("'Revolute'?)\n")
    assert not hasattr(bd, "__wrapped__")


@pytest.mark.parametrize("name", list(MISTAKES))
def test_mistakes_end_in_a_sentence(name, tmp_path):
    mistake, sentence = MISTAKES[name]
    with pytest.raises(bd.BeamdaeError) as caught:
        mistake(tmp_path)
    assert sentence in str(caught.value)
    assert check_sentence(str(caught.value)) == ""


def test_saved_runs_have_no_attribute_that_needs_the_model(tmp_path):
    assert not hasattr(saved(tmp_path), "observe")
    with pytest.raises(AttributeError, match="'SavedRun' object has no attribute 'bogus'"):
        _ = saved(tmp_path).bogus


def test_new_with_a_long_name(tmp_path):
    result = invoke("new", str(tmp_path / f"{'x' * 300}.py"))
    assert result.exit_code == 2
    assert "1 to 120 bytes" in result.output
    assert not list(tmp_path.iterdir())


def test_checkpoints_without_a_suffix(tmp_path):
    path = run().save(tmp_path / "state")
    later = bd.simulate(falling(), t_end=0.2, start=str(path))
    assert later.t[0] == 0.1
    with pytest.raises(bd.BeamdaeError, match="start must be 'as drawn', 'equilibrium'"):
        run(start="equilibrum")


def test_repr_names_the_columns_of_a_constrained_system():
    t, q, v = symbols(2)
    system = bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[1.0, 1.0],
        force=ca.vertcat(0.0, -9.81),
        constraints=ca.dot(q, q) - 1.0,
        q0=[1.0, 0.0],
        v0=[0.0, 0.0],
        observe={"r [m]": ca.norm_2(q)},
    )
    assert repr(bd.simulate(system, t_end=0.01)).endswith("; observed: q0, q1, r>")


# Errors about unknown, missing and surplus arguments of public classes and functions.

PUBLIC = [getattr(bd, name) for name in bd.__all__]
CLASSES = [
    x
    for x in PUBLIC
    if inspect.isclass(x) and "__init__" in vars(x) and not issubclass(x, (Exception, tuple))
]
FUNCTIONS = [x for x in PUBLIC if inspect.isfunction(x)]


@bd.model(t_end=1.0)
def press(rpm=10.0, elements=8):
    mech, _ = free_ball((rpm, 0.0), name="mass")
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
