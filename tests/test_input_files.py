"""Inputs are never outputs: no command and no method replaces a file that it has read."""

import os
from pathlib import Path

import pytest
from command_line import invoke

import beamdae as bd

# Each reading way is a statement of the model function or module; {} is the name of the file.
MODULE_READS = {
    "module": "TEXT = Path({!r}).read_text()",
    "none": "",
}
FUNCTION_READS = {
    "open": "Path({!r}).read_text()",
    "table": "bd.table_from_csv({!r})",
    "numpy": "np.loadtxt({!r}, delimiter=',', skiprows=1)",
}
MODEL = '''
"""A mass on springs."""
from pathlib import Path
import numpy as np
import beamdae as bd
%(module)s

@bd.model(t_end=0.02, data=%(data)s)
def swing(mass=0.1, load=0.0, flexible=False):
    %(function)s
    mech = bd.Mechanism(gravity=(0.0, -9.81))
    tip = mech.add(bd.PointMass("tip mass", mass, at=(1.0, 0.0)))
    mech.add(bd.Spring("spring", mech.ground.at(0.0, 0.0), tip.point, stiffness=1e3))
    mech.add(bd.Spring("support", mech.ground.at(1.0, -1.0), tip.point, stiffness=1e3))
    mech.add(bd.Force("load", tip.point, (-1e-3, load)))
    mech.observe("tip", tip.point)
    if flexible:
        strip = bd.Section.rectangle(bd.Material(E=7e10, nu=0.3, rho=2700.0), 0.02, 0.005)
        beam = mech.add(bd.Beam("beam", bd.Line((0, 0), (1, 0)), strip, elements=1))
        mech.add(bd.Weld("root", mech.ground.at(0.0, 0.0), beam.start))
        mech.add(bd.Force("press", beam.end, (-1.0, 0.0)))
    return mech
'''
DATA = "t [s],tip.y [m]\n0,0\n0.01,-0.0001\n0.02,-0.0003\n"
COMMANDS = {
    "run": ["--checkpoint", "swing_end.json", "--no-estimate"],
    "static": [],
    "modes": ["--number", "1"],
    "bode": ["--input", "load.Fy", "--output", "tip.y"],
    "periodic": ["--period", "0.5"],
    "response": ["--over", "mass=0.1:0.11", "--period", "0.5", "--max-points", "2"],
    "buckling": ["--set", "flexible=true", "--picture"],
    "fit": ["measured.csv", "--by", "mass"],
    "optimize": ["--by", "mass", "--minimize", "maximum:tip.y", "--max-evaluations", "2"],
    "draw": [],
    "export": ["--fmu", "swing.fmu", "--platforms", ""],
    "sweep": ["--over", "mass=0.1,0.2", "--jobs", "1"],
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_model()
    Path("measured.csv").write_text(DATA)
    return tmp_path


def write_model(name="", module="none", function=None, data=()):
    Path("swing.py").write_text(
        MODEL
        % {
            "module": MODULE_READS[module].format(name),
            "function": FUNCTION_READS[function].format(name) if function else "pass",
            "data": tuple(data),
        }
    )


def run(*arguments):
    return invoke(*arguments)


def fill(name):
    """Write data to a file that the model reads."""
    Path(name).parent.mkdir(parents=True, exist_ok=True)
    Path(name).write_text(DATA)


def written_files():
    names = (x for x in Path().rglob("*") if x.is_file() and "outcomes" not in x.parts)
    return {str(x) for x in names}


@pytest.mark.slow(reason="up to eight runs")
@pytest.mark.parametrize("command", COMMANDS)
def test_no_command_replaces_a_file_that_the_model_reads(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = [command, "swing.py", *COMMANDS[command]]
    arguments += [] if command == "export" else ["--out", "."]
    write_model()
    fill("measured.csv")
    before = written_files()
    run(*arguments)
    outputs = sorted(written_files() - before)
    assert outputs
    for number, name in enumerate(outputs):
        folder = tmp_path / str(number)
        folder.mkdir()
        monkeypatch.chdir(folder)
        fill("measured.csv")
        fill(name)
        write_model(name, function="open")
        result = run(*arguments)
        assert Path(name).read_text() == DATA, name
        assert result.exit_code, name
        assert "is an input" in result.stderr, name


@pytest.mark.slow(reason="several runs")
@pytest.mark.parametrize("reads", ["open", "table", "numpy", "module", "data", "code"])
@pytest.mark.parametrize("link", ["", "symbolic", "hard"])
def test_all_ways_to_read_a_file_protect_it(reads, link, folder):
    name = "input.csv" if link else "swing_end.json"
    fill(name)
    if reads == "code":
        name, checkpoint = "helper.py", "helper.py"
        Path(name).write_text("X = 1")
        text = Path("swing.py").read_text()
        Path("swing.py").write_text(text.replace("import beamdae", "import helper\nimport beamdae"))
    else:
        write_model(
            name,
            module=reads if reads == "module" else "none",
            function=reads if reads in FUNCTION_READS else None,
            data=[name] if reads == "data" else [],
        )
    checkpoint = name
    if link:
        # Another case of letters is another name of the same file on some systems.
        checkpoint = name.upper()
        (os.link if link == "hard" else os.symlink)(name, checkpoint)
    content = Path(name).read_text()
    result = run("run", "swing.py", "--checkpoint", checkpoint, "--no-estimate", "--no-page")
    assert Path(name).read_text() == Path(checkpoint).read_text() == content
    assert result.exit_code == 1 if "written" in result.stdout else 2
    assert "is an input" in result.stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ["fit", "swing.py", "swing_fit.csv", "--by", "mass", "--out", "."],
        ["fit", "swing.py", "swing_fit_residuals.csv", "--by", "mass", "--out", "."],
        ["fit", "link.csv", "--by", "mass", "--out", "."],
        ["run", "swing.py", "--data", "swing.csv", "--out", "."],
        ["run", "swing.py", "--data", "swing.csv", "--out", "folder"],
        ["run", "swing.py", "--data", "swing.csv", "--checkpoint", "folder/swing.csv"],
        ["run", "swing.py", "--checkpoint", "swing.py"],
        ["run", "swing.py", "--checkpoint", "folder/swing.py"],
        ["export", "swing.py", "--fmu", "swing.py"],
        ["export", "swing.py", "--fmu", "link.py"],
        ["modes", "swing.py", "--out", "results/swing_modes.csv"],
    ],
    ids=" ".join,
)
def test_named_inputs_are_refused_before_the_run(arguments, folder):
    for name in ("swing_fit.csv", "swing_fit_residuals.csv", "swing.csv"):
        fill(name)
    Path("folder").symlink_to(".")
    Path("link.py").symlink_to("swing.py")
    Path("link.csv").symlink_to("swing_fit.csv")
    if arguments[1] == "link.csv":
        arguments = ["fit", "swing.py", *arguments[1:]]
    if arguments[-1] == "results/swing_modes.csv":
        fill(arguments[-1])
    before = {name: Path(name).read_bytes() for name in written_files()}
    result = run(*arguments)
    assert result.exit_code == 2
    assert {name: Path(name).read_bytes() for name in written_files()} == before


