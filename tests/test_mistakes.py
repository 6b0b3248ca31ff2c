"""Ordinary mistakes and hostile objects end in one sentence that names the part and the value."""

import traceback

import casadi as ca
import pytest
from command_line import invoke
from mechanisms import EARTH, hinged_body, rectangle, symbols
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
