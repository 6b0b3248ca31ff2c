"""Fingerprints of cases: they change with everything a result depends on, and nothing else."""

import enum
import os
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from study_models import swing
from study_runs import LocalPool, ModelFile, SerialPool, run_study

import beamdae as bd
from beamdae.studies import case as case_module
from beamdae.studies.file_reads import digest_package
from beamdae.studies.fingerprints import digest
from beamdae.studies.store import Store

BODY = """
@bd.model(t_end=0.01{data})
def falling(scale=1.0):
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    ball = mech.add(bd.PointMass("ball", scale * {mass}, at=(0.0, 0.0)))
    mech.observe("ball", ball.point)
    return mech

@bd.study(references=(bd.Ida(rtol=1e-6), bd.GeneralizedAlpha(step=1e-3)))
def falls():
    return [bd.Case(falling, {{}}, bd.Ida(rtol=1e-4))]
"""


def write_study(folder, head="", mass="MASS", data="", **files):
    folder.mkdir(exist_ok=True)
    for name, text in files.items():
        path = folder / name.replace("_", ".")
        path.write_text(text)
        # Python does not recompile modules with the same size and time (in seconds).
        os.utime(path, ns=(time.time_ns(), time.time_ns() + 10**9 * len(list(folder.iterdir()))))
    text = f"import beamdae as bd\n{head}\n{BODY.format(mass=mass, data=data)}"
    (folder / "falls.py").write_text(text)
    return ModelFile(folder / "falls.py").studies["falls"]


def fingerprint(study):
    return study.task(study.cases[0]).key


def count_stored_runs(study, folder, executor=None):
    """Run a study; return the number of runs that were stored before, and of all runs."""
    progress = []
    results = run_study(study, folder, executor or SerialPool(), progress.append)
    assert set(results.table["status"]) == {"ok"}, list(results.table["reason"])
    return progress[0].stored, progress[0].total


CURVE = 'from pathlib import Path\nimport numpy as np\nFILE = Path(__file__).parent / "curve.csv"\n'


NUMBER = {"params_py": "MASS = {}\n"}
HELPER = NUMBER | {"helper_py": "import params\ndef mass():\n    return params.MASS\n"}
DYNAMIC = NUMBER | {
    "helper_py": 'import importlib\nP = importlib.import_module("par" + "ams")\n'
    "def mass():\n    return P.MASS\n"
}
GUARDED = {
    "guarded_py": "from threading import Lock\nfrom types import SimpleNamespace\n"
    'CONFIG = {"lock": Lock(), "mass": {}}\nOBJECT = SimpleNamespace(**CONFIG)\n'
}
ELSEWHERE = {
    "helper_py": "import sys\nfrom pathlib import Path\n"
    'sys.path.insert(0, str(Path(__file__).parent / "more"))\nimport faraway\n'
    "sys.path.pop(0)\nsys.modules.pop('faraway')\ndef mass():\n    return faraway.MASS\n"
}
VALUE_SOURCES = {
    "imported name": ("from params import MASS", "MASS", NUMBER),
    "imported module": ("import params", "params.MASS", NUMBER),
    "computed name": ("import params", 'getattr(params, "MA" + "SS")', NUMBER),
    "assigned later": ("from params import MASS\nimport math", "OTHER", NUMBER),
    "read from a file": (f"{CURVE}TABLE = np.loadtxt(FILE)", "float(TABLE)", {"curve_csv": "{}\n"}),
    "imported by a helper": ("import helper", "helper.mass()", HELPER),
    "imported by a computed name": ("from helper import mass", "mass()", DYNAMIC),
    "a default": ("def mass(x={}):\n    return x", "mass()", {}),
    "in a class": ("class A:\n    @property\n    def m(self):\n        return {}", "A().m", {}),
    "private name": ("__MASS = {}", "__MASS", {}),
    "private name of a helper": (
        "import params",
        "params.__MASS",
        {"params_py": "__MASS = {}\n"},
    ),
    "beside a lock": ("import guarded", 'guarded.CONFIG["mass"]', GUARDED),
    "beside a lock, in an object": ("import guarded", "guarded.OBJECT.mass", GUARDED),
    "in a lambda": ("mass = lambda: (lambda: {})()", "mass()", {}),
}


