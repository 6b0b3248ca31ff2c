"""Documentation pages run as printed: Python blocks and `beamdae` commands."""

import gc
import re
import shlex
import sys
import types
import warnings
from pathlib import Path

import numpy as np
import pytest
from command_line import invoke
from numpy.testing import assert_allclose

import beamdae as bd

ROOT = Path(__file__).parents[1]
TUTORIALS = ROOT / "models" / "tutorials"
TUTORIAL = TUTORIALS / "four_bar.md"
GAUGES = TUTORIALS / "gauges.md"
GRIPPER = TUTORIALS / "gripper.md"
PAGES = [
    page for part in ("howto", "theory") for page in sorted((ROOT / ".docs" / part).glob("*.md"))
]
BLOCK = re.compile(r"^```(\{code-cell\} python|python|sh)\n(.*?)^```", re.DOTALL | re.MULTILINE)

slow = pytest.mark.slow(reason="pages simulate, fit and make moving pictures")
# Dask leaves sockets open when a cluster shuts down on a busy machine.
allow_dask_warnings = pytest.mark.filterwarnings(
    "ignore::DeprecationWarning", "ignore::ResourceWarning"
)


def code_blocks(page):
    """Return (language, text) of each code block."""
    return [(kind.split()[-1], text) for kind, text in BLOCK.findall(page.read_text())]


def page_param(page):
    """Return a page as a parameter of a test."""
    has_cluster = "LocalCluster" in page.read_text()
    return pytest.param(page, marks=[allow_dask_warnings] if has_cluster else [], id=page.stem)


def run_page(page):
    """Execute a page from top to bottom; return the names it defines."""
    names = {"__name__": "__main__"}
    for k, (language, text) in enumerate(code_blocks(page)):
        if language == "python":
            exec(compile(text, f"{page.name}, block {k + 1}", "exec"), names)
            continue
        for line in text.splitlines():
            program, *arguments = shlex.split(line, comments=True)
            # The live view waits for Ctrl-C; its own tests start and end it.
            if program == "beamdae" and arguments[0] != "view":
                run_command(line, arguments)
    return names


def run_command(line, arguments):
    """Run a command on an example; for other files, check that its options exist."""
    is_example = any(argument.startswith("example:") for argument in arguments)
    executed = arguments if is_example else [arguments[0], "--help"]
    result = invoke(*executed, env={"COLUMNS": "200"})
    assert result.exit_code == 0, f"{line}: {result.output}"
    options = [argument for argument in arguments if argument.startswith("--")]
    assert is_example or all(option in result.output for option in options), line


