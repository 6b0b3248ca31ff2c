"""Assemble a static page that runs beamdae in the browser, from a local Pyodide distribution.

`python .docs/demo/build.py PYODIDE OUT [--wheels FOLDER]` needs no network: PYODIDE is an unpacked
distribution (`pyodide.mjs`, `pyodide-lock.json` and the wheels of its packages, among them
CasADi), OUT a new folder, which any web server of static files can serve. Pure Python packages
that the distribution lacks are taken from FOLDER.
"""

import argparse
import json
import re
import shutil
import sys
import tomllib
import zipfile
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
# Dependencies that neither runs nor their animations need.
OPTIONAL = ("llvmlite", "matplotlib", "scikit-sundae", "typer", "ziglang")
RUNTIME = re.compile(r"pyodide\.(asm\.\w+|m?js)|python_stdlib\.zip|pyodide-lock\.json")
LOCK = "pyodide-lock.json"


def build_page(distribution, out, wheels=None):
    """Write the page; return the names of the files of packages that it loads."""
    lock = json.loads((distribution / LOCK).read_text("utf-8"))["packages"]
    by_name = {_normalize(name): entry for name, entry in lock.items()}
    extra = {_normalize(path.name.split("-")[0]): path for path in _list_wheels(wheels)}
    files, queue = {}, _list_dependencies()
    while queue:
        name = _normalize(queue.pop())
        if name in files:
            continue
        if name in by_name:
            files[name] = distribution / by_name[name]["file_name"]
            queue += by_name[name].get("depends", [])
        elif name in extra:
            files[name] = extra[name]
        else:
            raise SystemExit(
                f"build.py: {distribution / LOCK} has no package {name}; "
                "choose a distribution with it, or pass a pure Python wheel by --wheels."
            )
    out.mkdir(parents=True, exist_ok=True)
    runtime = [path for path in sorted(distribution.iterdir()) if RUNTIME.fullmatch(path.name)]
    for path in [*runtime, *files.values(), HERE / "demo.py"]:
        shutil.copy(path, out / path.name)
    names = sorted(path.name for path in files.values())
    page = (HERE / "page.html").read_text("utf-8")
    (out / "index.html").write_text(page.replace("[/* WHEELS */]", json.dumps(names)), "utf-8")
    _write_package(out / "beamdae.zip")
    return names


def _list_dependencies():
    """Return the names of the packages that beamdae requires in a browser."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    names = [re.match(r"[\w.-]+", requirement)[0] for requirement in project["dependencies"]]
    return [name for name in names if name not in OPTIONAL]


def _list_wheels(folder):
    return sorted(folder.glob("*-none-any.whl")) if folder else []


def _normalize(name):
    """Return the name of a package in lower case, with hyphens (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def _write_package(path):
    """Write the Python files of beamdae and its example models into an archive."""
    folders = {ROOT / "beamdae": "beamdae", ROOT / "models": "beamdae/examples"}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for folder, target in folders.items():
            for file in sorted(folder.rglob("*")):
                if file.is_file() and "__pycache__" not in file.parts:
                    archive.write(file, f"{target}/{file.relative_to(folder).as_posix()}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("distribution", type=Path, help="folder of the Pyodide distribution")
    parser.add_argument("out", type=Path, help="folder of the page")
    parser.add_argument("--wheels", type=Path, help="folder with further pure Python wheels")
    options = parser.parse_args()
    wheels = build_page(options.distribution, options.out, options.wheels)
    sys.stdout.write(f"{options.out}: page with {len(wheels)} packages\n")
