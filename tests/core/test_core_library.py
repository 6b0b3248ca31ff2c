"""The core is compiled once, and without it plain methods run."""

import json
import os
import re
import subprocess
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import scipy.sparse as sp

import beamdae as bd
from beamdae.core import library
from beamdae.core.library import FOLDER
from beamdae.core.tables import Loop
from beamdae.integrators.alpha import generalized_alpha
from beamdae.linear.elimination import LANES
from beamdae.native import llvm, object_code
from beamdae.native.lane_code import LANE_WIDTH
from beamdae.symbolic.sums.kernel_sums import Kernel, evaluate_plainly, evaluate_sum
from beamdae.symbolic.sums.sum_builder import LocalInput, SumBuilder

ROOT = Path(bd.__file__).parents[1]
PROGRAM = """
import json, sys, warnings
import beamdae as bd

mech = bd.Mechanism(gravity=(0.0, -9.81))
bob = mech.add(bd.RigidBody("bob", 1.0, 0.1, (1.0, 0.0)))
mech.add(bd.Revolute("pin", mech.ground.at(0.0, 0.0), bob.at(0.0, 0.0)))
mech.observe("bob", bob.at(1.0, 0.0))
answers = {}
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    for name in ("GeneralizedAlpha", "Ida", "Auto", "Radau"):
        try:
            answers[name] = bd.simulate(mech, getattr(bd, name)(), 0.2).q[-1].tolist()
        except bd.BeamdaeError as problem:
            answers[name] = str(problem)
    try:
        answers["equilibrium"] = bd.equilibrium(mech).status.kind
    except bd.BeamdaeError as problem:
        answers["equilibrium"] = str(problem)
print(json.dumps([answers, [x for x in map(str, (x.message for x in caught)) if "core" in x]]))
"""


def run_program(cache, **environment):
    result = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(cache), **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(result.stdout)


@pytest.mark.slow(reason="compiles the core")
def test_core_is_compiled_once(tmp_path):
    answers, sentences = run_program(tmp_path)
    assert not sentences
    (file,) = (tmp_path / "beamdae").glob("core-*")
    # The cache needs no compiler, and the bits are the same.
    assert run_program(tmp_path, CC="false") == [answers, sentences]
    content = file.read_bytes()
    file.write_bytes(content[:-8] + bytes(8))
    assert run_program(tmp_path) == [answers, sentences]
    assert file.read_bytes() == content


@pytest.mark.slow(reason="plain Python")
def test_without_a_compiler_plain_methods_run_with_one_warning(tmp_path):
    answers, (sentence,) = run_program(tmp_path, CC="false", BEAMDAE_NATIVE="off")
    assert sentence.startswith("core: the C compiler false failed")
    assert sentence.endswith("runs take several times as long")
    for name in ("Ida", "Auto"):
        np.testing.assert_allclose(answers[name], answers["GeneralizedAlpha"], atol=1e-4)
    for name in ("Radau", "equilibrium"):
        assert "requires the compiled core; install a C compiler" in answers[name], name


@pytest.mark.parametrize("formulation", ["index3", "stabilized-index2"])
@pytest.mark.parametrize("name", ["hub_beam", "slider_crank"])
def test_steps_of_the_core_are_those_of_the_plain_reference(monkeypatch, name, formulation):
    model = bd.load_model(ROOT / "models" / f"{name}.py")
    method = bd.GeneralizedAlpha(formulation=formulation, newton_tolerance=1e-12)
    expected = bd.simulate(model(), method, 0.02 * model.t_end)
    monkeypatch.setattr(generalized_alpha, "load_core", lambda: None)
    plain = bd.simulate(model(), method, 0.02 * model.t_end)
    assert plain.statistics.factorizations > expected.statistics.factorizations
    # Rounding errors, at which Newton's method ends, decide on one iteration more or less: up to
    # 7e-10 in positions. Velocities contain them divided by the step.
    for name, tolerance in (("q", 2e-9), ("v", 1e-7)):
        values, others = getattr(plain, name), getattr(expected, name)
        bound = tolerance * np.abs(others).max()
        np.testing.assert_allclose(values, others, rtol=0.0, atol=bound)


@pytest.mark.skipif(llvm.host_target().cpu not in llvm.X86_LEVELS, reason="requires x86-64")
def test_core_of_a_wheel_needs_no_compiler(tmp_path, monkeypatch):
    content, target = library._read_library(), llvm.host_target()
    monkeypatch.setattr(object_code, "FOLDER", tmp_path)
    folder = tmp_path / object_code.target_folder(target)
    folder.mkdir(parents=True)
    identity = library.core_identity()
    object_code.write_prebuilt_object(folder, identity, library.NAME, content)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("CC", "false")
    assert library._read_library() == content
    monkeypatch.setattr(library, "core_identity", lambda: f"{identity}/* changed */")
    with pytest.raises(bd.BeamdaeError, match=r"^core: the C compiler false failed"):
        library._read_library()


# Tables of Python objects for the core.


def test_lanes_of_kernels_and_of_the_core_are_the_same():
    assert re.findall(r"#define LANES (\d+)", (FOLDER / "arrays.h").read_text("utf-8")) == [
        str(LANES)
    ]
    assert LANES == LANE_WIDTH


@dataclass
class Rows:
    """Some fields of the balance of no rows."""

    value: np.ndarray = field(default_factory=lambda: np.zeros(0))
    n: int = 3


@pytest.mark.parametrize("value", [np.zeros(0, np.int32), np.zeros((0, 2)), np.zeros((4, 2))[:, 0]])
def test_arrays_of_other_types_are_rejected(value):
    with pytest.raises(TypeError, match=r"^BalanceBuffers.value: (int|float)"):
        Loop("evaluate_balance", Rows(value))


@pytest.mark.parametrize("copies", [1, 5, 8, 21])
def test_sums_of_the_core_are_those_of_plain_python(copies):
    """Inputs and outputs of 8 and more copies are moved in tiles."""
    shared, local = ca.SX.sym("shared", 2), ca.SX.sym("local", 7)
    values = ca.vertcat(local[:3] * local[6], shared[0] * local[3:6])
    kernel = Kernel.of("products", shared, local, [values])
    size = 3 * copies + 3
    operator = np.concatenate([np.eye(6, size, 3 * k) for k in range(copies)])
    builder = SumBuilder(2)
    added = builder.add(kernel, [LocalInput(sparse(operator), 0)], slice(0, copies), copies)
    builder.add_column(added, 0, sparse(operator), 0)
    plan, random = builder.vector(), np.random.default_rng(copies)
    p, x = random.normal(size=(2, max(size, copies)))
    results = np.zeros((3, size))
    for native, result in zip((False, True), results, strict=False):
        total = plan.sum(native, p[:copies])
        total.shared[:] = 0.5, 0.7
        evaluate_sum(total, x[:size], result)
    plain = replace(total, **plan._untiled_entries, code_owners=plan.sum(False, p).code_owners)
    evaluate_plainly(plain, x[:size], results[2])
    expected = sum(
        b.T @ np.concatenate([(y := b @ x[:size])[:3] * p[k], 0.5 * y[3:]])
        for k, b in enumerate(operator.reshape(copies, 6, size))
    )
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_allclose(results, [expected] * 3, rtol=1e-14, atol=1e-14)


def sparse(matrix):
    return sp.csr_array(matrix)