@slow
def test_tutorial_results_match_its_text(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run_page(TUTORIAL)
    assert_allclose(names["modes"].frequencies, [2.81, 17.3, 63.4], rtol=2e-3)
    assert bd.check(names["mech"], predict=False).rigid_mobility == 1
    assert names["run"].quality.energy_imbalance < 1e-5
    assert (tmp_path / "four_bar.gif").stat().st_size > 1e4
    assert np.ptp(names["run"]["pin.angle"]) == pytest.approx(0.36, abs=0.005)
    assert names["finer"].difference(names["run"], "pin.angle").abs().max().iloc[0] < 2e-5
    swings = names["results"].table["swing [rad]"]
    assert (names["results"].table["status"] == "ok").all()
    assert_allclose(swings.iloc[[0, 3, 6]], [0.341, 0.870, 1.461], rtol=2e-3)
    fit = names["fit"]
    (deviation,) = fit.standard_deviations
    assert abs(fit.parameters["stiffness"] - 173.0) < 3.0 * deviation
    assert deviation < 0.1
    assert fit.sigma["pin.angle [rad]"] == pytest.approx(2e-3, rel=0.2)


@slow
def test_fit_of_the_gauges_matches_its_text(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run_page(GAUGES)
    fit = names["fit"]
    assert fit.status.success
    assert np.abs(names["errors"]).max() < 4.0
    # Within five standard deviations of the chi-square distribution.
    assert abs(fit.chi_square - 274) < 5.0 * np.sqrt(2.0 * 274)
    assert np.abs(names["changes"]).max() < 3.0
    # E alone is known to 0.2 %, and without the second moment of area to tens of percents.
    assert fit.standard_deviations[0] / fit.values[0] < 0.005
    assert names["deviations"]["E"] > 0.1
    assert "E by" in names["alone"].undetermined[0]
    assert names["half_width"].max() < 0.01
    low, high = fit.table().loc["damping", ["lower 95 %", "upper 95 %"]]
    assert_allclose(names["profile"].interval, [low, high], rtol=0.01)


@slow
def test_design_of_the_gripper_matches_its_text(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run_page(GRIPPER)
    design = names["design"]
    assert design.status.success
    stress, mass = design.constraints
    assert abs(stress.margin) < 1e-5 * 20e6
    assert mass.multiplier == 0.0
    # The smooth bound is at the limit of 20 MPa, 2.1 % above the largest stress.
    assert names["largest"] == pytest.approx(19.595, rel=2e-3)
    # The last two are at their lower bound, up to the accuracy with which the constraints are met.
    thickness = np.array(design.parameters["thickness"])
    assert (np.diff(thickness) < 1e-5 * thickness.min()).all()
    assert names["closing"] > 5.0 * 3.06e-3


@slow
def test_compliant_stage_matches_its_text(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run_page(TUTORIALS / "stage.md")
    # 24 EI / L^3, 3 E h d / L^2 and 3 d^2 / (5 L); the stress without shear and geometric effects.
    assert names["stiffness"] == pytest.approx(3543.75, rel=5e-4)
    assert names["stress"] == pytest.approx(35.44e6, rel=0.01)
    assert names["sink"] == pytest.approx(1.35e-6, rel=1e-3)
    assert names["modes"].frequencies[0] == pytest.approx(13.379, rel=1e-3)
    assert_allclose(names["slow"], np.sort_complex(names["poles"]), rtol=0.01)
    assert names["difference"] < 0.5e-6
    assert [names["largest_pole"](every) < 1.0 for every in names["sampled"]] == [True, True, False]
    settling = [names["response"](run).settling_time for run in names["sampled"].values()]
    assert min(settling[:2]) > 0.030
    assert np.isnan(settling[2])
    assert all(value < limit for value, limit in names["requirements"].values())
    assert names["response"](names["smooth"]).settling_time == pytest.approx(0.0135, abs=5e-4)


@slow
def test_drop_test_matches_its_text(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error", bd.BeamdaeWarning)
        warnings.filterwarnings("ignore", "fit: Residuals are alike", bd.BeamdaeWarning)
        names = run_page(TUTORIALS / "drop_test.md")
    assert any("Residuals are alike over" in x for x in names["fit"].warnings)
    assert -names["elastic"]["bottom.y"].min() == pytest.approx(names["deepest"], rel=0.015)
    assert names["loss"] == pytest.approx(0.42 * 1.03, rel=0.01)
    table = names["table"]
    assert_allclose(table["peak [g]"], table["rigid [g]"], rtol=0.015)
    assert table["compression [mm]"].max() < 28.0
    assert names["permissible"] == pytest.approx(0.51, abs=0.01)
    deflection = names["free"]["board.transverse"].min()
    assert names["estimate"].min() == pytest.approx(0.95 * deflection, rel=0.02)
    assert names["safe"] == 6e-3
    impulses, forces = np.transpose(names["contacts"])
    assert np.ptp(impulses) < 0.01 * impulses[0]
    assert forces[-1] == pytest.approx(3.0 * forces[0], rel=0.1)


@slow
def test_rotating_blade_matches_its_text(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run_page(TUTORIALS / "blade.md")
    assert_allclose(names["modes"].frequencies, names["slender"], rtol=6e-3)
    assert_allclose(names["frequencies"], names["ritz_frequencies"], rtol=6e-3)
    resonance = names["diagram"].resonances().iloc[0]
    assert (resonance["mode"], resonance["multiple"]) == (1, 4)
    # 26.2563 from speeds 0.1 rad/s apart.
    assert resonance["speed [rad/s]"] == pytest.approx(26.2563, abs=0.001)
    assert_allclose(names["tip_amplitudes"], names["expected"], rtol=0.02)
    assert names["peaks"][0] == pytest.approx(names["peaks"][1], rel=0.01)
    assert names["cycles_of_the_standard"] == {3.0: 0.5, 4.0: 1.5, 6.0: 0.5, 8.0: 1.0, 9.0: 0.5}
    assert names["damage"] == pytest.approx(1.0 / 2e5, rel=0.1)


@slow
def test_snapping_arch_matches_its_text(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run_page(TUTORIALS / "snapping_arch.md")
    assert names["thickness"] == pytest.approx(1.027e-3, abs=1e-6)
    largest, drops = names["largest"], names["drops"]
    assert largest(drops, names["loads"]) == pytest.approx(30.0, rel=2e-4)
    limit = names["limit_load"](names["thickness"], names["measured"])
    assert limit == pytest.approx(names["expected"], rel=1e-3)
    assert names["mode_1"] == pytest.approx([28.95, 28.95], abs=0.02)
    assert sorted(names["mode_2"]) == pytest.approx([27.78, 32.39], abs=0.02)
    assert names["bound"] < names["high"] < 1.02 * names["bound"]
    crown = names["snap"]["crown.y"].iloc[-1]
    assert crown == pytest.approx(4e-3 - names["other_side"], rel=1e-3)


def check_flexures(names):
    # 24 EI / L^3 and 3 E h d / L^2 of straight leaves at small travel; the travel stiffens both.
    inertia, height, length, travel = 0.01 * 0.4e-3**3 / 12.0, 0.4e-3, 0.05, 3e-3
    assert names["stiffness"][0] == pytest.approx(24.0 * 200e9 * inertia / length**3, rel=1e-3)
    stress = names["path"]["stress.largest"].iloc[-1]
    assert stress == pytest.approx(3.0 * 200e9 * height * travel / length**2, rel=0.03)
    # Both limits of the shortest guide are reached.
    assert all(abs(x.relative_margin) < 1e-5 for x in names["design"].constraints)


def check_vibration_tests(names):
    for simulated, exact in names["spectrum"].values():
        assert simulated == pytest.approx(exact, abs=2e-3)


PAGE_CHECKS = {"flexures": check_flexures, "vibration_tests": check_vibration_tests}


@slow
@pytest.mark.parametrize("page", [page_param(page) for page in PAGES if code_blocks(page)])
def test_page_runs_as_printed(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    PAGE_CHECKS.get(page.stem, dict)(run_page(page))
    # Report resources that the page leaves open in this test, not in a later one.
    gc.collect()


def run_framework_example(framework, last=None):
    """Run the model of the page on gradients and the example for a framework; return the names."""
    text = (ROOT / ".docs" / "howto" / "use_gradients.md").read_text()
    names = {"__name__": "__main__"}
    exec(BLOCK.findall(text)[0][1], names)
    blocks = re.findall(r"^```\{code-block\} python\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    (example,) = [x for x in blocks if x.startswith(f"import {framework}")]
    exec(example.partition(last)[0] if last else example, names)
    return names


@slow
@pytest.mark.parametrize("framework", ["torch", "jax"])
def test_example_for_a_framework_runs_as_printed(framework):
    pytest.importorskip(framework)
    names = run_framework_example(framework)
    expected = names["value_and_gradient"]([30.0, 0.3])[1] + 2e-3 * np.array([30.0, 0.3])
    gradient = names["x"].grad.numpy() if framework == "torch" else names["gradient"]
    assert_allclose(gradient, expected)


class _TensorStub(np.ndarray):
    """The methods of a tensor that the example for PyTorch calls."""

    detach = cpu = numpy = lambda self: self
    new_tensor = staticmethod(np.array)


@pytest.mark.slow(reason="half a second and more")
def test_example_for_torch_with_a_stub(monkeypatch):
    """PyTorch is not a dependency; without it, only the calls of beamdae are tested."""
    stub, context = types.ModuleType("torch"), types.SimpleNamespace()
    stub.autograd = types.SimpleNamespace(Function=object)
    monkeypatch.setitem(sys.modules, "torch", stub)
    names = run_framework_example("torch", last="x = torch.tensor")

    def save(*tensors):
        context.saved_tensors = tensors

    context.save_for_backward = save
    value = names["Objective"].forward(context, np.array([30.0, 0.3]).view(_TensorStub))
    expected, gradient = names["value_and_gradient"]([30.0, 0.3])
    assert value == expected
    assert_allclose(names["Objective"].backward(context, 2.0), 2.0 * gradient)


def test_pages_with_cells_have_a_notebook_header():
    """Without the header, cells would be displayed but not executed."""
    for page in [*TUTORIALS.glob("*.md"), *PAGES]:
        text = page.read_text()
        assert ("{code-cell}" in text) == text.startswith("---\njupytext:"), page.name


def test_files_that_pages_name_exist():
    """Pages named files that had been joined with others."""
    folders = (".build", ".docs", "beamdae", "models", "tests", "validation")
    files = [x.as_posix() for name in folders for x in (ROOT / name).rglob("*.*")]
    for page in (*(ROOT / ".docs").rglob("*.md"), ROOT / "README.md"):
        names = re.findall(r"`([\w./-]+/[\w.-]+\.(?:py|c|h|js))`", page.read_text())
        missing = [x for x in names if not any(file.endswith(f"/{x}") for file in files)]
        assert not missing, page.name
