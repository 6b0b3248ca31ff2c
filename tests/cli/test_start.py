"""Modules that a run imports, which determine its start time."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from beamdae.native.object_code import is_native_enabled

MODEL = Path(__file__).parents[2] / "models" / "hub_beam.py"
RUN = f"""
import gc, sys
from beamdae.cli import run_outputs
write_tables = run_outputs.write_tables
def check_and_write_tables(*arguments):
    assert "rich" not in sys.modules, "the table waits for the import of Rich"
    write_tables(*arguments)
run_outputs.write_tables = check_and_write_tables
# Called when the table is written and the picture is not yet drawn.
def draw_run(run, solution):
    assert gc.isenabled(), "the garbage collector is disabled only while modules are imported"
    print("imported:", *sys.modules)
    run.files.failed = True
run_outputs.draw_run = draw_run
sys.argv = ["beamdae", "run", {str(MODEL)!r}, "--t-end", "0.01"]
from beamdae.__main__ import main
main()
"""
# Modules of tables, pictures, studies, fits, and of the compiler of loops.
NEVER = {"pandas", "pyarrow", "matplotlib", "numba", "distributed", "multiprocessing", "sksundae"}
NEVER |= {"scipy.optimize", "scipy.interpolate", "scipy.spatial", "scipy.special", "scipy.stats"}
# SciPy imports the modules numpy.f2py and numpy.testing, which import these.
NEVER |= {"numpy.f2py.f2py2e", "numpy.testing._private.utils", "unittest", "charset_normalizer"}
NEVER |= {"asyncio", "hypothesis", "IPython", "rich.traceback"}
# Other commands and integrators, and the conversion of options by Typer.
NEVER |= {"beamdae.cli.commands.sweep", "beamdae.integrators.ida.ida", "pydantic"}
NEVER |= {"beamdae.integrators.alpha.generalized_alpha"}
# Modules of parts, starts and results that the model does not have.
NEVER |= {"beamdae.beams.exact.kinematics", "beamdae.beams.remeshing", "beamdae.beams.sliding"}
NEVER |= {"beamdae.equations.starts.initial_conditions", "beamdae.results.equilibrium"}
NEVER |= {"beamdae.equations.starts.relaxation", "beamdae.equations.starts.reduced_equations"}
NEVER |= {"beamdae.equations.formulations.static_equations", "beamdae.integrators.input_jumps"}
NEVER |= {
    f"beamdae.integrators.events.{name}"
    for name in ("contact_onsets", "event_detection", "table_limits")
}
NEVER |= {"beamdae.cli.model_files.outline"}
NEVER |= {"beamdae.results.storage.checkpoint", "beamdae.results.storage.reader"}
# Packages of beamdae for other tasks.
UNUSED = tuple(f"beamdae.{name}" for name in ("analysis", "studies", "export", "live", "sundials"))


@pytest.mark.slow(reason="starts a process")
@pytest.mark.skipif(sys.platform == "win32", reason="there scikit-sundae is imported")
@pytest.mark.skipif(
    not is_native_enabled(), reason="without machine code scikit-sundae is imported"
)
def test_a_run_imports_only_what_it_needs(tmp_path):
    imported = {"numba"}
    for _ in range(2):
        if "numba" not in imported:
            break  # all loops were in the cache
        result = subprocess.run(
            [sys.executable, "-c", RUN],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
            capture_output=True,
            text=True,
            timeout=120,
        )
        assert result.returncode == 1, result.stderr
        (line,) = [line for line in result.stdout.splitlines() if line.startswith("imported:")]
        imported = set(line.split())
    assert {"casadi", "beamdae.simulation"} <= imported
    assert not NEVER & imported
    assert not [name for name in imported if name.startswith(UNUSED)]


@pytest.mark.slow(reason="starts a process for each command")
@pytest.mark.parametrize(
    ("command", "never"),
    [
        # The models are imported in a separate process.
        (["list", str(MODEL)], ("casadi", "scipy", "pandas")),
        (["examples"], ("casadi", "scipy", "pandas")),
        (["check", str(MODEL)], ("pandas", "matplotlib")),
        (["static", str(MODEL.with_name("pendulum.py"))], ("pandas", "scipy.optimize")),
        (["modes", str(MODEL.with_name("pendulum.py"))], ("scipy.optimize",)),
        (
            ["draw", str(MODEL)],
            (
                *("pandas", "scipy.linalg", "scipy.optimize", "llvmlite", "threadpoolctl"),
                *("beamdae.analysis", "beamdae.integrators", "beamdae.simulation"),
                *("beamdae.equations.equations_of_motion", "beamdae.results.solution"),
                *("beamdae.parts.joints.gears", "beamdae.parts.forces.springs"),
            ),
        ),
    ],
)
def test_commands_import_only_what_they_need(command, never, tmp_path):
    """Pictures and pages imported pandas and all analyses; tables of models imported CasADi."""
    code = f"""
import sys
from beamdae.__main__ import main
sys.argv = ["beamdae", *{command!r}]
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
print("imported:", *sys.modules)
"""
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, check=True, capture_output=True, text=True
    )
    imported = result.stdout.splitlines()[-1].split()
    assert "beamdae.cli.app" in imported
    assert not [name for name in imported if name.startswith(never)]


@pytest.mark.slow(reason="starts a process")
def test_regression_the_plot_of_a_run_does_not_import_pandas(tmp_path):
    code = """