@pytest.mark.parametrize("name", VALUE_SOURCES)
def test_regression_fingerprints_depend_on_values_from_any_source(tmp_path, name):
    """Results of the previous values were returned."""
    head, mass, files = VALUE_SOURCES[name]

    def study(value):
        texts = {file: text.replace("{}", value) for file, text in files.items()}
        first = head.replace("{}", value) + ("\nOTHER = 2 * MASS" if mass == "OTHER" else "")
        return write_study(tmp_path / value.replace(".", ""), first, mass, **texts)

    assert fingerprint(study("1.5")) == fingerprint(study("1.5"))
    assert fingerprint(study("1.5")) != fingerprint(study("2.5"))


def test_regression_fingerprints_depend_on_modules_on_the_path_of_a_helper(tmp_path):
    keys = []
    for value in ("1.0", "2.0"):
        (tmp_path / value / "more").mkdir(parents=True)
        (tmp_path / value / "more" / "faraway.py").write_text(f"MASS = {value}\n")
        keys.append(
            fingerprint(
                write_study(tmp_path / value, "import helper", "helper.mass()", **ELSEWHERE)
            )
        )
    assert keys[0] != keys[1]


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize(
    ("head", "mass"),
    [("import sizes.arm", "sizes.arm.MASS"), ("from sizes import arm", "arm.MASS")],
)
def test_regression_studies_find_namespace_packages(tmp_path, head, mass):
    """A single run found the module, a study did not."""
    keys = []
    for value in ("1.5", "2.5"):
        (tmp_path / value / "sizes").mkdir(parents=True)
        (tmp_path / value / "sizes" / "arm.py").write_text(f"MASS = {value}\n")
        study = write_study(tmp_path / value, head, mass)
        keys.append(fingerprint(study))
        assert count_stored_runs(study, tmp_path / value / "out") == (0, 4)
    assert keys[0] != keys[1]


def test_regression_fingerprints_depend_on_globals_at_run_time(tmp_path):
    study = write_study(tmp_path, "MASS = 1.0")
    before = fingerprint(study)
    scope = study.cases[0].model.build.__globals__
    scope["MASS"] = 2.0
    assert fingerprint(study) != before
    scope["MASS"] = 1.0
    assert fingerprint(study) == before


def test_fingerprints_do_not_depend_on_comments_other_functions_and_folders(tmp_path):
    first = write_study(tmp_path / "a", "MASS = 1.0")
    other = write_study(tmp_path / "b", "# as before\nMASS = 1.0\ndef unused():\n    return 3")
    assert fingerprint(first) == fingerprint(other)


READING = {
    "one.csv": 'float(np.loadtxt(HERE / "one.csv"))',
    "two.csv": 'float(open(HERE / "two.csv").read())',
    "three.csv": 'float(pd.read_csv(HERE / "three.csv", header=None).iloc[0, 0])',
    "four.csv": 'float(np.loadtxt("four.csv"))',
    "five.csv": '(float(np.loadtxt(HERE / "five.csv")) if scale > 1.0 else 1.0)',
}
HERE = "from pathlib import Path\nimport numpy as np\nimport pandas as pd\n"
HERE += "HERE = Path(__file__).parent"


@pytest.mark.slow(reason="a study")
@pytest.mark.filterwarnings("ignore::ResourceWarning")
def test_regression_results_expire_when_a_file_read_by_the_model_changes(tmp_path, monkeypatch):
    """Any function may read it. A file read for one parameter value matters to its cases only."""
    monkeypatch.chdir(tmp_path)
    for file in READING:
        (tmp_path / file).write_text("1.5\n")
    study = write_study(tmp_path, HERE, " * ".join(READING.values()))
    (case,) = study.cases
    study = replace(study, cases=(case, replace(case, parameters={"scale": 2.0})))
    assert count_stored_runs(study, tmp_path / "out") == (0, 8)
    store, tasks = Store(tmp_path / "out"), [study.task(case) for case in study.cases]
    for file in READING:
        (tmp_path / file).write_text("2.5\n")
        is_stored = [store.load(task) is not None for task in tasks]
        assert is_stored == [file == "five.csv", False]
        (tmp_path / file).write_text("1.5\n")
        assert all(store.load(task) for task in tasks)
    (tmp_path / "five.csv").unlink()
    assert [store.load(task) is not None for task in tasks] == [True, False]
    # Equations cached in this process are built again.
    (tmp_path / "five.csv").write_text("4.5\n")
    results = run_study(study, tmp_path / "out", SerialPool())
    masses = [results.outcome(case).table["energy.kinetic [J]"].iloc[-1] for case in study.cases]
    assert masses[1] / masses[0] == pytest.approx(2.0 * 4.5)


