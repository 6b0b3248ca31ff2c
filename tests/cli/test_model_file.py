"""Model files: loading, messages, and warnings of their models."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import invoke, succeed

import beamdae as bd

HEAD = "import beamdae as bd\n"
MODEL = (
    "@bd.model(t_end=1.0)\n"
    "def swing(mass=2.0):\n"
    "    mech = bd.Mechanism(gravity=(0.0, -9.81))\n"
    "    mech.add(bd.PointMass('bob', mass, at=(1.0, 0.0)))\n"
    "    return mech\n"
)


@pytest.fixture
def file(tmp_path, monkeypatch):
    """Return a function that writes text or bytes to a file in the working folder."""
    monkeypatch.chdir(tmp_path)

    def write(content, name="model.py"):
        data = content if isinstance(content, bytes) else content.encode()
        (tmp_path / name).write_bytes(data)
        return name

    return write


def refusal(path, name=None):
    """Return the message of a file that does not load, or of a model that cannot be built."""
    with pytest.raises(bd.BeamdaeError) as problem:
        bd.load_model(path, name)()
    text = str(problem.value)
    assert "\n" not in text
    assert text.endswith(".")
    assert not re.search(r"0x[0-9a-f]{4}|casadi|\.cpp|overloaded|prototype", text)
    return text


def test_regression_two_models_of_one_name_are_refused(file):
    factory = (
        "def build(n):\n" + "".join(f"    {x}\n" for x in MODEL.splitlines()) + "    return swing\n"
    )
    path = file(f"{HEAD}{factory}few, many = build(1), build(2)\n")
    assert "2 models are called 'swing'; give the functions different names." in refusal(path)
    assert refusal(path, "swing") == refusal(path)
    assert bd.load_model(file(f"{HEAD}{MODEL}again = swing\n")).name == "swing"


# Reading the file ---------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "content",
    [
        HEAD + MODEL,
        b"\xef\xbb\xbf" + (HEAD + MODEL).encode(),
        ("# coding: latin-1\n" + HEAD + MODEL.replace("bob", "k\xe4se")).encode("latin-1"),
        ("# \xe4\n" + HEAD + MODEL).encode(),
        (HEAD + MODEL).replace("\n", "\r\n").encode(),
    ],
    ids=["plain", "byte order mark", "latin-1", "UTF-8", "Windows lines"],
)
def test_encodings_of_python_files_are_read(file, content):
    path = file(content)
    model = bd.load_model(path)
    assert model(mass=3.0).parts
    # Studies detect changes by the fingerprint of the mechanism.
    heavier = bd.Case(model, {"mass": 3.0})
    assert bd.Case(model).mechanism_fingerprint() != heavier.mechanism_fingerprint()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            ("# \xe4\n" + HEAD).encode("latin-1"),
            "model.py: the import failed: SyntaxError at line 1: invalid or missing encoding",
        ),
        (
            ("# coding: klingon\n" + HEAD).encode(),
            "model.py: the import failed: SyntaxError at line 1: unknown encoding: klingon",
        ),
        (
            (HEAD + MODEL).encode("utf-16"),
            "model.py: the import failed: SyntaxError at line 1: ",
        ),
        (
            b"import beamdae\0\n",
            "model.py: the import failed: SyntaxError at line 1: ",
        ),
        (bytes(range(256)), "model.py: the import failed: UnicodeDecodeError: 'utf-8' codec"),
        (b"", "model.py: the file contains no model; decorate a function"),
        (HEAD + "def broken(:\n", "model.py: the import failed: SyntaxError at line 2: "),
        ("(" * 1000, "model.py: the import failed: SyntaxError at line 1: too many nested"),
    ],
)
def test_regression_files_without_a_model_are_refused(file, content, message):
    assert refusal(file(content)).startswith(message)


def test_unreadable_paths_are_refused(file, tmp_path):
    (tmp_path / "folder.py").mkdir()
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.py")
        assert refusal("pipe.py").startswith("pipe.py: the path is not a regular file")
    assert refusal("folder.py").startswith("folder.py: the path is not a regular file")
    assert refusal("missing.py") == "missing.py: there is no such file."
    assert refusal("a" * 300 + ".py").endswith("the file cannot be read: File name too long.")
    assert refusal("a\0.py") == (
        r"path: 'a\x00.py' is not a valid file name; use at most 4096 printable characters."
    )
    assert refusal("stage.py:sampled") == (
        "stage.py:sampled: a model file must be a Python file (.py); choose a model of the file "
        "stage.py by name (--model sampled)."
    )
    assert refusal(3) == "load_model: path must be a model file, got 3."
    assert "no model ['swing'] (did you mean 'swing'?); choose one of: swing." in refusal(
        file(HEAD + MODEL), ["swing"]
    )


@pytest.mark.parametrize(
    "name",
    ["numpy.py", "casadi.py", "beamdae.py", "scipy.py", "model-1.py", "my model.py", "x.1.py"],
)
def test_a_file_named_like_a_module_does_not_hide_it(file, name):
    uses = "import numpy as np, casadi as ca\nfrom scipy import sparse\nx = np.sin(ca.pi)\n"
    assert bd.load_model(file(HEAD + uses + MODEL, name))().parts


@pytest.mark.slow(reason="starts a process")
def test_a_model_called_numpy_runs_in_its_folder(file, tmp_path):
    """`python -m` puts the working folder first on the import path."""
    name = file("# coding: latin-1\n" + HEAD + MODEL, "numpy.py")
    package = str(Path(bd.__file__).parents[1])
    environment = {"PYTHONPATH": package, "LC_ALL": "C", "PYTHONUTF8": "0"}
    command = [sys.executable, "-m", "beamdae", "run", name, "--t-end", "0.1", "--no-estimate"]
    result = subprocess.run(
        command, cwd=tmp_path, env=os.environ | environment, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "results" / "swing.csv").is_file()


def test_a_file_that_deletes_itself_is_a_model(file):
    assert bd.load_model(file(HEAD + "import os\nos.remove(__file__)\n" + MODEL))().parts
    assert refusal("model.py") == "model.py: there is no such file."


# Executing the file -------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("raise SystemExit(3)", "SystemExit at line 2: sys.exit(3) was called."),
        ("exit('now')", "SystemExit at line 2: sys.exit('now') was called."),
        ("raise GeneratorExit", "GeneratorExit at line 2."),
        ("raise BaseException('no\\nway')", "BaseException at line 2: no way."),
        ("def f(): f()\nf()", "RecursionError at line 2: maximum recursion depth exceeded"),
        ("1 / 0", "ZeroDivisionError at line 2: division by zero."),
        ("class E(Exception):\n    def __str__(self): 1 / 0\nraise E", "E at line 4."),
        ("raise ValueError(object())", "ValueError at line 2: <object object>."),
        (
            "import casadi as ca\nca.SX.sym('x', 2) + ca.SX.sym('y', 3)",
            "RuntimeError at line 3: sh",
        ),
        ("import casadi as ca\nca.sin('x')", "at line 3: shapes or types of CasADi expressions do"),
    ],
)
def test_any_exception_of_a_file_is_reported_with_its_line(file, line, message):
    assert message in refusal(file(f"{HEAD}{line}\n"))


def test_ctrl_c_during_the_import_is_raised(file):
    with pytest.raises(KeyboardInterrupt):
        bd.load_model(file("raise KeyboardInterrupt\n"))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("bd.Beem", "no attribute 'Beem' (did you mean 'Beam'?)."),
        ("from beamdae import Beem", "cannot import name 'Beem' from 'beamdae'"),
        ("lenght = 1\nlength", "name 'length' is not defined (did you mean 'lenght'?)."),
        ("bd.Mechanism().groud", "has no attribute 'groud' (did you mean 'ground'?)."),
        ("bd.Mechanism().ground.att(0, 0)", "has no attribute 'att' (did you mean 'at'?)."),
        ("bd.RigidBody('b', mas=1.0)", "there is no argument 'mas' (did you mean 'mass'?); the"),
        ("bd.Beam('b', elments=1)", "Beam: there is no argument 'elments' (did you"),
        ("bd.run_up(sped=1)", "there is no argument 'sped' (did you mean 'speed'?)"),
        ("bd.model(t_edn=1)", "there is no argument 't_edn' (did you mean 't_end'?)"),
        ("bd.Beam('b')", "Beam: the arguments curve and section are missing; the arguments are"),
    ],
)
def test_mistyped_names_are_reported_with_a_suggestion(file, line, message):
    assert message in refusal(file(f"{HEAD}{line}\n"))


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("return None", "swing: the function must return a Mechanism, got None."),
        ("return swing", "swing: the function must return a Mechanism, got the model swing."),
        ("return other", "swing: the function must return a Mechanism, got the model other."),
        ("return bd.Mechanism", "expected a model or a mechanism, got <class"),
        ("yield bd.Mechanism()", "expected a model or a mechanism, got <generator object swing>."),
        (
            "raise SystemExit",
            "swing: the model function in model.py failed: SystemExit at line 5: sys",
        ),
        ("return bd.Mechanism().prat", "AttributeError at line 5: 'Mechanism' object has no attr"),
        (
            "return swing()",
            "swing: the model function in model.py failed: RecursionError at line 5: maximum",
        ),
    ],
)
def test_invalid_returns_and_exceptions_of_a_model_function(file, body, message):
    other = "@bd.model(t_end=1.0)\ndef other(): return None\n"
    path = file(f"{HEAD}{other}@bd.model(t_end=1.0)\ndef swing(): {body}\n")
    with pytest.raises(bd.BeamdaeError) as problem:
        bd.simulate(bd.load_model(path, "swing"))
    assert message in str(problem.value)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("mech.add(mech.part('bob'))", "Mechanism: the name 'bob' is in use"),
        ("mech.add(bd.Weld('w', bd.Mechanism().ground.at(0, 0), bar.at(0, 0)))", "another mech"),
        ("mech.add(bd.Weld('w', 'here', bar.at(0, 0)))", "w: first attachment must be an attach"),
        (
            "mech.add(bd.Weld('w', bar.at(0, 0), bar.at(0, 0)))",
            "w: a joint must connect two different bodies",
        ),
        (
            "mech.add(bd.Force('f', bd.RigidBody('bar', 1, 1).at(0, 0), (1, 0)))",
            "f: 'bar' is not part of this mechanism",
        ),
    ],
)
def test_parts_of_other_mechanisms_are_refused(file, line, message):
    bar = "mech.add(bd.RigidBody('bar', 1.0, 1.0))"
    text = MODEL.replace("    return", f"    bar = {bar}\n    {line}\n    return")
    assert message in refusal(file(HEAD + text))


@pytest.mark.parametrize(
    ("default", "value", "message"),
    [
        ("2.0", "1e999", "must be finite"),
        ("2.0", 10**400, "must be finite"),
        ("2.0", "heavy", "must be of type float, got 'heavy'"),
        ("2.0", True, "must be of type float, got True"),
        ("2", "1e3", "must be of type int, got '1e3'"),
        ("2", True, "must be of type int, got True"),
        ("2", "9" * 5000, "must be of type int, got '999"),
        ("(1, 2)", "(" * 5000, "must be of type tuple, got '((("),
        ("bd.Ida()", "x", "must be of type Ida, got 'x'"),
        ("True", "maybe", "must be true or false, got 'maybe'"),
    ],
)
def test_parameter_values_of_another_type_are_refused(file, default, value, message):
    model = bd.load_model(file(HEAD + MODEL.replace("mass=2.0", f"mass={default}")))
    with pytest.raises(bd.BeamdaeError, match=r"^swing: mass ") as problem:
        model(mass=value)
    assert message in str(problem.value)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("model = bd.model(t_end=1.0)(3)", "model: build must be a function, got 3."),
        ("@bd.model(t_end=1)\ndef f(*a): pass", "the parameter 'a' must have a default value"),
        ("@bd.model(t_end=1)\ndef f(a=1, /): pass", "the parameter 'a' must have a default value"),
        ("@bd.model(t_end=10**400)\ndef f(a=1): pass", "model: t_end must be finite"),
    ],
)
def test_functions_that_cannot_be_models_are_refused(file, line, message):
    assert message in refusal(file(f"{HEAD}{line}\n"))


@pytest.mark.parametrize("value", [[1, 2.0], (1.0, 2.0), np.array([1.0, 2.0]), "[1.0, 2.0]"])
def test_regression_sequences_of_numbers_become_those_of_the_default(file, value):
    for default, kind in (("(3.0, 4.0)", tuple), ("[3.0, 4]", list)):
        model = bd.load_model(file(HEAD + MODEL.replace("mass=2.0", f"mass={default}")))
        assert model.complete({"mass": value}) == {**model.parameters, "mass": kind((1.0, 2.0))}
        with pytest.raises(bd.BeamdaeError, match="an entry of mass must be finite"):
            model.complete({"mass": np.array([1.0, np.nan])})


WARNING = """
import beamdae as bd


