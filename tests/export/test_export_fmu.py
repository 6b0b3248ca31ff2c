"""Exported FMUs: contents, equality with `GeneralizedAlpha`, states, derivatives and messages."""

import json
import re
import shutil
import subprocess
import sys
import textwrap
import warnings
import zipfile
from dataclasses import replace
from xml.etree import ElementTree

import casadi as ca
import numpy as np
import pytest
from mechanisms import (
    EARTH,
    clamped_beam,
    driven_slide,
    free_ball,
    hinged,
    reaction_of_driven_slide,
    rectangle,
    symbols,
)

import beamdae as bd

STEP = 1e-3
T_END = 0.1
PARAMETERS = ["mass", "thickness"]
# Values that differ from the defaults of all parameters, and of the input.
VALUES = {"mass": 1.5, "thickness": 0.005}
TORQUE = 3.0
# With the default, errors of Newton's iteration would hide errors of the equations.
ALPHA = bd.GeneralizedAlpha(STEP, newton_tolerance=1e-9)
RADAU_RTOL = 1e-8


@bd.model(t_end=T_END)
def crane(
    mass=2.0, stiffness=50.0, thickness=0.004, width=0.01, length=1.0, elements=2, damping=0.0
):
    """Elastic arm on a hinge with a motor, and a load at its tip; a gust begins at 0.05 s."""
    mech = bd.Mechanism(gravity=EARTH)
    torque = mech.input("torque", default=0.0, unit="N m")
    section = rectangle(thickness, width, damping=damping)
    line = bd.Line((0.0, 0.0), (length, 0.0))
    arm = mech.add(bd.Beam("arm", line, section, elements=elements))
    hinge = mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), arm.start))
    load = mech.add(bd.PointMass("load", mass, at=(length, 0.0)))
    mech.add(bd.Revolute("pin", arm.end, load.point))
    mech.add(bd.TorsionSpring("spring", hinge.a, hinge.b, stiffness))
    mech.add(bd.Moment("motor", arm.start, torque))
    lag = mech.state("lag", lambda lag, t: (torque - lag) / 0.02, start=0.2, unit="N m")
    mech.add(bd.Moment("slow motor", arm.end, lag))
    gust = bd.piecewise((0.05, lambda t: 0.0), lambda t: 2.0)
    mech.add(bd.Force("gust", arm.end, (0.0, gust)))
    mech.observe("tip", arm.end)
    mech.observe("hinge", hinge.reaction)
    return mech


@bd.model(t_end=T_END)
def damped_crane(mass=2.0, thickness=0.004):
    """Crane whose fast vibrations decay."""
    return crane(mass=mass, thickness=thickness, damping=1e-3)


@bd.model(t_end=T_END)
def swing(mass=2.0, length=1.0, elements=2):
    """Rod on a hinge with a motor."""
    mech = bd.Mechanism(gravity=EARTH)
    torque = mech.input("torque", default=0.0, unit="N m")
    rod = mech.add(bd.RigidBody.rod("rod", (0.0, 0.0), (length, 0.0), mass))
    hinge = mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), rod.at(0.0, 0.0)))
    mech.add(bd.Moment("motor", rod.at(0.0, 0.0), torque))
    mech.observe("tip", rod.at(length, 0.0))
    mech.observe("hinge", hinge.reaction)
    return mech


def export(folder, model=swing, integrator=ALPHA, **settings):
    settings = {"communication_step": STEP, "platforms": (), **settings}
    return bd.export_fmu(model, folder / "crane.fmu", integrator, **settings)


def describe(fmu):
    with zipfile.ZipFile(fmu.path) as archive:
        return ElementTree.fromstring(archive.read("modelDescription.xml"))


def variables(fmu):
    (parent,) = describe(fmu).iter("ModelVariables")
    return {x.get("name"): x for x in parent}


@pytest.mark.parametrize("fmi", [2, 3])
def test_contents(tmp_path, fmi):
    fmu = export(tmp_path, fmi=fmi, outputs=["tip.y", "hinge"])
    assert (fmu.inputs, fmu.outputs) == (("torque",), ("tip.y", "hinge.Fx", "hinge.Fy"))
    assert fmu.integrator == ALPHA.label
    with zipfile.ZipFile(fmu.path) as archive:
        names = set(archive.namelist())
        source = archive.read("sources/model.c").decode()
    listed = {x.get("name") for x in describe(fmu).iter("File" if fmi == 2 else "none")}
    assert {f"sources/{x}" for x in listed} | {"modelDescription.xml"} <= names
    assert describe(fmu).get("guid" if fmi == 2 else "instantiationToken") in source.replace(
        "\\173", "{"
    ).replace("\\175", "}")
    assert (f"sources/fmi{fmi}.c" in names, f"sources/fmi{5 - fmi}.c" in names) == (True, False)
    found = variables(fmu)
    assert found["torque"].get("causality") == "input"
    assert found["tip.y"].get("causality") == "output"
    units = {x.get("name") for x in describe(fmu).iter("Unit")}
    assert {"N m", "m", "N"} <= units


@pytest.mark.slow(reason="half a second")
def test_equal_models_give_equal_files(tmp_path):
    first = export(tmp_path, outputs=["tip.y"]).path.read_bytes()
    assert export(tmp_path, outputs=["tip.y"]).path.read_bytes() == first
    assert export(tmp_path, outputs=["tip.x"]).path.read_bytes() != first