@pytest.mark.slow(reason="half a second")
def test_a_model_and_its_files_may_move_together(tmp_path):
    mass = 'float(np.loadtxt(Path(__file__).parent / "curve.csv"))'
    one, other = (
        write_study(tmp_path / name, CURVE, mass, curve_csv="1.5\n") for name in ("one", "other")
    )
    assert count_stored_runs(one, tmp_path / "out") == (0, 4)
    store, task = Store(tmp_path / "out"), other.task(other.cases[0])
    assert store.load(task) is not None
    (tmp_path / "other" / "curve.csv").write_text("2.5\n")
    assert store.load(task) is None


def test_fingerprints_depend_on_declared_files_which_must_exist(tmp_path):
    named = {"data": ', data=("curve.h5",)', "mass": "1.0"}
    first = write_study(tmp_path, curve_h5="one", **named)
    before = fingerprint(first)
    (tmp_path / "curve.h5").write_text("other")
    assert fingerprint(first) != before
    (tmp_path / "curve.h5").unlink()
    with pytest.raises(
        bd.BeamdaeError, match=r"falling: data names the file 'curve.h5', which does not exist"
    ):
        write_study(tmp_path, **named)
    for wrong in ("curve.h5", [1], 5, None):
        with pytest.raises(bd.BeamdaeError, match="data must be a list of file names"):
            bd.model(t_end=1.0, data=wrong)(swing.build)


def test_regression_fingerprints_depend_on_the_sources_of_beamdae(monkeypatch):
    """After a change of a damping law, the results of the old one were returned."""
    case = bd.Case(swing)
    before = case.mechanism_fingerprint()
    case_module._digest_environment.cache_clear()
    monkeypatch.setattr(case_module, "digest_package", lambda: "changed")
    assert case.mechanism_fingerprint() != before
    monkeypatch.undo()
    case_module._digest_environment.cache_clear()
    assert len(digest_package()) == 64


# Values ---------------------------------------------------------------------------------------


class Color(enum.Enum):
    RED = 1
    BLUE = "b"


@dataclass(frozen=True)
class Shape:
    sides: int = 4
    more: dict = field(default_factory=dict)

    @cached_property
    def twice(self):
        return 2 * self.sides


def create_values():
    cycle = [1]
    cycle.append(cycle)
    return {
        "huge": 10**400,
        "huger": -(10**6000),
        "nan": {"a": float("nan")},
        "set": {"a", "b", ("c", frozenset({"d", "e"}))},
        "mixed keys": {1: "a", "b": (2.0, None), None: [True]},
        "array": np.arange(6.0).reshape(2, 3).T,
        "objects": np.array([1, "a", None], object),
        "frame": pd.DataFrame({"a": [1, 2], "b": ["x", "y"]}),
        "enum": Color.RED,
        "shape": Shape(5, {"a": {1, 2}}),
        "class": Shape,
        "function": lambda t: np.sin(t) + len(Color),
        "cycle": cycle,
        "material": bd.Material(E=1e9, nu=0.3, rho=1e3),
        "surrogate": "\ud800",
    }


def test_digests_of_equal_values_are_equal_and_of_others_different():
    first, again = ({k: digest(x) for k, x in create_values().items()} for _ in range(2))
    assert first == again
    assert len(set(first.values())) == len(first)
    assert digest([1, 2]) != digest((1, 2)) != digest([2, 1])
    assert digest(1) != digest(1.0) != digest(True)
    assert digest({"a": 1, "b": 2}) != digest({"b": 1, "a": 2})


