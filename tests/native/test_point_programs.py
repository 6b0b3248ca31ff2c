"""Programs of sums over points equal the straight-line kernels, in machine code and in C."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest
from mechanisms import clamped_beam
from numpy.testing import assert_allclose
from properties.catalog_models import ENTRIES, entry_model

import beamdae as bd
from beamdae.beams.exact import ExactElement
from beamdae.beams.floating_frame import FloatingFrameElement
from beamdae.core.library import FOLDER
from beamdae.core.tables import Workspace
from beamdae.equations.assembly.assemble import equations_of_motion
from beamdae.equations.formulations.first_order import formulate_first_order
from beamdae.export.c_code import Tables, write_kernel, write_operations, write_point_kernel
from beamdae.export.fmu import C_FOLDER
from beamdae.integrators.compiled_run import StepLoop
from beamdae.integrators.ida.python_solver import SksundaeIda
from beamdae.native.lane_kernels import LANE_WIDTH, LaneKernel, rewrite
from beamdae.native.object_code import is_native_enabled
from beamdae.symbolic.sums.kernel_sums import Sum
from beamdae.symbolic.sums.rotations import rotate_kernel

pytestmark = pytest.mark.skipif(not is_native_enabled(), reason="requires machine code")

# Sums of some hundred products of numbers between 0.5 and 1.5, in another order.
ROUNDING = 1e-13

ELEMENTS = [
    FloatingFrameElement(strain="green"),
    FloatingFrameElement(strain="nonlinear", damped=False, prestressed=True),
    FloatingFrameElement(strain="linear"),
    FloatingFrameElement(strain="exact"),
    ExactElement(),
    ExactElement(damped=False),
]


def list_kernels(force):
    return [
        (force.force_kernel, 0),
        (force.balance_kernel, 1),
        (force.tangent_kernel(((0, 1, 2),)), 0),
        (force.tangent_kernel(((2,), (0, 1))), 0),
    ]


def draw_inputs(kernel, lanes=1):
    random = np.random.default_rng(3)
    shared = random.uniform(0.5, 1.5, kernel.source.numel_in(0))
    return shared, random.uniform(0.5, 1.5, (kernel.n_local, lanes))


def assert_equal_to(expected, values):
    assert_allclose(values, expected, rtol=0.0, atol=ROUNDING * np.abs(expected).max())


def evaluate(kernel, shared, local):
    return np.hstack([kernel.function(shared, x).full() for x in local.T])


@pytest.fixture(scope="module")
def rotation():
    """Rotation of a curved beam of one element with five nodes."""
    arc, section = bd.Arc(radius=1.0, length=1.0), bd.Section.circle(bd.Material.of("steel"), 0.01)
    mech, _ = clamped_beam(section, 1, arc, nodes=5)
    (term,) = equations_of_motion(mech).structure.forces
    assert term.rotation is not None
    return term.rotation


@pytest.mark.parametrize("element", ELEMENTS, ids=str)
@pytest.mark.parametrize("nodes", [2, 5, 8])
def test_machine_code_equals_straight_line_kernels(element, nodes):
    element = type(element)(**{**vars(element), "nodes": nodes, "quadrature": nodes - 1})
    for kernel, _ in list_kernels(element.kernel()):
        shared, local = draw_inputs(kernel, 2 * LANE_WIDTH)
        code = kernel.points.compile(kernel.source, kernel.outputs, True)
        assert_equal_to(evaluate(kernel, shared, local), code(shared, local))


LOADS = {
    "drag": lambda beam: bd.AirDrag("drag", beam, 0.3),
    "damping": lambda beam: bd.RayleighDamping("damping", beam, mass=0.1, stiffness=1e-3),
    "follower": lambda beam: bd.DistributedForce(
        "follower", beam, (1.0, bd.sine(2.0, frequency=1.0)), axes="section"
    ),
}


@pytest.mark.parametrize("formulation", ["floating frame", "exact"])
@pytest.mark.parametrize("name", LOADS)
def test_machine_code_of_loads_equals_straight_line_kernels(name, formulation):
    arc, section = bd.Arc(radius=1.0, length=1.0), bd.Section.circle(bd.Material.of("steel"), 0.01)
    beam = bd.Beam("beam", arc, section, elements=1, nodes=5, formulation=formulation)
    (statement,) = LOADS[name](beam).forces(np.zeros(2))
    for kernel, _ in list_kernels(statement.kernel):
        shared, local = draw_inputs(kernel, 2 * LANE_WIDTH)
        code = kernel.points.compile(kernel.source, kernel.outputs, True)
        assert_equal_to(evaluate(kernel, shared, local), code(shared, local))


@pytest.mark.parametrize("element", ELEMENTS[:4], ids=str)
def test_rotated_machine_code_equals_straight_line_kernels(element, rotation):
    element = type(element)(**{**vars(element), "nodes": 5, "quadrature": 5})
    for kernel, scalars in list_kernels(element.kernel()):
        rotated = rotate_kernel(kernel, rotation, 3, scalars)
        shared, local = draw_inputs(rotated, LANE_WIDTH)
        code = rotated.points.compile(rotated.source, rotated.outputs, True)
        assert_equal_to(evaluate(rotated, shared, local), code(shared, local))


@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
def test_c_functions_equal_straight_line_kernels(rotation, tmp_path):
    element = FloatingFrameElement(nodes=5, quadrature=4, strain="green")
    for k, (kernel, scalars) in enumerate(list_kernels(element.kernel())):
        kernel = rotate_kernel(kernel, rotation, 3, scalars)
        points, tables, functions, names = kernel.points, Tables(), [], {}
        for symbol, term in zip(points.symbols, points.terms, strict=True):
            names[symbol] = symbol
            functions.append(write_kernel(symbol, rewrite(term.source, term.rewrites)))
        program = points.program(kernel.outputs)
        constants = tables.indices(program.integers), tables.numbers(program.weights)
        function = write_point_kernel("whole", program, names, *constants)
        text = "\n".join([*functions, tables.source, function]).replace("static void", "void")
        source, library = tmp_path / f"model{k}.c", tmp_path / f"model{k}.so"
        source.write_text(f'#include "points.h"\n{write_operations()}\n{text}')
        sources = [str(source), str(C_FOLDER / "points.c")]
        flags = ["-std=gnu11", "-O2", "-shared", "-fPIC", f"-I{C_FOLDER}", f"-I{FOLDER}"]
        subprocess.run(["cc", *flags, *sources, "-o", str(library), "-lm"], check=True)
        shared, local = draw_inputs(kernel, LANE_WIDTH)
        values = np.zeros((kernel.n_out, local.shape[1]))
        arrays = [x.ctypes.data_as(ctypes.c_void_p) for x in (shared, local, values)]
        ctypes.CDLL(str(library)).whole(*arrays, ctypes.c_int64(local.shape[1]))
        # The function evaluates one vector, which has two lanes on most processors.
        assert_equal_to(evaluate(kernel, shared, local)[:, :2], values[:, :2])


# Every public part runs in machine code: its kernels and the loops are compiled.


def with_switch():
    """Disk and beam fall together for two thirds of a millisecond, and then apart."""
    mech = entry_model(entry="Revolute")
    mech.when("disk.y_dot", -1e-3, "down", bd.deactivate(mech.part("joint")), "cut")
    return mech


def list_code(work):
    """Return the code of all sums in a workspace."""
    if isinstance(work, Sum):
        return work.code_owners
    values = vars(work).values() if isinstance(work, Workspace) else ()
    return [code for value in values for code in list_code(value)]


@pytest.mark.skipif(not is_native_enabled(), reason="requires machine code")
def test_native_off_applies_only_while_it_is_set(monkeypatch):
    """Kernels belong to the structure of the equations, which similar models share."""
    form = formulate_first_order(bd.equations_of_motion(entry_model(entry="Revolute")), "index3")
    monkeypatch.setenv("BEAMDAE_NATIVE", "off")
    assert not any(plan.load_native(True) for plan in form.sums)
    monkeypatch.delenv("BEAMDAE_NATIVE")
    assert all(plan.load_native(True) for plan in form.sums)


@pytest.mark.slow(reason="kernels of all parts for all integrators are compiled")
@pytest.mark.skipif(not is_native_enabled(), reason="requires machine code")
@pytest.mark.filterwarnings("ignore::beamdae.BeamdaeWarning")
@pytest.mark.parametrize("name", [*ENTRIES, "switched"])
def test_runs_consist_of_compiled_loops(name, monkeypatch):
    runs, begin = [], StepLoop.__init__

    def record(self, *arguments):
        begin(self, *arguments)
        runs.append({type(x) for x in list_code(self.work)})

    def refuse(self, *_):
        raise AssertionError("IDA calls Python")

    monkeypatch.setattr(StepLoop, "__init__", record)
    monkeypatch.setattr(SksundaeIda, "__init__", refuse)
    model = with_switch() if name == "switched" else entry_model(entry=name)
    equations = bd.equations_of_motion(model)
    for integrator in (bd.GeneralizedAlpha(1e-3), bd.Radau(), bd.Ida()):
        solution = bd.simulate(equations, integrator, 2e-3, output_step=1e-3)
        assert solution.status.success
    # Generalized-alpha and Radau; Ida would have warned.
    assert len(runs) >= 2
    assert all(kinds == {LaneKernel} for kinds in runs)