@pytest.mark.slow(reason="half a second")
def test_unsuitable_models_and_arguments_are_rejected(tmp_path):
    controlled = swing()
    angle = controlled.sensor("angle", controlled.parts["rod"].at(0.0, 0.0), "angle")
    torque = controlled.inputs["torque"]
    controlled.add(bd.Controller("servo", 0.01, [angle], [torque], lambda x: (-x.reads[0],)))
    turned, rod = hinged(bd.RigidBody.rod("rod", (0.0, 0.0), (1.0, 0.0), 1.0))
    shaft = turned.ground.at(0.0, 0.0), rod.at(0.0, 0.0)
    turned.add(bd.Driver("drive", *shaft, turned.input("angle", 0.0, unit="rad")))
    turned.observe("tip", rod.at(1.0, 0.0))
    with_event = swing()
    with_event.when("tip.y", crosses=-0.5, do="stop", name="low")
    for model, settings, message in (
        (with_event, {}, r"the model has events \(low\)"),
        (controlled, {}, "the sampled controller 'servo' is called only in runs"),
        (swing, {"parameters": ["length"]}, "changes of length affect"),
        (swing, {"parameters": ["masss"]}, r"no parameter 'masss' .did you mean"),
        (swing, {"parameters": ["elements"]}, "must be a real number to be tunable"),
        (turned, {"t_end": 1.0}, "the input angle prescribes the motion of drive"),
        (swing, {"inputs": ["torqe"]}, r"no input 'torqe' .did you mean"),
        (swing, {"outputs": ["tap"]}, "no column 'tap'"),
        (swing, {"outputs": [1]}, "outputs must be a list of names"),
        (swing, {"fmi": 1}, "fmi must be"),
        (swing, {"platforms": ["vax"]}, "platforms must be"),
        (swing, {"platforms": ["aarch64-linux"], "fmi": 2}, "FMI 2.0 has no name"),
        (swing, {"real_time": 1.5}, "real_time must be a whole number"),
        (swing, {"real_time": 2, "integrator": bd.Radau()}, "real_time requires fixed steps"),
        (swing, {"integrator": bd.Ida()}, r"integrator must be .*, got Ida\(rtol=0.0001\)"),
        (swing, {"integrator": replace(ALPHA, formulation="stabilized-index2")}, "index3"),
        (swing, {"integrator": replace(ALPHA, start="plain")}, r"GeneralizedAlpha\(start='plain'"),
        (swing, {"integrator": bd.GeneralizedAlpha(rtol=1e-4)}, "with fixed steps"),
    ):
        with pytest.raises(bd.BeamdaeError, match=message):
            export(tmp_path, model, **settings)
    with pytest.raises(bd.BeamdaeError, match=r"must end with \.fmu"):
        bd.export_fmu(crane, tmp_path / "crane.zip")


def test_parameters_that_are_not_powers_are_rejected(tmp_path):
    @bd.model(t_end=1.0)
    def ball(load=1.0):
        mech = bd.Mechanism()
        point = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 1.0))).point
        mech.add(bd.Force("load", point, (np.sin(load), 0.0)))
        mech.observe("ball", point)
        return mech

    with pytest.raises(bd.BeamdaeError, match="not through a power"):
        export(tmp_path, ball, parameters=["load"])


@pytest.mark.slow(reason="half a second and more")
def test_regression_parameters_end_where_the_model_ends(tmp_path):
    """The FMU accepted values that the model function rejects, such as a negative mass."""

    @bd.model(t_end=T_END)
    def ball(mass=2.0, pull=3.0, drag=0.0):
        assert mass < 100.0
        mech = bd.Mechanism(gravity=EARTH)
        point = mech.add(bd.PointMass("ball", mass, at=(0.0, 1.0))).point
        mech.add(bd.Force("pull", point, (min(pull, 4.0), 0.0)))
        mech.add(bd.Spring("drag", mech.ground.at(0.0, 0.0), point, damping=drag))
        mech.observe("ball", point)
        return mech

    ranges = {"mass": (2e-6, 100.0), "pull": (-np.inf, 4.0), "drag": (0.0, np.inf)}
    for fmi in (2, 3):
        found = variables(export(tmp_path, ball, fmi=fmi, parameters=list(ranges)))
        for name, limits in ranges.items():
            require_limits(found[name][0] if fmi == 2 else found[name], *limits)


def require_limits(variable, low, high):
    """Require that the range ends at these values or by 2 % of them inside."""
    for key, limit, sign in (("min", low, 1.0), ("max", high, -1.0)):
        found = float(variable.get(key, -sign * np.inf))
        assert found == limit or 0.0 <= sign * (found - limit) < 0.02 * abs(limit), (key, found)


def export_limited(folder, default, low, high):
    """Return the variable of a parameter that the model rejects below `low` and above `high`."""

    @bd.model(t_end=T_END)
    def ball(pull=default):
        if not low <= pull <= high:
            raise ValueError(f"pull must be {low} to {high}")
        mech = bd.Mechanism()
        point = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 1.0))).point
        mech.add(bd.Force("pull", point, (pull, 0.0)))
        mech.observe("ball", point)
        return mech

    return variables(export(folder, ball, parameters=["pull"]))["pull"][0]


@pytest.mark.parametrize(
    ("default", "low", "high"),
    [
        *((2.0, 1.5, 3.0), (2.0, 1.97, 2.04), (-3.0, -4.1234, -1.2345), (5.0, -700.0, 6000.0)),
        *((0.0, 0.0, 1.3), (0.0, -0.7, 0.4), (0.0, -np.inf, 1.0)),
    ],
)
def test_regression_ranges_of_parameters_are_found(tmp_path, default, low, high):
    """The FMU accepted only the default if the model rejects its half and its double, or 2."""
    require_limits(export_limited(tmp_path, default, low, high), low, high)


def test_regression_defaults_at_limits_are_named(tmp_path):
    """The export passed on the error of the model function."""
    message = r"the model cannot be built with pull = 1.996 .*pull must be 2.0 to 3.0"
    with pytest.raises(bd.BeamdaeError, match=message):
        export_limited(tmp_path, 2.0, 2.0, 3.0)