import sys
import beamdae as bd
mech = bd.Mechanism(gravity=(0.0, -9.81))
ball = mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
mech.observe("ball", ball.point)
bd.simulate(mech, t_end=0.1).plot("ball.y").save("ball.png")
assert "matplotlib" in sys.modules
assert "pandas" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)


@pytest.mark.slow(reason="starts a process")
def test_regression_the_import_of_casadi_does_not_count_as_import_of_a_listed_file():
    """On a busy machine, importing CasADi took over 10 s, and no file could be listed."""
    code = f"""
import sys
from pathlib import Path
from beamdae.cli import startup
from beamdae.cli.model_files import listing
startup.import_before_models(startup.MODELS)
from beamdae.cli.model_files.model_file import ModelFile
imported = set(sys.modules)
assert not {{"scipy.linalg", "beamdae.simulation", "beamdae.studies"}} & imported
file = Path({str(MODEL)!r})
assert listing._describe_content(file, ModelFile(file, startup.MODELS)).models
print(*{{name.partition(".")[0] for name in set(sys.modules) - imported}})
"""
    result = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True
    )
    assert not {"casadi", "numpy", "pandas", "scipy"} & set(result.stdout.split()), result.stdout


@pytest.mark.slow(reason="starts a process")
def test_scripts_do_not_import_modules_of_numpy_for_scipy():
    """SciPy imports all modules of NumPy, and `numpy.testing` imports `unittest`."""
    code = """
import sys
import beamdae as bd
mech = bd.Mechanism(gravity=(0.0, -9.81))
mech.add(bd.PointMass("ball", 1.0, at=(0.0, 2.0)))
bd.simulate(mech, t_end=0.1)
assert "scipy.sparse" in sys.modules
names = {"numpy.char", "numpy.ctypeslib", "numpy.f2py", "numpy.ma"}
names |= {"numpy.testing", "unittest"}
assert not names & set(sys.modules), names & set(sys.modules)
assert not {"rich", "typer", "html", "pandas", "matplotlib", "numba"} & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow(reason="starts two processes")
@pytest.mark.skipif(not is_native_enabled(), reason="requires machine code")
def test_runs_with_cached_machine_code_do_not_rewrite_large_kernels():
    """The search for repeated subexpressions took a tenth of the set-up of every run."""
    code = f"""
import gc, sys
sys.path.insert(0, {str(MODEL.parent)!r})
import beamdae as bd
from hub_beam import hub_beam
bd.simulate(hub_beam, t_end=0.1)
from beamdae.symbolic.sums.kernel_sums import Kernel
kernels = [x for x in gc.get_objects() if isinstance(x, Kernel)]
large = [x for x in kernels if x.source.n_instructions() > 4000]
print(len(large), *[x.source.name() for x in large if "function" in vars(x)])
"""
    for _ in range(2):
        result = subprocess.run(
            [sys.executable, "-c", code], check=True, capture_output=True, text=True
        )
    count, *rewritten = result.stdout.split()
    assert int(count) > 0
    assert not rewritten


@pytest.mark.slow(reason="starts a process")
@pytest.mark.parametrize("setting", [None, "26"])
def test_idle_threads_of_blas_libraries_that_beamdae_loads_sleep_soon(setting):
    """In each process, they kept a core busy for a tenth of a second."""
    code = f"""
import os, sys
NAME = "OPENBLAS_THREAD_TIMEOUT"
class Finder:
    def find_spec(self, name, *rest):
        if name in ("numpy", "scipy.linalg"):
            settings.append(os.environ.get(NAME))
settings = []
sys.meta_path.insert(0, Finder())
import beamdae
import numpy
beamdae.Beam
assert "scipy.sparse" in sys.modules
beamdae.simulate
assert settings == 2 * [{setting!r} or "20"], settings
assert os.environ.get(NAME) == {setting!r}
"""
    environment = {x: y for x, y in os.environ.items() if x != "OPENBLAS_THREAD_TIMEOUT"}
    if setting is not None:
        environment["OPENBLAS_THREAD_TIMEOUT"] = setting
    subprocess.run([sys.executable, "-c", code], check=True, env=environment)


@pytest.mark.slow(reason="starts a process")
def test_regression_the_library_leaves_modules_of_numpy_alone():
    """The first use of a public name replaced `numpy.testing` by a module that loads on access."""
    code = """
import sys
import beamdae
import numpy as np
beamdae.Mechanism()
for name in ("numpy.f2py", "numpy.testing"):
    assert name not in sys.modules, name
    assert name.partition(".")[2] not in vars(np), name
from numpy.testing import assert_allclose
from scipy._lib._array_api import xp_assert_close
assert np.testing is sys.modules["numpy.testing"]
xp_assert_close(np.ones(2), np.ones(2))  # uses its copy of `np.testing`
"""
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow(reason="starts a process")
def test_commands_import_matplotlib_without_lists_of_properties():
    """Matplotlib needed 55 ms for docstrings that no command shows."""
    code = """
from beamdae.report.pictures.matplotlib_import import import_matplotlib
import_matplotlib()
from matplotlib.artist import kwdoc
from matplotlib.lines import Line2D
assert "antialiased" not in Line2D.set.__doc__
assert "antialiased" in kwdoc(Line2D), "changed for the model file"
line = Line2D([], [])
line.set(linewidth=2.5)
assert line.get_linewidth() == 2.5
"""
    subprocess.run([sys.executable, "-c", code], check=True)