@bd.model(t_end=0.02)
def spring(stiffness=100.0, frequency=1.0):
    steps = bd.table([0.0, 1.0, 1.1, 2.0, 3.0], [0.0, 0.0, 1.0, 1.0, 1.0], "spline", name="stop")
    mech = bd.Mechanism()
    strip = bd.Section.rectangle(bd.Material.of("steel"), width=0.02, height=0.002, damping=1e-3)
    beam = mech.add(bd.Beam("beam", bd.Line((0.0, 0.0), (0.4, 0.0)), strip, 2, strain="green"))
    mech.add(bd.Weld("clamp", mech.ground.at(0.0, 0.0), beam.start))
    mech.add(bd.Force("push", beam.end, (-float(steps(1.5)), bd.sine(0.1, frequency))))
    mech.add(bd.Spring("spring", mech.ground.at(0.4, 0.1), beam.end, stiffness, 1.0))
    mech.observe("tip", beam.end)
    return mech
"""

SENTENCE = "stop: the spline reaches "
COMMANDS = {
    "check": (),
    "run": (),
    "run --plot": ("--plot", "tip.y"),
    "run --accuracy": ("--accuracy", "5%"),
    "static": (),
    "static --plot": ("--plot", "tip.y"),
    "modes": (),
    "buckling": ("--load", "push"),
    "bode": ("--output", "tip.y", "--frequencies", "1:10"),
    "periodic": ("--period", "1", "--settle", "1"),
    "response": ("--over", "frequency=100:110", "--max-points", "2", "--settle", "1"),
    "optimize": ("--by", "stiffness", "--minimize", "mass"),
    "fit": ("data.csv", "--by", "stiffness", "--max-evaluations", "1"),
    "draw": (),
    "sweep": ("--over", "stiffness=100,200", "--jobs", "1"),
    "compare": ("--jobs", "1"),
}

FAST = ("run", "static", "modes", "buckling", "draw")
SLOW = pytest.mark.slow(reason="several runs or a picture")

WITHOUT_PICTURES = ("check", "draw", "optimize")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("spring.py").write_text(WARNING, encoding="utf-8")
    times = np.linspace(0.0, 0.02, 21)
    pd.DataFrame({"t [s]": times, "tip.y [m]": -1e-4 * times}).to_csv("data.csv", index=False)
    return tmp_path


def run(name, *more):
    command, *_ = name.split()
    pictures = () if command in WITHOUT_PICTURES else ("--no-picture",)
    pictures = () if "--plot" in name else pictures
    arguments = [command, "spring.py", *COMMANDS[name], *pictures, *more]
    return invoke(*arguments)


@pytest.mark.parametrize(
    "name",
    [x if x in FAST else pytest.param(x, marks=SLOW) for x in COMMANDS],
)
def test_regression_commands_print_the_warnings_of_model_functions(folder, name):
    """They were ignored with the warnings of the analysis, which are printed with its result."""
    result = run(name)
    assert result.exit_code in (0, 1), result.output
    # It is printed before the run, and again where a result is a table with all its warnings.
    counts = (1, 2) if name in ("check", "compare", "response") else (1,)
    assert result.output.count(SENTENCE) in counts, result.output
    document = json.loads(run(name, "--json").stdout)
    assert sum(SENTENCE in x for x in document["warnings"]) in counts
    for page in folder.glob("results/**/*.html"):
        assert SENTENCE in page.read_text(encoding="utf-8"), page


@pytest.mark.slow(reason="a second")
def test_regression_overshoots_of_tables_are_printed_before_the_run(folder):
    """A run of 17 s gave up before the table that caused it was named."""
    result = run("run")
    assert result.output.index(SENTENCE) < result.output.index("tip.y"), result.output


@pytest.mark.slow(reason="half a second")
def test_regression_run_compares_with_more_accurate_beams(folder):
    """The command, which estimates errors of time steps itself, also left out those of beams."""
    soft = WARNING.replace("bd.sine(0.1, frequency)", "15.0").replace("t_end=0.02", "t_end=0.3")
    Path("soft.py").write_text(soft, encoding="utf-8")
    succeed("run", "soft.py", "--no-page")
    errors = json.loads(Path("results/spring.json").read_text(encoding="utf-8"))["errors"]
    # Two elements that bend by 0.6 rad with moderate strains; steps cause 1e-3.
    assert 0.01 < errors["tip.x [m]"]["total"] < 0.06
