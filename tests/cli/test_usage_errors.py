"""Wrong arguments of every command end in one line, exit code 2 and no files."""

import shlex
from pathlib import Path

import pytest
from command_line import invoke
from model_texts import COLUMN, CROSS, OSCILLATOR, SHAKER, SPRUNG, STRUT, SWING, TRUSS, VAN_DER_POL

STRIP = """
import numpy as np

import beamdae as bd


@bd.model(t_end=0.02)
def arm(elements=1, E=7e10, width=0.02, name="hinge"):
    '''A falling strip.'''
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    alloy = bd.Material(E=E, nu=0.3, rho=2700.0)
    strip = bd.Section.rectangle(alloy, width=width, height=0.005)
    line = bd.Line((0.0, 0.0), (1.0, 0.0))
    beam = mech.add(bd.Beam("beam", line, strip, elements=elements))
    mech.add(bd.Revolute(name, mech.ground.at(0.0, 0.0), beam.start))
    mech.observe("tip", beam.end)
    return mech
"""
BOB = '''
import beamdae as bd


@bd.model(t_end=0.02)
def arm(mass=2.0, note=""):
    """A bob on a hinge."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1, center=(1.0, 0.0)))
    mech.add(bd.Revolute("hinge", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
    mech.observe("tip", bob.at(1.0, 0.0))
    return mech
'''
SWEEPS = """
import beamdae as bd

STEEL = bd.Material(E=2.1e11, nu=0.3, rho=7850.0)

@bd.model(t_end=0.1)
def swing(speed=1.0, turns=1, section=bd.Section.rectangle(STEEL, width=0.02, height=0.001)):
    mech = bd.Mechanism()
    bob = mech.add(bd.RigidBody("bob", 1.0, inertia=0.1, angular_velocity=speed))
    mech.observe("bob", bob.at(1.0, 0.0))
    if speed > 5.0:
        raise ValueError("too fast")
    return mech


@bd.sweep(swing, of="bob.y", integrator=bd.GeneralizedAlpha(step=5e-3))
def speeds():
    return {"speed": [1.0, 9.0]}


@bd.sweep(swing, of="bob.y", integrator=bd.GeneralizedAlpha(step=5e-3))
def others():
    return {"speed": [1.0, 9.0]}
"""
DROP = '''
import beamdae as bd


@bd.model(t_end=1.0)
def drop(height=2.0):
    """Drop a mass from a `height` [m]."""
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    mech.add(bd.PointMass("bob", 1.0, at=(0.0, height)))
    return mech


@bd.sweep(drop, measure={"parts": lambda model: len(model().parts)})
def heights():
    return {"height": [1.0, 2.0]}
'''
LOOSE_MASS = """
import beamdae as bd


@bd.model(t_end=1.0)
def oscillator(stiffness=30.0, damping=0.5, mass=1.0):
    "A mass on a spring."
    mech = bd.Mechanism()
    body = mech.add(bd.PointMass("mass", mass, at=(1.0, 0.0), velocity=(0.2, 0.0)))
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), body.point, stiffness, damping))
    mech.observe("mass", body.point)
    return mech
"""
GUIDED_MASS = """
import beamdae as bd


@bd.model(t_end=0.1)
def oscillator(stiffness=40.0, mass=bd.param(1.0, "kg", "mass on the spring")):
    "A mass on a spring along a rail."
    mech = bd.Mechanism()
    body = mech.add(bd.PointMass("mass", mass, at=(1.0, 0.0)))
    mech.add(bd.PointOnLine("rail", mech.ground.at(0.0, 0.0), body.point))
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), body.point, stiffness))
    mech.observe("mass", body.point)
    return mech
"""
LONG = 300 * "x"
# Models, and command lines without the name of the file, with a part of the message.
ERRORS = {
    "arm": (
        STRIP,
        [
            ("run --set elemnts=4", "'elemnts' (did you mean 'elements'?"),
            ("run --set elements", "--set elements: the setting must have the form NAME=VALUE."),
            (
                "run --set elements=1 --set elements=2",
                "--set elements=2: elements already has the value 1; omit one of them.",
            ),
            ("run --set =4", "--set =4: the setting must have the form NAME=VALUE."),
            ("run --set elements=0", "beam: elements must be a whole number of at least 1, got 0"),
            ("run --set E=-1", "E must be positive, got -1"),
            ("run --model arn", "'arn' (did you mean 'arm'?"),
            (
                "run --integrator idaa",
                "--integrator must be one of 'auto', 'ida', 'radau', 'generalized-alpha'",
            ),
            ("run --step 0.1", "--step is not a setting of auto (only of generalized-alpha"),
            ("run --rtol 0", "rtol must lie in [1e-14, 0.1], got 0"),
            (
                "run --integrator ida --option formulation=index9",
                "formulation must be one of 'stabilized-index1', 'ggl', 'index2', 'index1',",
            ),
            (
                "run --integrator ida --option max_order=7",
                "max_order must be one of 'auto', 1, 2, 3, 4, 5, got 7",
            ),
            ("run --columns beam", "--columns requires --accuracy"),
            ("run --accuracy 1% --columns 'no such'", "no column 'no such"),
            ("run --t-end -1", "--t-end must be positive, got -1"),
            ("run --output-step 0", "--output-step must be positive"),
            (
                "run --out 'a\nb'",
                "is not a valid file name; give a name of printable characters.",
            ),
            (
                "run --start beam.theta=1 --start rotation=30rpm",
                "this state determines all positions",
            ),
            ("run --start beam.theta=1 --start equilibrium", "this state determines all positions"),
            ("run --start beam.theta=1 --start 'as drawn'", "this state determines all positions"),
        ],
    ),
    "bob": (
        BOB,
        [
            ("run --out model.py", "Not a directory"),
            ("run --out model.py/below", "Not a directory"),
            ("run --out LONG", "File name too long"),
            ("run --set 'mass=[/b]'", "[/b]"),
            ("run --set 'mass=\ud800'", "\\ud800"),
            ("run --set mass=1e400", "must be finite"),
            ("run --output-step 1e-300", "--output-step"),
            ("run --checkpoint model.py/end.json", "--checkpoint model.py: the folder"),
            ("run --checkpoint /proc/nowhere/end.json", "--checkpoint /proc/nowhere: the folder"),
            ("run --checkpoint results", "the path is the folder of other results"),
            ("run --checkpoint results/arm.csv", "--out writes the same file"),
            ("run --checkpoint LONG", "File name too long"),
            ("run --checkpoint ''", "is not a valid file name"),
            ("run --time-limit 0", "--time-limit must be positive"),
            ("run --accuracy good", "must be a number such as 1% or 0.01, got 'good'"),
            ("run --accuracy nan", "--accuracy must be finite, got nan"),
            ("run --accuracy 0", "accuracy must lie in [1e-06, 0.1], got 0"),
            ("run --accuracy=-1", "accuracy must lie in [1e-06, 0.1], got -1"),
            ("run --accuracy 200%", "accuracy must lie in [1e-06, 0.1], got 2"),
            ("run --accuracy 1% --verify", "--accuracy and --verify are mutually exclusive"),
            ("run --out model.py", "--out model.py"),
            ("draw --out model.py", "--out model.py"),
            ("static --out model.py", "--out model.py"),
            ("modes --out model.py", "--out model.py"),
            ("compare --out model.py", "--out model.py"),
            ("compare --workers 1000000000", "must be"),
            ("compare --time-limit nan", "must be"),
        ],
    ),
    "shaker": (
        SHAKER,
        [
            ("bode --frequencies 5", "must have the form FIRST:LAST"),
            ("bode --frequencies 0:5", "must be positive and ascend"),
            ("bode --frequencies 1:5m", "measures"),
            ("bode --output mas.x", "did you mean 'mass.x'"),
            ("bode --input pull", "no input 'pull'"),
            ("bode --about rotation=3mm", "rad/s"),
        ],
    ),
    "vanderpol": (
        VAN_DER_POL,
        [
            ("periodic --period 4 --period-guess 4", "mutually exclusive"),
            ("periodic --set force=1.0", "depend on time; pass their period with --period."),
            ("periodic --period -1", "period must be positive"),
        ],
    ),
    "oscillator": (
        OSCILLATOR,
        [
            ("response --over frequency=1", "form FIRST:LAST"),
            ("response --over frequency=1Hz:2Hz", "the model states no unit of this parameter"),
            ("response --over force=0.1m:0.2m", "force"),
            ("response --over force=0.1:200mN", "one end has a unit and the other has none"),
            ("response --over frequency=1:1", "--over frequency=1:1: the range must have the form"),
            ("response --over frequency=nan:inf", "two different finite numbers"),
            ("response --over frequncy=1:2", "frequency"),
            ("response --over frequency=1:2 --period -1", "--period"),
            ("response --over frequency=1:2 --start bob.u=1", "bob.u"),
            (
                "response --over frequency=1:2 --plot bob.u",
                "there is no column 'bob.u' (did you mean 'bob.",
            ),
            (
                "response --over frequency=1:2 --plot bob.x --no-picture",
                "--plot requires the picture",
            ),
            ("periodic --plot bob.u", "there is no column 'bob.u' (did you mean 'bob."),
            ("periodic --plot bob.x --no-picture", "--plot requires the picture"),
        ],
    ),
    "cross": (
        CROSS,
        [
            ("modes --about rest", "--about must be"),
            (
                "modes --about equilibrium --speed 1",
                "--about equilibrium and --speed are mutually exclusive; omit one.",
            ),
            (
                "modes --speed 1 --multiple 6",
                "--multiple requires several speeds; repeat --speed or give START:STOP:COUNT.",
            ),
            ("modes --speed 1 --speed 2 --animate 1", "--animate does not support several speeds"),
            ("modes --animate 9", "--animate must be"),
            ("modes --animate 9 --set weight=9.81", "--animate must be"),
            ("modes --speed 0:12000rpm:x", "values must have the form START:STOP:COUNT"),
            ("modes --speed 10:3000rpm:4", "one end has a unit and the other has none"),
            ("modes --speed 0:5:1", "COUNT must be a whole number of at least 2"),
            ("modes --speed 0:5:1001", "COUNT must be at most 1000, got 1001"),
            ("modes --speed 5:5:3", "the ends of a range of 3 values must differ"),
            ("modes --speed 0:5mm:3", "the unit mm measures another quantity"),
            ("modes --speed 1 --set weight=9.81", "do not rotate with the mechanism"),
            ("modes -n 0", "--number must be"),
        ],
    ),
    "truss": (
        TRUSS,
        [
            (
                "static --to crown.y=2deg",
                "--to crown.y=2deg: the unit deg measures another quantity",
            ),
            ("static --to crown.y=1furlong", "the unit furlong is unknown; give the value in m"),
            ("static --to crown.y=a", "--to crown.y=a: the value must be a number"),
            ("static --to 2mm", "--to 2mm: the unit mm measures another quantity; give the number"),
            ("static --to crown.z=2mm --step 1mm", "must name an observed position"),
            ("static --to crown.y=0.1 --step 1s", "--step 1s: the unit s measures another"),
            (
                "static --to crown.y=0.1 --step 1mm --control 'arc length'",
                "--step 1mm: the unit mm measures another quantity; give the number",
            ),
        ],
    ),
    "sprung": (
        SPRUNG,
        [
            (
                "export --fmu model.fmu --platforms none --integrator ida",
                "--integrator must be Radau, or GeneralizedAlpha with fixed steps",
            ),
            (
                "export --fmu model.fmu --platforms none --inputs pull",
                "the model has no input 'pull'",
            ),
            (
                "export --fmu model.fmu --platforms none --platforms pdp11-unix",
                "platforms must be one of",
            ),
            (
                "export --fmu model.fmu --integrator generalized-alpha --real-time 0",
                "--real-time must be a whole number of at least 1",
            ),
        ],
    ),
    "column": (
        COLUMN,
        [
            ("run --plot tip.z", "there is no column 'tip.z' (did you mean"),
            ("run --x tip", "'tip' selects several columns"),
            ("run --data none.csv", "'none.csv' cannot be read"),
            ("run --x tip.x --no-picture", "run: --x requires the picture; omit --no-picture."),
            ("run --plot tip.x --no-picture --no-page", "require the picture or the page;"),
            ("static --x tip.z", "there is no column 'tip.z'"),
            ("static --plot tip.x_dot", "there is no column 'tip.x_dot'"),
            ("static --x tip", "static: 'tip' selects several columns"),
            ("static --plot tip.y --no-picture", "static: --plot requires the picture"),
        ],
    ),
    "swept": (
        SWING,
        [
            (
                "sweep --over speed=1:2",
                "--over speed=1:2: the values must have the form VALUE,VALUE,",
            ),
            ("sweep --over speed=0:2:3:log", "both ends must be positive for :log."),
            ("sweep --over turns=1:2:4", "turns must be of type int, got 1.3333333"),
            ("sweep --over speed", "--over speed: the setting must have the form NAME=VALUES."),
            (
                "sweep --over speed=1 --over speed=2",
                "--over speed=2: speed already has the value 1; omit one of them.",
            ),
            (
                "sweep --over speed=1 --set speed=2",
                "--over speed: the parameter is also set by --set; omit one of the options.",
            ),
            ("sweep --over section=a,b", "section must be of type Section, got 'a'."),
            ("sweep", "the file contains no sweep; vary a parameter with --over NAME=VALUES"),
            (
                "sweep --rtol 1e-3",
                "sweep: --rtol requires --over; to change a sweep in a file, edit the file.",
            ),
            (
                "sweep --over speed=1,2 --start equilibrum",
                "--start equilibrum: the start must be 'as drawn', 'equilibrium', rotation=SPEED, "
                "PART.COORDINATE=VALUE or the path of a saved run (did you mean 'equilibrium'?).",
            ),
            ("compare --start equilibrum", "--start equilibrum: the start must be "),
        ],
    ),
    "sweeps": (
        SWEEPS,
        [
            ("compare", "speeds is a sweep; use beamdae sweep."),
            ("compare --model speeds", "speeds is a sweep; use"),
            ("compare --model nine", "there is no model 'nine'; choose one of: swing."),
            (
                "sweep",
                "more than one sweep (speeds, others); choose one by name (--model).",
            ),
            (
                "sweep --model speed",
                "there is no sweep 'speed' (did you mean 'speeds'?); choose one of: speeds,",
            ),
        ],
    ),
    "drop": (
        DROP,
        [
            ("sweep --modes 1", "sweep: --modes and --buckling require --over NAME=VALUES."),
            ("sweep --over height=50cm,1 --modes 0", "sweep: --modes must be"),
            (
                "sweep --over height=50cm,1 --modes 1 --t-end 2",
                "sweep: --t-end is an option of runs",
            ),
            ("sweep --over height=50cm,1 --buckling 1 --of x", "sweep: --of is an option of runs"),
        ],
    ),
    "example": (
        "",
        [
            *(
                (f"sweep --over 'radius={values}'", "the unit N measures another quantity")
                for values in ("1 N:2:3", "1:2 N:3", "1N,2")
            ),
            ("sweep --over 'radius=1 m:x:3'", "values must have the form"),
            ("sweep --over 'radius=1 m:1000mm:3'", "values must differ"),
            (
                "view --no-browser --range radius=3",
                "--range radius=3: the values must have the form FIRST:LAST.",
            ),
            ("view --no-browser --range 'radius=1 N:2'", "the unit N measures another quantity"),
            (
                "view --no-browser --range radius=50cm:2",
                "one end has a unit and the other has none",
            ),
            ("view --no-browser --set 'radius=1 N'", "the unit N measures another quantity"),
            (
                "view --no-browser --port 70000",
                "view: port must be an integer from 0 to 65535, got 70000",
            ),
        ],
    ),
    "buckled": (
        STRUT,
        [
            ("buckling --load pres", "pres"),
        ],
    ),
    "loose mass": (
        LOOSE_MASS,
        [
            ("fit data.csv --by stiff --step 0.002", "has no parameter 'stiff'"),
            (
                "fit data.csv --by stiffness --bounds stiffness=1 --step 0.002",
                "must have the form LOW:HIGH",
            ),
            (
                "fit data.csv --by stiffness --sigma a --step 0.002",
                "sigma must be a number, got 'a'",
            ),
            (
                "fit data.csv --by stiffness --sigma mass.x=a --step 0.002",
                "sigma of mass.x must be a number, got 'a'",
            ),
            (
                "fit data.csv --by stiffness --experiment mass=2 --step 0.002",
                "EXPERIMENT:NAME=VALUE",
            ),
            (
                "fit data.csv --by stiffness --shift mass.x=a --step 0.002",
                "must have the form LOW:HIGH",
            ),
            (
                "fit data.csv --by stiffness --shift mass.x=-5:5ms --step 0.002",
                "one end has a unit",
            ),
            (
                "fit data.csv --by stiffness --shift mass.x=-5mm:5mm --step 0.002",
                "the unit mm measures another",
            ),
            (
                "fit data.csv --by stiffness --data-column Laser=mass.x --step 0.002",
                "data_columns contains 'Laser'",
            ),
            (
                "fit data.csv --by stiffness --data-column x=mass.x --data-column x=mass.y",
                "--data-column x=mass.y: x already has the value mass.x; omit one of them.",
            ),
            (
                "fit data.csv --by stiffness --shift mass.x --shift mass.x=-5ms:5ms --step 0.002",
                "--shift mass.x=-5ms:5ms: mass.x is given twice; omit one of them.",
            ),
            (
                "fit data.csv --by stiffness --starts 2 --step 0.002",
                "several starts need finite bounds",
            ),
            (
                "fit data.csv --by stiffness --integrator ida --step 0.002",
                "--step is not a setting of ida",
            ),
            ("fit none.csv --by stiffness", "'none.csv' cannot be read: No such file or directory"),
            (
                "fit data.csv --by k --t-end 1ms",
                "error: beamdae fit: no such option: --t-end",
            ),
            (
                "fit data.csv --by k --output-step 1ms",
                "error: beamdae fit: no such option: --output-step",
            ),
        ],
    ),
    "guided mass": (
        GUIDED_MASS,
        [
            ("optimize --by mass", "either --minimize or --maximize"),
            ("optimize --by mass --minimize masss", "must be one of mass, frequency:NUMBER"),
            ("optimize --by mass --minimize frequency:x", "must be one of mass"),
            ("optimize --by mass --minimize frequency:1:drawn", "must be one of mass"),
            ("optimize --by mass --minimize mass --at-most mass", "QUANTITY=LIMIT"),
            ("optimize --by mass --minimize mass --bounds mass=1", "LOW:HIGH"),
            ("optimize --by mass --minimize mass --bounds 'mass=1:2 m'", "the unit m measures"),
            ("optimize --by mass --minimize mass --bounds mass=500:3kg", "one end has a unit"),
            ("optimize --by mass --minimize mass --bounds mas=1g:2g", "has no parameter mas"),
            ("optimize --by mass --minimize mass --at-most mass=2m", "limit of mass is in m"),
            ("optimize --by mas --minimize mass", "did you mean 'mass'"),
            (
                "optimize --by mass --minimize mass --t 1s",
                "--t 1: no quantity is of the kind equilibrium:COLUMN",
            ),
            (
                "optimize --by mass --minimize mass --bounds mass=",
                "the form LOW:HIGH, LOW: or :HIGH",
            ),
        ],
    ),
}


@pytest.mark.parametrize(
    "names", [["truss"], pytest.param(list(ERRORS), marks=pytest.mark.slow(reason="six seconds"))]
)
def test_usage_errors_are_one_line_and_write_nothing(tmp_path, monkeypatch, names):
    for name in names:
        source, errors = ERRORS[name]
        folder = tmp_path / name
        folder.mkdir()
        monkeypatch.chdir(folder)
        Path("model.py").write_text(source, encoding="utf-8")
        Path("data.csv").write_text("t [s],mass.x [m]\n0.1,1.02\n0.2,1.03\n", encoding="utf-8")
        for line, sentence in errors:
            command, *arguments = shlex.split(line.replace("LONG", LONG))
            model = "model.py" if source else "example:pendulum"
            result = invoke(command, model, *arguments)
            assert (result.exit_code, result.stdout) == (2, ""), line
            (message,) = result.stderr.splitlines()
            assert message.startswith("error: "), line
            assert sentence in message, line
            assert {path.name for path in folder.iterdir()} <= {"model.py", "data.csv"}, line
