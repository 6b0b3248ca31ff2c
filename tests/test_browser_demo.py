"""Page that runs beamdae in the browser: its program without packages that Pyodide lacks."""

import importlib.util
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from test_missing_packages import BROWSER, HIDING

import beamdae as bd

DEMO = Path(__file__).parents[1] / ".docs" / "demo"
PROGRAM = """
import functools, sys, warnings
import numpy as np

# As in 32 bits, arrays that beamdae makes as int64 differ from those of sizes, and are no counts.
class Numpy(type(np)):
    @property
    def int64(self):
        caller = sys._getframe(1).f_globals.get("__name__", "")
        return np.longlong if caller.startswith("beamdae") else INT64


INT64 = np.__dict__.pop("int64")
np.__class__ = Numpy


def refuse_long(name, position):
    function = getattr(np, name)

    @functools.wraps(function)
    def checked(*args, **options):
        for values in args[position : position + 1]:
            if getattr(values, "dtype", np.dtype(np.intp)).char == "q":
                raise TypeError("Cannot cast array data from int64 to int32 in np." + name)
        return function(*args, **options)

    setattr(np, name, checked)


refuse_long("repeat", 1)
refuse_long("bincount", 0)
sys.path.insert(0, {folder!r})
warnings.simplefilter("ignore")
import beamdae as bd
import demo

for name in demo.MODELS:
    for method in demo.METHODS:
        motion, line = demo.animate(name, method)
        assert "reached the end" in line, line
        assert len(motion) > 20000, (name, method)
        print(name, method, line)
pendulum = bd.load_model("example:pendulum")
try:
    bd.simulate(pendulum(elements=2), bd.Ida(), t_end=0.01)
except bd.BeamdaeError as error:
    print(error)
"""


def load_builder():
    spec = importlib.util.spec_from_file_location("demo_build", DEMO / "build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def write_distribution(folder, packages):
    """Write a folder like a Pyodide distribution, with empty files."""
    folder.mkdir()
    lock = {
        name: {"name": name, "file_name": f"{name}-1.0-cp313-wasm32.whl", "depends": depends}
        for name, depends in packages.items()
    }
    (folder / "pyodide-lock.json").write_text(json.dumps({"packages": lock}))
    names = [entry["file_name"] for entry in lock.values()]
    for name in ["pyodide.mjs", "pyodide.asm.wasm", "python_stdlib.zip", "README.md", *names]:
        (folder / name).touch()
    return folder


@pytest.mark.slow
def test_models_of_the_page_run_without_packages_that_pyodide_lacks(tmp_path):
    paths = (HIDING, Path(bd.__file__).parents[1])
    env = {
        "PYTHONPATH": os.pathsep.join(map(str, paths)),
        "HIDDEN": ",".join(BROWSER),
        "CC": "false",
    }
    result = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(folder=str(DEMO))],
        env={**os.environ, **env, "XDG_CACHE_HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=300.0,
    )
    assert (result.returncode, result.stderr) == (0, "")
    *runs, message = result.stdout.splitlines()
    assert len(runs) == 2
    assert message.startswith("Ida: scikit-sundae cannot be imported")
    assert "install scikit-sundae, or" in message


@pytest.mark.slow
def test_page_contains_packages_with_their_dependencies(tmp_path):
    packages = {
        "casadi": ["numpy"],
        "cloudpickle": [],
        "msgspec": [],
        "orjson": [],
        "numpy": [],
        "scipy": ["openblas"],
        "openblas": [],
        "rich": [],
        "pandas": [],
        "matplotlib": [],
        "lazy_loader": [],
    }
    distribution = write_distribution(tmp_path / "pyodide", packages)
    wheels = tmp_path / "wheels"
    wheels.mkdir()
    (wheels / "threadpoolctl-3.6.0-py3-none-any.whl").touch()
    out = tmp_path / "site"
    names = load_builder().build_page(distribution, out, wheels)
    assert "openblas-1.0-cp313-wasm32.whl" in names
    assert "threadpoolctl-3.6.0-py3-none-any.whl" in names
    assert not [name for name in names if name.startswith("matplotlib")]
    assert json.dumps(names) in (out / "index.html").read_text()
    assert all((out / name).exists() for name in [*names, "pyodide.mjs", "demo.py"])
    with zipfile.ZipFile(out / "beamdae.zip") as archive:
        files = set(archive.namelist())
    assert {"beamdae/__init__.py", "beamdae/examples/four_bar.py"} <= files
    assert not [name for name in files if "__pycache__" in name]


def test_page_without_casadi_is_refused(tmp_path):
    distribution = write_distribution(tmp_path / "pyodide", {"numpy": [], "scipy": [], "rich": []})
    with pytest.raises(SystemExit, match=r"has no package .*; choose a distribution with it"):
        load_builder().build_page(distribution, tmp_path / "site")
