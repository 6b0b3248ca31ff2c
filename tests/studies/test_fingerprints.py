"""What results are kept under: whatever changes them changes it, and nothing else does."""

from __future__ import annotations

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

import beamdae as bd
from beamdae.cli.model_files.model_file import ModelFile
from beamdae.studies import case as case_module
from beamdae.studies.execution import study_run
from beamdae.studies.execution.executors import LocalPool, SerialPool
from beamdae.studies.store.file_hashes import digest_package
from beamdae.studies.store.fingerprints import FingerprintError, digest, digest_transferable
from beamdae.studies.store.store import Store

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


def written(folder, head="", mass="MASS", data="", **files):
    folder.mkdir(exist_ok=True)
    for name, text in files.items():
        path = folder / name.replace("_", ".")
        path.write_text(text)
        # Python takes compiled modules of the same second and size for the same.
        os.utime(path, ns=(time.time_ns(), time.time_ns() + 10**9 * len(list(folder.iterdir()))))
    text = f"import beamdae as bd\n{head}\n{BODY.format(mass=mass, data=data)}"
    (folder / "falls.py").write_text(text)
    return ModelFile(folder / "falls.py").studies["falls"]


def key(study):
    return study.task(study.cases[0]).key


def kept(study, folder, executor=None):
    """How many runs were found on disk."""
    seen = []
    results = study_run.run_study(study, folder, executor or SerialPool(), seen.append)
    assert set(results.table["status"]) == {"ok"}, list(results.table["reason"])
    return seen[0].stored, seen[0].total


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
BEFORE_THE_RUN = {
    "imported name": ("from params import MASS", "MASS", NUMBER),
    "imported module": ("import params", "params.MASS", NUMBER),
    "name made up": ("import params", 'getattr(params, "MA" + "SS")', NUMBER),
    "set later": ("from params import MASS\nimport math", "OTHER", NUMBER),
    "computed": (f"{CURVE}TABLE = np.loadtxt(FILE)", "float(TABLE)", {"curve_csv": "{}\n"}),
    "helper's": ("import helper", "helper.mass()", HELPER),
    "dynamic": ("from helper import mass", "mass()", DYNAMIC),
    "a default": ("def mass(x={}):\n    return x", "mass()", {}),
    "in a class": ("class A:\n    @property\n    def m(self):\n        return {}", "A().m", {}),
    "of a private name": ("__MASS = {}", "__MASS", {}),
    "of a helper's private name": (
        "import params",
        "params.__MASS",
        {"params_py": "__MASS = {}\n"},
    ),
    "beside a lock": ("import guarded", 'guarded.CONFIG["mass"]', GUARDED),
    "beside a lock, in an object": ("import guarded", "guarded.OBJECT.mass", GUARDED),
    "in a lambda": ("mass = lambda: (lambda: {})()", "mass()", {}),
}


@pytest.mark.parametrize("name", BEFORE_THE_RUN)
def test_regression_a_study_follows_values_wherever_they_come_from(tmp_path, name):
    """It gave the results of what they were before."""
    head, mass, files = BEFORE_THE_RUN[name]

    def study(value):
        texts = {file: text.replace("{}", value) for file, text in files.items()}
        first = head.replace("{}", value) + ("\nOTHER = 2 * MASS" if mass == "OTHER" else "")
        return written(tmp_path / value.replace(".", ""), first, mass, **texts)

    assert key(study("1.5")) == key(study("1.5"))
    assert key(study("1.5")) != key(study("2.5"))


def test_regression_a_study_follows_modules_on_paths_of_a_helper(tmp_path):
    keys = []
    for value in ("1.0", "2.0"):
        (tmp_path / value / "more").mkdir(parents=True)
        (tmp_path / value / "more" / "faraway.py").write_text(f"MASS = {value}\n")
        keys.append(key(written(tmp_path / value, "import helper", "helper.mass()", **ELSEWHERE)))
    assert keys[0] != keys[1]


@pytest.mark.slow(reason="half a second and more")
@pytest.mark.parametrize(
    ("head", "mass"),
    [("import sizes.arm", "sizes.arm.MASS"), ("from sizes import arm", "arm.MASS")],
)
def test_regression_a_study_takes_folders_without_init_along(tmp_path, head, mass):
    """It could be run, and in a study the module was not there."""
    keys = []
    for value in ("1.5", "2.5"):
        (tmp_path / value / "sizes").mkdir(parents=True)
        (tmp_path / value / "sizes" / "arm.py").write_text(f"MASS = {value}\n")
        study = written(tmp_path / value, head, mass)
        keys.append(key(study))
        assert kept(study, tmp_path / value / "out") == (0, 4)
    assert keys[0] != keys[1]