def test_round_limits_of_models_are_accepted(tmp_path):
    variable = export_limited(tmp_path, 0.02, 0.012, 0.03)
    assert (variable.get("min"), variable.get("max")) == ("0.012", "0.03")


# Compiled FMUs. Without optimization, the compiler takes a fifth of the time.
@pytest.fixture(autouse=True, scope="module")
def fast_compilation():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CFLAGS", "-O0")
        yield


BLOCKER = """
import sys
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("beamdae", "casadi"):
            raise ImportError(name)
sys.meta_path.insert(0, Blocker())
"""


def run_without_beamdae(script, *arguments):
    """Return the lines that a script prints in a process that cannot import beamdae."""
    command = [sys.executable, "-c", BLOCKER + textwrap.dedent(script), *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return result.stdout.splitlines()


# Generalized-alpha with both versions of the interface, and Radau.
EXPORTS = {
    "fmi2": (crane, {"fmi": 2}),
    "fmi3": (crane, {"fmi": 3}),
    "radau": (damped_crane, {"fmi": 3, "integrator": bd.Radau(RADAU_RTOL)}),
}


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Function that returns the FMU of a name in `EXPORTS` with a binary for this machine."""
    pytest.importorskip("fmpy")
    if not any(map(shutil.which, ("cc", "gcc", "clang"))):
        pytest.skip("no C compiler")
    fmus = {}

    def get(name):
        if name not in fmus:
            model, settings = EXPORTS[name]
            folder = tmp_path_factory.mktemp("fmu")
            fmus[name] = export(folder, model, platforms=None, parameters=PARAMETERS, **settings)
        return fmus[name]

    return get


@pytest.fixture(params=["fmi2", "fmi3"])
def fmu(request, compiled):
    return compiled(request.param)


@pytest.fixture(params=list(EXPORTS))
def any_fmu(request, compiled):
    return compiled(request.param)


@pytest.fixture
def radau_fmu(compiled):
    return compiled("radau")


# Uniform access to instances of both versions of the interface.
ADAPTER = """
import json, sys
import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

path, step = sys.argv[1], float(sys.argv[2])
about = read_model_description(path)
numbers = {x.name: x.valueReference for x in about.modelVariables}
folder = extract(path)
is_two = about.fmiVersion == "2.0"


class Instance:
    def __init__(self, name, **values):
        kind, token = (
            (FMU2Slave, about.guid) if is_two else (FMU3Slave, about.instantiationToken)
        )
        self.fmu = fmu = kind(
            guid=token, unzipDirectory=folder, instanceName=name,
            modelIdentifier=about.coSimulation.modelIdentifier,
        )
        fmu.instantiate()
        if is_two:
            fmu.setupExperiment(startTime=0.0)
            fmu.enterInitializationMode()
        else:
            fmu.enterInitializationMode(startTime=0.0)
        self.set(**values)
        fmu.exitInitializationMode()
        self.k = 0

    def set(self, **values):
        set_values = self.fmu.setReal if is_two else self.fmu.setFloat64
        set_values([numbers[x] for x in values], list(values.values()))

    def get(self, *names):
        get_values = self.fmu.getReal if is_two else self.fmu.getFloat64
        return get_values([numbers[x] for x in names])

    def step(self):
        self.fmu.doStep(currentCommunicationPoint=self.k * step, communicationStepSize=step)
        self.k += 1

    def state(self):
        return self.k, (self.fmu.getFMUstate() if is_two else self.fmu.getFMUState())

    def restore(self, state):
        self.k = state[0]
        (self.fmu.setFMUstate if is_two else self.fmu.setFMUState)(state[1])

    def derivative(self, unknowns, known):
        return self.fmu.getDirectionalDerivative(
            [numbers[x] for x in unknowns], [numbers[known]], [1.0]
        )


outputs = [x.name for x in about.modelVariables if x.causality == "output"]


def call_refused(*actions):
    for action in actions:
        try:
            action()
            print("no error")
        except Exception as problem:
            assert "3" in str(problem) or "error" in str(problem)
"""


def run_fmu(script, fmu, *arguments):
    """Return the lines that a script about an FMU prints."""
    return run_without_beamdae(ADAPTER + textwrap.dedent(script), fmu.path, STEP, *arguments)


def require_refusals(lines, expected):
    assert len(lines) == len(expected), lines
    assert all(words in line for words, line in zip(expected, lines, strict=True)), lines


@pytest.mark.slow(reason="compiles an FMU")
def test_equality_with_simulate(fmu):
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(fmu.path)) == []
    # Two instances at once, with different values.
    script = """
    one, two = Instance("one"), Instance("two", **json.loads(sys.argv[3]))
    rows = []
    for k in range(100):
        one.step()
        two.step()
        rows.append([one.get(*outputs), two.get(*outputs)])
    print(json.dumps([outputs, rows]))
    """
    values = json.dumps({**VALUES, "torque": TORQUE})
    (line,) = run_fmu(script, fmu, values)
    names, rows = json.loads(line)
    results = np.array(rows)
    runs = (
        bd.simulate(crane, ALPHA, output_step=STEP),
        bd.simulate(crane(**VALUES), ALPHA, output_step=STEP, inputs={"torque": TORQUE}),
    )
    # At the breakpoint, simulate stores the state after the restart.
    compared = np.arange(100) != 49
    for which, run in enumerate(runs):
        table = run.table()
        table.columns = [x.rpartition(" [")[0] for x in table.columns]
        for k, name in enumerate(names):
            expected = table[name].to_numpy()[1:]
            error = np.abs(results[:, which, k] - expected)[compared]
            # Rounding errors of accelerations, divided by the square of the step, are 1e-9.
            assert np.max(error) <= 1e-8 * np.ptp(expected), name


def compare(lines, model, method, t_end, rtol, **settings):
    """Compare printed outputs after each step with a run, relative to their ranges."""
    names, rows = json.loads(lines[0])
    table = bd.simulate(model, method, t_end=t_end, output_step=STEP, **settings).table()
    table.columns = [x.rpartition(" [")[0] for x in table.columns]
    for name, column in zip(names, np.transpose(rows), strict=True):
        expected = table[name].to_numpy()[1:]
        # Reactions are of order 3.
        limit = 10.0 * rtol if name.startswith("hinge") else rtol
        assert np.max(np.abs(column - expected)) <= limit * np.ptp(expected), name


@pytest.mark.slow(reason="compiles an FMU")
def test_radau_equals_simulate(radau_fmu):
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(radau_fmu.path)) == []
    script = """
    a, rows = Instance("a", mass=1.5, torque=0.1), []
    for k in range(100):
        a.step()
        rows.append(a.get(*outputs))
    print(json.dumps([outputs, rows]))
    """
    lines = run_fmu(script, radau_fmu)
    model = damped_crane(mass=1.5)
    compare(lines, model, bd.Radau(RADAU_RTOL), T_END, 1e-6, inputs={"torque": 0.1})


@pytest.mark.slow(reason="compiles an FMU")
@pytest.mark.parametrize("time_constant", [None, 1e-3])
def test_regression_reactions_of_driven_mechanisms_are_resolved(tmp_path, compiled, time_constant):
    """A reaction was wrong by 64 % of half its range, with the filter by 78 %, in silence."""
    settings = {"integrator": bd.Radau(1e-5), "platforms": None, "t_end": 1.0}
    mech = driven_slide(filter_time=time_constant)
    fmu = bd.export_fmu(mech, tmp_path / "slide.fmu", **settings)
    script = """
    a, rows = Instance("a"), []
    for _ in range(1000):
        a.step()
        rows += a.get("drive.F")
    print(json.dumps(rows))
    """
    (line,) = run_fmu(script, fmu)
    exact = reaction_of_driven_slide(1e-3 * np.arange(1, 1001))
    assert np.max(np.abs(json.loads(line) - exact)) < 1e-3 * 0.5 * np.ptp(exact)


@pytest.mark.slow(reason="compiles an FMU")
@pytest.mark.parametrize("communication_step", [STEP, 1e-4, 5e-3])
def test_radau_steps_do_not_depend_on_communication_steps(radau_fmu, communication_step):
    """Outputs between the ends of steps are those of the polynomial of the step."""
    script = """
    a, rows, length = Instance("a"), [], float(sys.argv[3])
    for k in range(round(0.1 / length)):
        a.fmu.doStep(currentCommunicationPoint=k * length, communicationStepSize=length)
    print(json.dumps([x.hex() for x in a.get(*outputs)]))
    """
    (line,) = run_fmu(script, radau_fmu, communication_step)
    values = np.array([float.fromhex(x) for x in json.loads(line)])
    table = bd.simulate(damped_crane, bd.Radau(1e-9), output_step=T_END).table()
    names = [x.rpartition(" [")[0] for x in table.columns]
    expected = table.to_numpy()[-1][[names.index(x) for x in radau_fmu.outputs]]
    assert values == pytest.approx(expected, rel=1e-4, abs=1e-5)


@pytest.mark.slow(reason="compiles an FMU")
def test_radau_with_changing_inputs(radau_fmu):
    """Steps that pass over a communication point are repeated if an input changes there."""
    script = """
    a, rows = Instance("a"), []
    for k in range(49):
        if k % 5 == 0:
            (angle,) = a.get("tip.angle")
            a.set(torque=-40.0 * (angle - 0.001))
        a.step()
        # Simulate stores the state after the change of the controller.
        rows.append(a.get("tip.x", "tip.y", "tip.angle"))
    print(json.dumps([["tip.x", "tip.y", "tip.angle"], rows]))
    """
    lines = run_fmu(script, radau_fmu)
    controlled = damped_crane()
    angle = controlled.sensor("angle", controlled.parts["arm"].end, "angle")
    drives = [controlled.inputs["torque"]]
    law = lambda x: (-40.0 * (x.reads[0] - 0.001),)  # noqa: E731
    controlled.add(bd.Controller("servo", 5 * STEP, [angle], drives, law))
    compare(lines, controlled, bd.Radau(RADAU_RTOL), 49 * STEP, 1e-6)


@bd.model(t_end=50 * STEP)
def ball_and_pin(height=0.004, radius=0.005):
    """Ball that hits a thin pin for a hundredth of a step, without other forces."""
    mech = bd.Mechanism()
    point = mech.add(bd.PointMass("ball", 1.0, at=(-4.045, height), velocity=(1000.0, 0.0))).point
    pin = bd.CircleSurface(mech.ground.at(0.0, 0.0), radius=radius)
    mech.add(bd.Contact("pin", point, pin, 1e10))
    mech.observe("ball", point)
    return mech


@pytest.mark.slow(reason="compiles an FMU")
def test_radau_finds_contacts_that_steps_pass_over(tmp_path, compiled):
    """Without forces, steps are as long as permitted: the ball passed the pin in one step."""
    fmu = export(tmp_path, ball_and_pin, integrator=bd.Radau(RADAU_RTOL), platforms=None)
    script = """
    a = Instance("a")
    for _ in range(50):
        a.step()
    print(json.dumps(a.get("ball.y", "ball.y_dot")))
    """
    (line,) = run_fmu(script, fmu)
    table = bd.simulate(ball_and_pin, bd.Radau(RADAU_RTOL), output_step=50 * STEP).table()
    expected = [table[x].iloc[-1] for x in ("ball.y [m]", "ball.y_dot [m/s]")]
    assert expected[1] > 0.5
    assert json.loads(line) == pytest.approx(expected, rel=1e-4)


@pytest.mark.slow(reason="half a second")
def test_regression_contacts_are_exported_with_radau(tmp_path):
    """Fixed steps passed over contacts without notice."""
    with pytest.warns(bd.BeamdaeWarning, match=r"contacts \(pin\) last only a few steps"):
        export(tmp_path, ball_and_pin)
    with pytest.warns(bd.BeamdaeWarning, match="fixed steps of 0.001 s are inaccurate"):
        fixed = export(tmp_path, ball_and_pin, integrator=bd.GeneralizedAlpha(STEP), real_time=2)
    assert fixed.integrator == bd.GeneralizedAlpha(STEP).label
    assert export(tmp_path, ball_and_pin, integrator=None).integrator == bd.Radau().label


@pytest.mark.slow(reason="half a second and more")
def test_regression_undamped_beams_have_a_warning_if_inputs_jump(tmp_path):
    """An arm of 64 elements took 4 s per millisecond with Radau, without a warning."""

    def build(damping):
        strip = rectangle(0.004, damping=damping)
        mech, arm = clamped_beam(strip, 1, name="arm")
        mech.add(bd.Moment("motor", arm.end, mech.input("torque")))
        mech.observe("tip", arm.end)
        return mech, arm

    settings = {"t_end": 0.1, "platforms": ()}
    with pytest.warns(
        bd.BeamdaeWarning, match=r"without damping \(arm\), which adaptive steps res"
    ):
        export(tmp_path, build(0.0)[0], integrator=bd.Radau(), **settings)
    export(tmp_path, build(0.0)[0], integrator=bd.Radau(), inputs=[], **settings)
    export(tmp_path, build(0.0)[0], integrator=ALPHA, **settings)
    export(tmp_path, build(1e-5)[0], integrator=bd.Radau(), **settings)
    mech, arm = build(0.0)
    mech.add(bd.RayleighDamping("damping", arm, stiffness=1e-5))
    export(tmp_path, mech, integrator=bd.Radau(), **settings)


@pytest.mark.slow(reason="half a second")
@pytest.mark.parametrize("width", [0.002, 0.1])
def test_regression_short_peaks_that_an_fmu_passes_over_have_a_warning(tmp_path, width):
    """A force that acts in a narrow region was lost without notice, with both integrators."""
    mech, ball = free_ball(velocity=(1.0, 0.0))
    x = mech.sensor("x", ball.point, "x")
    push = bd.Force("push", ball.point, (0.0, ca.exp(-(((x - 0.5) / width) ** 2)) / width))
    mech.add(push)
    settings = {"t_end": 1.0, "platforms": ()}
    exports = (
        ({"integrator": bd.GeneralizedAlpha(0.02)}, r"in a trial run, ball\.y\S*: the error"),
        (
            {"integrator": bd.Radau(1e-5)},
            r"may pass over short peaks of forces \(push at t = 0.5 s",
        ),
    )
    for more, message in exports:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", bd.BeamdaeWarning)
            bd.export_fmu(mech, tmp_path / "ball.fmu", **settings, **more)
        texts = [str(x.message) for x in caught]
        assert any(re.search(message, text) for text in texts) == (width < 0.02)
        assert bool(texts) == (width < 0.02)


def ball_on_spring(stiffness=4e5):
    return free_ball((1.01, 0.0), spring=(stiffness, 0.0, 1.0))[0]


@pytest.mark.slow(reason="trial runs")
def test_regression_default_exports_resolve_vibrations_and_fixed_steps_warn(tmp_path):
    """Default steps of 1 ms changed the period of a vibration by 12 % of its range in silence."""

    reed = bd.model(t_end=0.4)(ball_on_spring)
    exact = export(tmp_path, reed, integrator=None)
    assert exact.warnings == ()
    for settings in ({"integrator": ALPHA}, {"real_time": 2}):
        with pytest.warns(bd.BeamdaeWarning, match="in a trial run, .*: the error is"):
            fixed = export(tmp_path, reed, **settings)
        assert any("the error is more than 100 %" in x for x in fixed.warnings)


@pytest.mark.parametrize("method", [bd.GeneralizedAlpha(1e-4), bd.Radau()], ids=["alpha", "radau"])
def test_limits_of_the_wall_time_are_those_of_runs(tmp_path, method):
    """The trial run with fixed steps ended at the limit, and its warning spoke of Radau."""
    limited = replace(method, time_limit=1e-6)
    assert export(tmp_path, integrator=limited, t_end=1.0).warnings == ()


@pytest.mark.slow(reason="20 000 steps")
def test_regression_fmus_with_very_many_adaptive_steps_have_a_warning(tmp_path):
    """A beam without damping took 300 000 steps in 0.5 s, of which nothing was said."""
    mech = ball_on_spring(1e10)
    with pytest.warns(bd.BeamdaeWarning, match="20000 adaptive steps end at t = .* s of 5 s"):
        export(tmp_path, mech, integrator=bd.Radau(), t_end=5.0)


@pytest.mark.slow(reason="trial runs")
def test_regression_outputs_that_steps_do_not_resolve_have_a_warning(tmp_path):
    """Sudden load on an undamped cantilever: reactions were wrong by 10 % of their range."""

    def cantilever(damping):
        strip = rectangle(0.01, damping=damping)
        mech, arm = clamped_beam(strip, 8, name="arm")
        clamp = mech.part("clamp")
        mech.add(bd.Force("load", arm.end, (0.0, -10.0)))
        mech.observe("tip", arm.end)
        mech.observe("clamp", clamp.reaction)
        return mech

    def export_undamped(**outputs):
        return list(export(tmp_path, cantilever(0.0), **outputs, **settings).warnings)

    settings = {"integrator": bd.Radau(), "t_end": 0.05, "platforms": ()}
    (warning,) = export_undamped()
    assert re.search(r"the error is .*clamp.Fy", warning)
    # Outputs whose errors are small have no warning, and neither have damped vibrations.
    assert export_undamped(outputs=["tip.y"]) == []
    assert export(tmp_path, cantilever(1e-5), **settings).warnings == ()
    method = bd.GeneralizedAlpha(4e-3)
    fixed = {**settings, "integrator": method, "outputs": ["tip.y"], "t_end": 0.2}
    coarse = export(tmp_path, cantilever(1e-5), **fixed).warnings
    # The clamp, whose reactions are less accurate, is no output.
    (warning,) = (x for x in coarse if "the error is" in x)
    assert re.search(
        r"tip.y: the error is about [\d.]+ % of half its range.*; use .*step=", warning
    )


@pytest.mark.slow(reason="half a second")
def test_radau_rejects_parameters_that_change_surfaces(tmp_path):
    with pytest.raises(bd.BeamdaeError, match="the surface of pin changes"):
        export(tmp_path, ball_and_pin, integrator=bd.Radau(), parameters=["radius"])


@pytest.mark.slow(reason="compiles an FMU")
def test_states_and_derivatives(any_fmu):
    script = """
    a, b = Instance("a", torque=1.0), Instance("b")
    for _ in range(60):
        a.step()
    saved = a.state()

    def go_on(instance, torque):
        rows = []
        for k in range(20):
            instance.set(torque=torque)
            instance.step()
            rows.append([float(x).hex() for x in instance.get(*outputs)])
        return rows

    rows = [go_on(a, 2.0)]
    for instance in (a, b):
        instance.restore(saved)
        rows.append(go_on(instance, 2.0))

    def after_step(**values):
        a.restore(saved)
        a.set(**values)
        a.step()
        return np.array(a.get(*outputs))

    derivatives = []
    changes = {"torque": (2.0, 0.1), "mass": (2.0, 1e-2), "thickness": (4e-3, 1e-6)}
    for name, (value, change) in changes.items():
        difference = after_step(**{name: value + change}) - after_step(**{name: value - change})
        a.restore(saved)
        a.set(**{name: value})
        a.step()
        exact = a.derivative(outputs, name)
        derivatives.append([list(exact), (difference / (2.0 * change)).tolist()])
    # Derivatives do not change what follows.
    a.restore(saved)
    a.derivative(outputs, "mass")
    rows.append(go_on(a, 2.0))
    print(json.dumps([rows, derivatives]))
    """
    (line,) = run_fmu(script, any_fmu)
    rows, derivatives = json.loads(line)
    assert rows[1:] == [rows[0]] * 3
    for exact, difference in derivatives:
        scale = np.max(np.abs(exact))
        assert scale > 0.0
        # The differences contain errors of Newton's iteration.
        assert exact == pytest.approx(difference, rel=1e-4, abs=1e-6 * scale)


@pytest.mark.slow(reason="compiles an FMU")
def test_errors_are_statuses_with_a_sentence(any_fmu):
    script = """
    a = Instance("a")
    call_refused(
        lambda: a.set(torque=float("nan")),
        lambda: a.derivative(outputs, "mass"),
        lambda: a.fmu.doStep(currentCommunicationPoint=0.5, communicationStepSize=step),
        lambda: (a.set(torque=1e300), a.step()),
    )
    """
    lines = run_fmu(script, any_fmu)
    expected = (
        "torque: the value must be finite.",
        "Directional derivatives exist after the first step, not at t = 0 s.",
        "The communication point is not the end of the last step.",
        "t = 0 s",
    )
    require_refusals(lines, expected)


@pytest.mark.slow(reason="compiles an FMU")
def test_regression_changed_inputs_match_sampled_controllers(fmu):
    """Accelerations did not follow a changed input, which acted half a step too late."""
    stiffness, offset, samples = 40.0, 0.1, 5
    script = """
    a, rows = Instance("a"), []
    for k in range(100):
        if k % 5 == 0:
            (angle,) = a.get("tip.angle")
            a.set(torque=-40.0 * (angle - 0.1))
        a.step()
        rows.append(a.get(*outputs))
    print(json.dumps([outputs, rows]))
    """
    lines = run_fmu(script, fmu)
    controlled = crane()
    angle = controlled.sensor("angle", controlled.parts["arm"].end, "angle")

    def law(x):
        return (-stiffness * (x.reads[0] - offset),)

    drives = [controlled.inputs["torque"]]
    controlled.add(bd.Controller("servo", samples * STEP, [angle], drives, law))
    # At samples, both give the state before the change.
    compare(lines, controlled, ALPHA, T_END, 1e-8)


@pytest.mark.slow(reason="compiles an FMU")
def test_regression_very_short_communication_steps(any_fmu):
    """Rounding errors of positions were divided by the square of a communication step of 1 ns."""
    script = """
    a, b, rows = Instance("a"), Instance("b"), []
    for k in range(80):
        a.step()
        for length in (1e-9, 1e-7, step - 1.01e-7):
            b.fmu.doStep(currentCommunicationPoint=b.t, communicationStepSize=length)
            b.t += length
            if length < step / 2:
                short = b.get(*outputs)
                before = rows[-1][0] if rows else short
        rows.append([a.get(*outputs), b.get(*outputs), short, before])
    print(json.dumps(rows))
    """
    (line,) = run_without_beamdae(
        ADAPTER.replace("self.k = 0", "self.k, self.t = 0, 0.0") + textwrap.dedent(script),
        any_fmu.path,
        STEP,
    )
    exact, divided, short, before = np.moveaxis(json.loads(line), 1, 0)
    size = np.ptp(exact, axis=0)
    assert np.max(np.abs(divided - exact) / size) < 2e-3
    # Apart from the gust, nothing happens in 0.1 us.
    smooth = np.abs(np.arange(80) - 50) > 1
    assert np.max((np.abs(short - before) / size)[smooth]) < 1e-3


@pytest.mark.slow(reason="compiles an FMU")
def test_regression_late_times_do_not_restart_the_method(fmu):
    """Rounding errors of late times looked like changes of the step."""
    script = """
    import struct

    def steps(time):
        a = Instance("a")
        for _ in range(60):
            a.step()
        _, state = a.state()
        two = (a.fmu.serializeFMUstate, a.fmu.deSerializeFMUstate) if is_two else None
        save, load = two or (a.fmu.serializeFMUState, a.fmu.deserializeFMUState)
        data = save(state)
        token = len(about.guid if is_two else about.instantiationToken)
        # The time is the first number after the token.
        assert abs(struct.unpack_from("d", data, token)[0] - 0.06) < 1e-12
        a.restore((0, load(data[:token] + struct.pack("d", time) + data[token + 8:])))
        for k in range(20):
            a.fmu.doStep(currentCommunicationPoint=time + k * step, communicationStepSize=step)
        return a.get(*outputs)

    print(json.dumps([steps(0.06), steps(1e6)]))
    """
    (line,) = run_fmu(script, fmu)
    early, late = json.loads(line)
    assert late == pytest.approx(early, rel=1e-10)


@pytest.mark.slow(reason="compiles an FMU")
def test_regression_wrong_calls_are_errors(any_fmu):
    """Some of these calls ended the process, did not return, or gave wrong results."""
    script = """
    a, b = Instance("a"), Instance("b")
    a.step()
    restore, free = (
        (a.fmu.fmi2SetFMUstate, a.fmu.fmi2FreeFMUstate)
        if is_two
        else (a.fmu.fmi3SetFMUState, a.fmu.fmi3FreeFMUState)
    )
    free(a.fmu.component, None)
    _, state = a.state()
    save = a.fmu.serializeFMUstate if is_two else a.fmu.serializeFMUState
    load = a.fmu.deSerializeFMUstate if is_two else a.fmu.deserializeFMUState
    data = save(state)

    def advance(t, length):
        a.fmu.doStep(currentCommunicationPoint=t, communicationStepSize=length)

    def stop():
        b.fmu.terminate()
        b.step()

    def begin():
        b.fmu.reset()
        b.fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=step)

    call_refused(
        lambda: restore(a.fmu.component, None),
        lambda: load(b"x" + data[1:]),
        lambda: advance(step, float("inf")),
        lambda: advance(step, 1e300),
        lambda: advance(0.5 * step, step),
        lambda: a.fmu.exitInitializationMode(),
        lambda: a.set(mass=-1.0),
        stop,
        begin,
    )
    """
    lines = run_fmu(script, any_fmu)
    expected = (
        "no saved state to restore",
        "not a state of this FMU",
        "positive and finite",
        "longer than 1e9 steps of the model",
        "not the end of the last step",
        "not in initialization mode",
        "mass: the value -1 is outside the range",
        "is terminated",
        "is not initialized",
    )
    require_refusals(lines, expected)


@pytest.mark.slow(reason="compiles an FMU")
def test_regression_times_of_the_experiment_are_enforced(any_fmu):
    """Steps beyond the stop time and values after the end of a run were accepted."""
    script = """
    a = Instance("a")
    a.fmu.reset()
    if is_two:
        a.fmu.setupExperiment(startTime=0.0, stopTime=2 * step)
        a.fmu.enterInitializationMode()
    else:
        a.fmu.enterInitializationMode(startTime=0.0, stopTime=2 * step)
    a.fmu.exitInitializationMode()
    a.step(), a.step()

    def start_later():
        a.fmu.reset()
        if is_two:
            a.fmu.setupExperiment(startTime=1.0)
        else:
            a.fmu.enterInitializationMode(startTime=1.0)

    def set_after_the_end():
        b = Instance("b")
        b.fmu.terminate()
        b.set(torque=1.0)

    call_refused(a.step, start_later, set_after_the_end)
    """
    lines = run_fmu(script, any_fmu)
    expected = ("t = 0.003 s, after the stop time", "start time must be 0", "is terminated")
    require_refusals(lines, expected)


@pytest.mark.slow(reason="compiles an FMU")
@pytest.mark.parametrize("integrator", [ALPHA, bd.Radau(RADAU_RTOL)], ids=["alpha", "radau"])
def test_matrices_that_require_row_exchanges(tmp_path, compiled, integrator):
    """A slider without mass has no pivot on the diagonal, before or after a restored state."""
    t, q, v = symbols(2)
    lam = ca.SX.sym("lam", 1)
    system = bd.ConstrainedSystem(
        t=t,
        q=q,
        v=v,
        mass=[1.0, 0.0],
        force=ca.vertcat(-q[0], -5.0 * q[0]),
        constraints={"rod [N]": q[1] - ca.sin(q[0])},
        q0=[1.0, np.sin(1.0)],
        v0=[0.0, 0.0],
        lam=lam,
        observe={"crank [rad]": q[0], "rod [N]": lam[0]},
    )
    settings = {"integrator": integrator, "fmi": 3}
    fmu = export(tmp_path, system, t_end=0.1, platforms=None, **settings)
    script = """
    a, b, rows = Instance("a"), Instance("b"), []
    for k in range(100):
        if k == 50:
            b.restore(a.state())
        (b if k >= 50 else a).step()
        rows.append((b if k >= 50 else a).get(*outputs))
    print(json.dumps([outputs, rows]))
    """
    compare(run_fmu(script, fmu), system, integrator, 0.1, 1e-5)


@pytest.mark.slow(reason="compiles an FMU")
def test_coupling_error_of_an_fmu_and_a_controller_is_of_first_order(tmp_path):
    pytest.importorskip("fmpy")
    import fmu_coupling

    arm, t_end = fmu_coupling.export_arm(tmp_path), 0.2
    errors = []
    for step in (4e-3, 2e-3):
        exact = fmu_coupling.reference_angles(step, t_end)
        angles = fmu_coupling.couple(arm, step, t_end)
        errors.append(np.max(np.abs(angles - exact)) / np.ptp(exact))
    assert errors[1] < 0.05
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.4)


@pytest.mark.slow(reason="compiles an FMU")
def test_three_iterations_of_every_step_converge(tmp_path, compiled):
    script = """
    a, rows = Instance("a"), []
    for _ in range(50):
        a.step()
        rows.append(a.get(*outputs))
    print(json.dumps([outputs, rows]))
    """
    exact = bd.GeneralizedAlpha(STEP, newton_tolerance=1e-11)
    loose = bd.GeneralizedAlpha(STEP, newton_tolerance=1e-2)
    fixed = export(tmp_path, integrator=loose, platforms=None, real_time=3)
    compare(run_fmu(script, fixed), swing, exact, 50 * STEP, 1e-7)
    adapted = run_fmu(script, export(tmp_path, integrator=loose, platforms=None))
    with pytest.raises(AssertionError):
        compare(adapted, swing, exact, 50 * STEP, 1e-7)


@pytest.mark.slow(reason="compiles an FMU")
def test_communication_step_of_a_million_steps_is_rejected(tmp_path, compiled):
    """A run in one call ends with a sentence, and the FMU can be reset."""

    settings = {"integrator": bd.Radau(), "platforms": None, "t_end": 1e-3}
    fmu = export(tmp_path, ball_on_spring(1e10), **settings)
    script = """
    a, b = Instance("a"), Instance("b")
    b.step()
    try:
        a.fmu.doStep(currentCommunicationPoint=0.0, communicationStepSize=1e4)
        print("no error")
    except Exception as problem:
        assert "3" in str(problem) or "error" in str(problem)
    a.fmu.reset()
    a.fmu.setupExperiment(startTime=0.0)
    a.fmu.enterInitializationMode()
    a.fmu.exitInitializationMode()
    a.step()
    assert a.get(*outputs) == b.get(*outputs)
    """
    lines = run_fmu(script, fmu)
    assert ["more than 1e6 internal steps" in line for line in lines] == [True], lines


@pytest.mark.slow(reason="compiles for other platforms")
def test_binaries_of_other_platforms(tmp_path):
    pytest.importorskip("ziglang")
    names = ["aarch64-linux", "x86_64-windows", "x86_64-darwin", "aarch64-darwin"]
    fmu = export(tmp_path, fmi=3, platforms=names)
    with zipfile.ZipFile(fmu.path) as archive:
        binaries = {x.split("/")[1]: archive.read(x) for x in archive.namelist() if "binar" in x}
    # ELF for ARM (0xB7), PE, and Mach-O with 64 bits for x86 and ARM.
    assert binaries["aarch64-linux"][:4] == b"\x7fELF"
    assert binaries["aarch64-linux"][18] == 0xB7
    assert binaries["x86_64-windows"][:2] == b"MZ"
    assert b"PE\0\0\x64\x86" in binaries["x86_64-windows"][:1024]
    assert binaries["x86_64-darwin"][:8] == b"\xcf\xfa\xed\xfe\x07\0\0\x01"
    assert binaries["aarch64-darwin"][:8] == b"\xcf\xfa\xed\xfe\x0c\0\0\x01"
    for binary in binaries.values():
        assert b"fmi3DoStep" in binary
        assert b"fmi3GetDirectionalDerivative" in binary


@pytest.mark.slow(reason="half a second")
def test_tables_that_end_runs_are_rejected(tmp_path):
    def build(outside):
        table = bd.table([0.0, 1.0, 2.0], [0.0, 1.0, 4.0], kind="linear", outside=outside)
        mech, ball = free_ball((1.0, 0.0))
        ground = mech.ground.at(0.0, 0.0)
        mech.add(bd.Spring("spring", ground, ball.point, law=lambda x, rate: table(x)))
        return mech

    with pytest.raises(bd.BeamdaeError, match="the table of spring ends the run"):
        export(tmp_path, build("error"), t_end=1.0)
    assert export(tmp_path, build("hold"), t_end=1.0).outputs[0] == "ball.x"


@pytest.mark.parametrize("owner", ["gravity", "gust"])
def test_regression_tables_of_gravity_and_inputs_that_end_runs_are_rejected(tmp_path, owner):
    """The FMU continued where simulate stops."""
    table = bd.table([0.0, 0.5], [0.0, 1.0], kind="linear", outside="error")
    mech = bd.Mechanism(gravity=(0.0, table if owner == "gravity" else -9.81))
    ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
    gust = mech.input("gust", table if owner == "gust" else 0.0, unit="N")
    mech.add(bd.Force("push", ball.point, (gust, 0.0)))
    mech.observe("ball", ball.point)
    with pytest.raises(bd.BeamdaeError, match=f"the table of {owner} ends the run"):
        export(tmp_path, mech, t_end=1.0)


def test_regression_parameters_that_change_the_equilibrium_are_refused_with_the_cause(tmp_path):
    """The message did not say that the start in equilibrium depends on the parameter."""

    @bd.model(t_end=0.1)
    def sagging(load=1.0):
        mech, ball = free_ball(start="equilibrium")
        mech.add(bd.Spring("spring", mech.ground.at(0.0, 1.0), ball.point, 100.0, free_length=1.0))
        mech.add(bd.Force("load", ball.point, (0.0, -load)))
        return mech

    message = "load affect positions or velocities at the start, which is the equilibrium of the"
    with pytest.raises(bd.BeamdaeError, match=message):
        bd.export_fmu(sagging, tmp_path / "s.fmu", parameters=["load"], platforms=[])