def test_cached_properties_do_not_change_digests():
    shape = Shape()
    before = digest(shape)
    assert shape.twice == 8
    assert digest(shape) == before


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (threading.Lock(), "note must be .*<unlocked _thread.lock object"),
        ((x for x in "ab"), "note must be .*generator"),
        ({"deep": [threading.Lock()]}, r"note must be .*\(item deep has the type lock\)"),
    ],
    ids=["lock", "generator", "inside"],
)
def test_regression_parameters_that_cannot_be_reproduced_are_refused(value, words):
    """They were stored under a new hash each time."""
    with pytest.raises(bd.BeamdaeError, match=f"swing: {words}"):
        bd.results.Study("made", (bd.Case(swing, {"note": value}),))


@dataclass(frozen=True)
class Guarded(bd.GeneralizedAlpha):
    guard: object = None


@pytest.mark.parametrize(
    ("guard", "words"),
    [
        (threading.Lock(), "got <unlocked _thread.lock object.* has the type lock"),
        ({"deep": [threading.Lock()]}, r"\(item deep has the type lock\)"),
    ],
    ids=["lock", "inside"],
)
def test_regression_settings_that_cannot_be_reproduced_are_refused(guard, words):
    """`dataclasses.asdict` raised a TypeError."""
    case = bd.Case(swing, {}, Guarded(step=1e-3, guard=guard))
    with pytest.raises(bd.BeamdaeError, match=f"Guarded: guard must be .*{words}"):
        case.fingerprint(1.0, 0.1)


def test_globals_that_cannot_be_reproduced_are_refused(tmp_path):
    with pytest.raises(bd.BeamdaeError, match=r"falling: its global LOCK must be .*lock"):
        write_study(tmp_path, "import threading\nLOCK = threading.Lock()", "bool(LOCK)")


def test_regression_long_arrays_have_different_groups():
    """Their texts are abbreviated: different arrays shared a reference."""
    zeros, changed = np.zeros(2000), np.zeros(2000)
    changed[700] = 1.0
    names = {bd.Case(swing, {"note": x}).group for x in (zeros, changed, zeros.copy())}
    assert len(names) == 2
    for value in (*create_values().values(), threading.Lock(), object()):
        group = bd.Case(swing, {"note": value}).group
        assert group.isprintable()
        assert len(group) < 100
        assert " at 0x" not in group


@pytest.mark.slow(reason="starts processes")
def test_fingerprints_are_the_same_in_every_process():
    code = (
        "import sys; sys.path[:0] = ['tests', 'tests/studies']\n"
        "import test_fingerprints as t, beamdae as bd\n"
        "from beamdae.studies.fingerprints import digest\n"
        "print([digest(x) for x in t.create_values().values()])\n"
        "for x in t.create_values().values():\n"
        "    print(bd.Case(t.swing, {'note': x}).mechanism_fingerprint())\n"
    )
    outputs = {
        subprocess.run(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONHASHSEED": seed},
            cwd=Path(__file__).parents[2],
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(outputs) == 1


@pytest.mark.slow(reason="starts processes for whole studies")
def test_results_expire_when_a_file_read_by_an_imported_module_changes(tmp_path, monkeypatch):
    """The module stays in its process and reads once for all cases."""
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "reader.py").write_text(
        f"{CURVE}from functools import cache\n"
        "@cache\ndef mass():\n    return float(np.loadtxt(FILE))\n"
    )
    (tmp_path / "lib" / "curve.csv").write_text("1.5\n")
    monkeypatch.syspath_prepend(tmp_path / "lib")
    study = write_study(tmp_path / "models", "import reader", "reader.mass()")
    out = tmp_path / "out"
    assert count_stored_runs(study, out, LocalPool(1)) == (0, 4)
    assert count_stored_runs(study, out, LocalPool(1)) == (4, 4)
    (tmp_path / "lib" / "curve.csv").write_text("2.5\n")
    assert count_stored_runs(study, out, LocalPool(1)) == (0, 4)