def test_regression_a_global_changed_at_run_time_is_followed(tmp_path):
    study = written(tmp_path, "MASS = 1.0")
    before = key(study)
    scope = study.cases[0].model.build.__globals__
    scope["MASS"] = 2.0
    assert key(study) != before
    scope["MASS"] = 1.0
    assert key(study) == before


def test_comments_other_functions_and_folders_change_nothing(tmp_path):
    first = written(tmp_path / "a", "MASS = 1.0")
    other = written(tmp_path / "b", "# as before\nMASS = 1.0\ndef unused():\n    return 3")
    assert key(first) == key(other)


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
def test_regression_a_study_follows_data_read_inside_the_model(tmp_path, monkeypatch):
    """Whatever reads it: it said 4 of 4 kept. Files of one parameter are those of its cases."""
    monkeypatch.chdir(tmp_path)
    for file in READING:
        (tmp_path / file).write_text("1.5\n")
    study = written(tmp_path, HERE, " * ".join(READING.values()))
    (case,) = study.cases
    study = replace(study, cases=(case, replace(case, parameters={"scale": 2.0})))
    assert kept(study, tmp_path / "out") == (0, 8)
    store, tasks = Store(tmp_path / "out"), [study.task(case) for case in study.cases]
    for file in READING:
        (tmp_path / file).write_text("2.5\n")
        served = [store.load(task)[0] is not None for task in tasks]
        assert served == [file == "five.csv", False]
        (tmp_path / file).write_text("1.5\n")
        assert all(store.load(task)[0] for task in tasks)
    (tmp_path / "five.csv").unlink()
    assert [store.load(task)[0] is not None for task in tasks] == [True, False]
    # They move with the model, and equations of the same process are built anew.
    (tmp_path / "five.csv").write_text("4.5\n")
    results = study_run.run_study(study, tmp_path / "out", SerialPool())
    masses = [results.outcome(case).table["energy.kinetic [J]"].iloc[-1] for case in study.cases]
    assert masses[1] / masses[0] == pytest.approx(2.0 * 4.5)


def test_a_model_and_its_files_may_move_together(tmp_path):
    inside = 'float(np.loadtxt(Path(__file__).parent / "curve.csv"))'
    one, other = (
        written(tmp_path / name, CURVE, inside, curve_csv="1.5\n") for name in ("one", "other")
    )
    assert kept(one, tmp_path / "out") == (0, 4)
    store, task = Store(tmp_path / "out"), other.task(other.cases[0])
    assert store.load(task)[0] is not None
    (tmp_path / "other" / "curve.csv").write_text("2.5\n")
    assert store.load(task)[0] is None


def test_files_a_model_names_are_followed_and_must_exist(tmp_path):
    named = {"data": ', data=("curve.h5",)', "mass": "1.0"}
    first = written(tmp_path, curve_h5="one", **named)
    before = key(first)
    (tmp_path / "curve.h5").write_text("other")
    assert key(first) != before
    (tmp_path / "curve.h5").unlink()
    with pytest.raises(
        bd.BeamdaeError, match=r"falling: data names a file 'curve.h5' that does not exist"
    ):
        written(tmp_path, **named)
    for wrong in ("curve.h5", [1], 5, None):
        with pytest.raises(bd.BeamdaeError, match="data must be a list of file names"):
            bd.model(t_end=1.0, data=wrong)(swing.build)


def test_regression_a_study_follows_the_sources_of_beamdae(monkeypatch):
    """At the same version: a changed law of damping gave the results of the old one."""
    case = bd.Case(swing)
    before = case.mechanism_fingerprint()
    case_module._digest_environment.cache_clear()
    monkeypatch.setattr(case_module, "digest_package", lambda: "changed")
    assert case.mechanism_fingerprint() != before
    monkeypatch.undo()
    case_module._digest_environment.cache_clear()
    assert len(digest_package()) == 64


# Values ---------------------------------------------------------------------------------------


@bd.model(t_end=0.1)
def swing(mass=1.0, extra=None):
    mech = bd.Mechanism()
    bob = mech.add(bd.RigidBody("bob", mass, inertia=0.1))
    mech.observe("bob", bob.at(0.0, 0.0))
    return mech


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