@pytest.mark.slow(reason="two runs")
def test_a_checkpoint_is_replaced_by_the_next_one_only(folder):
    options = ["--no-estimate", "--no-page", "--no-picture"]
    assert run("run", "swing.py", "--t-end", "0.01", "--checkpoint", "end.json", *options)
    first = Path("end.json").read_bytes()
    end = ["--continue", "end.json", "--checkpoint", "end.json"]
    assert run("run", "swing.py", *end, *options).exit_code == 0
    assert Path("end.json").read_bytes() != first
    Path("swing.json").write_bytes(first)
    result = run("run", "swing.py", "--continue", "swing.json", "--out", ".", *options)
    assert result.exit_code == 2
    assert Path("swing.json").read_bytes() == first


@pytest.mark.slow(reason="a run with all its outputs")
def test_no_method_replaces_an_input(folder):
    model = bd.load_model("swing.py")
    solution = bd.simulate(model)
    fit = bd.fit(model, "measured.csv", by="mass")
    optimum = bd.optimize(model, bd.quantities.Mass(), by="mass", bounds={"mass": (0.1, 0.2)})
    sweep = bd.sweep(model, over={"mass": [0.1, 0.2]}, jobs=1)
    writers = {
        "to_csv": (solution.to_csv, "a.csv"),
        "json": (solution.to_csv, "swing.csv"),
        "save": (solution.save, "a.run"),
        "plot": (solution.plot("tip").save, "a.png"),
        "svg": (solution.plot("tip").save, "a.svg"),
        "page": (solution.page, "a.html"),
        "gif": (solution.animate, "a.gif"),
        "fit table": (fit.to_csv, "a.csv"),
        "fit page": (fit.page, "a.html"),
        "fit plot": (fit.plot().save, "a.png"),
        "design": (optimum.to_csv, "a.csv"),
        "design page": (optimum.page, "a.html"),
        "sweep": (sweep.to_csv, "a.csv"),
        "sweep page": (sweep.page, "a.html"),
        "fmu": (lambda name: bd.export_fmu(model, name, platforms=()), "a.fmu"),
        "drawing": (model().draw().save, "a.png"),
        "model source": (solution.to_csv, "swing.py"),
    }
    for place, (write, name) in writers.items():
        home = folder / place.replace(" ", "_")
        home.mkdir()
        file = home / name
        read = file.with_suffix(".json") if place == "json" else file
        if place == "model source":
            read = file = Path("swing.py")
        else:
            read.write_text(DATA)
            bd.table_from_csv(read)
        content = read.read_bytes()
        with pytest.raises(bd.BeamdaeError, match="is an input"):
            write(file)
        assert read.read_bytes() == content, place
    # A file that this process has written may be written again after it was read.
    saved = solution.save("mine.run")
    bd.load(saved)
    solution.save(saved)
    # A saved run of another process is replaced by saved runs only, which may continue it.
    saved.rename("other.run")
    bd.load("other.run")
    with pytest.raises(bd.BeamdaeError, match="is an input"):
        solution.to_csv("other.run")
    solution.save("other.run")
