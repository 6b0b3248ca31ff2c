"""Model files: whatever stands in them, they load or are refused in one sentence."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

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
    """Writes text or bytes to a file in the working folder, and gives its name."""
    monkeypatch.chdir(tmp_path)

    def written(content, name="model.py"):
        data = content if isinstance(content, bytes) else content.encode()
        (tmp_path / name).write_bytes(data)
        return name

    return written


def refusal(path, name=None):
    """What is said of a file that does not load, or of a model that cannot be built."""
    with pytest.raises(bd.BeamdaeError) as problem:
        bd.load_model(path, name)()
    text = str(problem.value)
    assert "\n" not in text
    assert text.endswith(".")
    assert not re.search(r"0x[0-9a-f]{4}|casadi|\.cpp|overloaded|prototype", text)
    return text


def test_regression_models_of_one_name_are_refused(file):
    """One of them was taken without a word."""
    factory = (
        "def made(n):\n" + "".join(f"    {x}\n" for x in MODEL.splitlines()) + "    return swing\n"
    )
    path = file(f"{HEAD}{factory}few, many = made(1), made(2)\n")
    assert "holds 2 models called 'swing', give each a name of its own" in refusal(path)
    assert refusal(path, "swing") == refusal(path)
    assert bd.load_model(file(f"{HEAD}{MODEL}again = swing\n")).name == "swing"


# Reading ----------------------------------------------------------------------------------------


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
def test_encodings_a_python_file_may_have(file, content):
    path = file(content)
    model = bd.load_model(path)
    assert model(mass=3.0).parts
    # What studies look for changes in.
    assert bd.Case(model).mechanism() != bd.Case(model, {"mass": 3.0}).mechanism()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (("# \xe4\n" + HEAD).encode("latin-1"), "model.py: it is no text in UTF-8, nor in the"),
        (("# coding: klingon\n" + HEAD).encode(), "model.py: it is no text in UTF-8, nor in the"),
        ((HEAD + MODEL).encode("utf-16"), "model.py: it is no text in UTF-8, nor in the encod"),
        (b"import beamdae\0\n", "model.py: it holds NUL bytes"),
        (bytes(range(256)), "model.py: it is no text in UTF-8"),
        (b"", "model.py: it holds no model, decorate a function"),
        (b"#" * 10_000_001, "model.py: it is larger than 10 MB"),
        (HEAD + "def broken(:\n", "model.py: it does not import, SyntaxError at line 2: "),
        ("(" * 1000, "model.py: it does not import, SyntaxError at line 1: too many nested"),
    ],
)
def test_regression_files_that_are_no_model_are_told(file, content, words):
    assert refusal(file(content)).startswith(words)


def test_what_is_no_file_is_told(file, tmp_path):
    (tmp_path / "folder.py").mkdir()
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.py")
        assert refusal("pipe.py").startswith("pipe.py: it is no file")
    assert refusal("folder.py").startswith("folder.py: it is no file")
    assert refusal("missing.py") == "missing.py: there is no such file."
    assert refusal("a" * 300 + ".py").endswith("it cannot be read, File name too long.")
    assert refusal("a\0.py") == r"path: no model file can be called 'a\x00.py'."
    assert refusal(3) == "load_model: path must be that of a model file, got 3."
    assert "no model ['swing'] (did you mean 'swing'?), the models are" in refusal(
        file(HEAD + MODEL), ["swing"]
    )


@pytest.mark.parametrize(
    "name",
    ["numpy.py", "casadi.py", "beamdae.py", "scipy.py", "model-1.py", "my model.py", "x.1.py"],
)
def test_a_file_may_have_the_name_of_a_module(file, name):
    uses = "import numpy as np, casadi as ca\nfrom scipy import sparse\nx = np.sin(ca.pi)\n"
    assert bd.load_model(file(HEAD + uses + MODEL, name))().parts


@pytest.mark.slow(reason="a command in a process of its own")
def test_a_model_called_numpy_runs_where_it_lies(file, tmp_path):
    """`python -m` puts the working folder before all others."""
    name = file("# coding: latin-1\n" + HEAD + MODEL, "numpy.py")
    package = str(Path(bd.__file__).parents[1])
    plain = {"PYTHONPATH": package, "LC_ALL": "C", "PYTHONUTF8": "0"}
    command = [sys.executable, "-m", "beamdae", "run", name, "--t-end", "0.1", "--no-estimate"]
    result = subprocess.run(
        command, cwd=tmp_path, env=os.environ | plain, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "results" / "swing.csv").is_file()


def test_a_file_that_deletes_itself_is_a_model(file):
    assert bd.load_model(file(HEAD + "import os\nos.remove(__file__)\n" + MODEL))().parts
    assert refusal("model.py") == "model.py: there is no such file."


# Running ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("raise SystemExit(3)", "SystemExit at line 2: it called sys.exit(3)."),
        ("exit('now')", "SystemExit at line 2: it called sys.exit('now')."),
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
def test_whatever_a_file_raises_is_told_with_its_line(file, line, words):
    """GeneratorExit and the like went through, and texts of CasADi were shown."""
    assert words in refusal(file(f"{HEAD}{line}\n"))


def test_ctrl_c_is_no_mistake(file):
    with pytest.raises(KeyboardInterrupt):
        bd.load_model(file("raise KeyboardInterrupt\n"))


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("bd.Beem", "no attribute 'Beem' (did you mean 'Beam'?)."),
        ("from beamdae import Beem", "cannot import name 'Beem' from 'beamdae'"),
        ("import beamdea", "No module named 'beamdea' (did you mean 'beamdae'?)."),
        ("lenght = 1\nlength", "name 'length' is not defined (did you mean 'lenght'?)."),
        ("bd.Mechanism().groud", "has no attribute 'groud' (did you mean 'ground'?)."),
        ("bd.Mechanism().ground.att(0, 0)", "has no attribute 'att' (did you mean 'at'?)."),
        ("bd.RigidBody('b', mas=1.0)", "unexpected keyword argument 'mas' (did you mean 'mass'?)."),
        ("bd.Beam('b', elments=1)", "Beam() got an unexpected keyword argument 'elments' (did you"),
        ("bd.run_up(sped=1)", "unexpected keyword argument 'sped' (did you mean 'speed'?)."),
        ("bd.model(t_edn=1)", "unexpected keyword argument 't_edn' (did you mean 't_end'?)."),
        ("bd.Mechanism().observe(nam='x')", "argument 'nam' (did you mean 'name'?)."),
        ("def f(width): pass\nf(widht=1)", "argument 'widht' (did you mean 'width'?)."),
        ("bd.Beam('b')", "TypeError at line 2: Beam() missing 2 required positional arguments"),
    ],
)
def test_mistyped_names_are_told_with_the_nearest(file, line, words):
    assert words in refusal(file(f"{HEAD}{line}\n"))


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("return None", "swing: the function must return the mechanism, got None."),
        ("return swing", "swing: the function must return the mechanism, got the model swing."),
        ("return other", "swing: the function must return the mechanism, got the model other."),
        ("return bd.Mechanism", "expected a model or a mechanism, got <class"),
        ("yield bd.Mechanism()", "expected a model or a mechanism, got <generator object swing>."),
        (
            "raise SystemExit",
            "swing: model.py cannot build it, SystemExit at line 5: it called sys.exit().",
        ),
        ("return bd.Mechanism().prat", "AttributeError at line 5: 'Mechanism' object has no attr"),
        (
            "return swing()",
            "swing: model.py cannot build it, RecursionError at line 5: maximum rec",
        ),
    ],
)
def test_what_a_model_function_returns_or_raises(file, body, words):
    other = "@bd.model(t_end=1.0)\ndef other(): return None\n"
    path = file(f"{HEAD}{other}@bd.model(t_end=1.0)\ndef swing(): {body}\n")
    with pytest.raises(bd.BeamdaeError) as problem:
        bd.simulate(bd.load_model(path, "swing"))
    assert words in str(problem.value)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("mech.add(mech.part('bob'))", "Mechanism: the name 'bob' is taken"),
        ("mech.add(bd.Weld('w', bd.Mechanism().ground.at(0, 0), bar.at(0, 0)))", "another mech"),
        ("mech.add(bd.Weld('w', 'here', bar.at(0, 0)))", "w: first attachment must be an attach"),
        (
            "mech.add(bd.Weld('w', bar.at(0, 0), bar.at(0, 0)))",
            "w: a joint must connect two bodies",
        ),
        (
            "mech.add(bd.Force('f', bd.RigidBody('bar', 1, 1).at(0, 0), (1, 0)))",
            "f: it refers to 'bar', which must be added to this mechanism first",
        ),
    ],
)
def test_parts_that_do_not_belong_are_told(file, line, words):
    bar = "mech.add(bd.RigidBody('bar', 1.0, 1.0))"
    text = MODEL.replace("    return", f"    bar = {bar}\n    {line}\n    return")
    assert words in refusal(file(HEAD + text))


@pytest.mark.parametrize(
    ("default", "value", "words"),
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
def test_values_of_another_type_are_told(file, default, value, words):
    model = bd.load_model(file(HEAD + MODEL.replace("mass=2.0", f"mass={default}")))
    with pytest.raises(bd.BeamdaeError, match=r"^swing: mass ") as problem:
        model(mass=value)
    assert words in str(problem.value)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("model = bd.model(t_end=1.0)(3)", "model: build must be a function, got 3."),
        ("@bd.model(t_end=1)\ndef f(*a): pass", "the parameter 'a' needs a default value"),
        ("@bd.model(t_end=1)\ndef f(a=1, /): pass", "the parameter 'a' needs a default value"),
        ("@bd.model(t_end=10**400)\ndef f(a=1): pass", "model: t_end must be finite"),
    ],
)
def test_what_cannot_be_a_model_is_told(file, line, words):
    assert words in refusal(file(f"{HEAD}{line}\n"))