def values():
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


def test_values_of_all_kinds_are_told_apart_and_known_again():
    first, again = ({k: digest(x) for k, x in values().items()} for _ in range(2))
    assert first == again
    assert len(set(first.values())) == len(first)
    assert digest([1, 2]) != digest((1, 2)) != digest([2, 1])
    assert digest(1) != digest(1.0) != digest(True)
    assert digest({"a": 1, "b": 2}) != digest({"b": 1, "a": 2})


def test_what_is_computed_when_it_is_asked_for_is_no_part_of_a_value():
    asked = Shape()
    before = digest(asked)
    assert asked.twice == 8
    assert digest(asked) == before


class Addressed:
    def __reduce__(self):
        return (Addressed, (), {"place": id(self)})


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (threading.Lock(), "extra must be .*<unlocked _thread.lock object"),
        ((x for x in "ab"), "extra must be .*generator"),
        (Addressed(), "extra must be .*Addressed"),
        ({"deep": [threading.Lock()]}, r"extra must be .*\(item deep is a lock\)"),
    ],
    ids=["lock", "generator", "address", "inside"],
)
def test_regression_parameters_no_process_can_tell_again_are_refused(value, words):
    """They were kept under a new hash each time."""
    with pytest.raises(bd.BeamdaeError, match=f"swing: {words}"):
        bd.Study("made", (bd.Case(swing, {"extra": value}),))


def test_globals_no_process_can_tell_again_are_refused(tmp_path):
    with pytest.raises(bd.BeamdaeError, match=r"falling: its global LOCK must be .*lock"):
        written(tmp_path, "import threading\nLOCK = threading.Lock()", "bool(LOCK)")
    with pytest.raises(FingerprintError):
        digest_transferable(Addressed())


def test_regression_groups_of_long_arrays_are_told_apart():
    """Their texts leave out what differs: they were measured against one reference."""
    zeros, changed = np.zeros(2000), np.zeros(2000)
    changed[700] = 1.0
    names = {bd.Case(swing, {"extra": x}).group for x in (zeros, changed, zeros.copy())}
    assert len(names) == 2
    for value in (*values().values(), threading.Lock(), object()):
        group = bd.Case(swing, {"extra": value}).group
        assert group.isprintable()
        assert len(group) < 100
        assert " at 0x" not in group


def test_fingerprints_of_a_thousand_cases_take_little():
    curve = np.linspace(0.0, 1.0, 10_000)

    @bd.model(t_end=1.0)
    def curved(mass=1.0, shape=(1.0, 2.0)):
        return curve, values

    cases = tuple(bd.Case(curved, {"mass": float(m)}) for m in range(1000))
    study = bd.Study("many", cases)
    begin = time.process_time()
    digests = {}
    assert len({study.task(case, digests=digests).key for case in cases}) == 1000
    assert time.process_time() - begin < 2.0


@pytest.mark.slow(reason="starts processes")
def test_fingerprints_are_the_same_in_every_process():
    code = (
        "import sys; sys.path[:0] = ['tests', 'tests/studies']\n"
        "import test_fingerprints as t, beamdae as bd\n"
        "from beamdae.studies.store.fingerprints import digest\n"
        "print([digest(x) for x in t.values().values()])\n"
        "print([bd.Case(t.swing, {'extra': x}).mechanism_fingerprint() for x in t.values().values()])\n"
    )
    told = {
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
    assert len(told) == 1


@pytest.mark.slow(reason="starts processes for whole studies")
def test_processes_follow_data_and_what_loaded_modules_have_read(tmp_path, monkeypatch):
    """A module that stays loaded in a process reads for all cases after it."""
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "reader.py").write_text(
        f"{CURVE}from functools import cache\n"
        "@cache\ndef mass():\n    return float(np.loadtxt(FILE))\n"
    )
    (tmp_path / "lib" / "curve.csv").write_text("1.5\n")
    monkeypatch.syspath_prepend(tmp_path / "lib")
    study = written(tmp_path / "models", "import reader", "reader.mass()")
    out = tmp_path / "out"
    assert kept(study, out, LocalPool(1)) == (0, 4)
    assert kept(study, out, LocalPool(1)) == (4, 4)
    (tmp_path / "lib" / "curve.csv").write_text("2.5\n")
    assert kept(study, out, LocalPool(1)) == (0, 4)
