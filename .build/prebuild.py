"""Compile the core and the kernels of the package for `beamdae.native.object_code`.

    python .build/prebuild.py FOLDER

Short runs and equilibria of many mechanisms are computed, and everything that these load is
compiled for the levels of x86-64 processors from AVX2 on. The mechanisms are those of the models
and studies in `models/`, and the sample parts of the tests with each kind of beam; derivatives
are computed for one model. Each level is then checked in a separate process, so only the levels
that this machine can execute are compiled: kernels agree bitwise with CasADi's virtual machine,
runs of the models agree with those of interpreted code, nothing is compiled in these runs, and all
levels return the same bits.
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import cache, partial
from importlib.util import find_spec
from itertools import chain, product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from sample_parts import SAMPLES, SampleMechanism, find_public  # noqa: E402

import beamdae as bd  # noqa: E402
from beamdae import catalog  # noqa: E402
from beamdae.beams.beam import EXACT_FORMULATION, FORMULATIONS  # noqa: E402
from beamdae.beams.floating_frame import STRAINS  # noqa: E402
from beamdae.cli.model_file import ModelFile  # noqa: E402
from beamdae.core import library  # noqa: E402
from beamdae.core.compilers import PLATFORMS  # noqa: E402
from beamdae.equations.formulations.first_order import FIRST_ORDER  # noqa: E402
from beamdae.integrators.alpha import generalized_alpha  # noqa: E402
from beamdae.native import lane_kernels, llvm, object_code  # noqa: E402
from beamdae.parts.part import Part  # noqa: E402

# Without x86-64-v2 (before AVX2, of 2013), for which LLVM takes four to six times as long.
_LEVELS = llvm.X86_LEVELS[1:]
# Durations of runs of models (fraction of their end time) and of samples [s]: long enough to load
# all kernels.
_RUN_FRACTION = 0.005
_SAMPLE_TIME = 1e-3
_SAMPLING_INTERVAL = 2e-4  # s, of a controller
_RTOL = 1e-5
_FORMULATIONS = tuple(dict.fromkeys((*FIRST_ORDER, *generalized_alpha.FORMULATIONS)))
_DAMPING = 1e-5  # s
_NODES = (4, 6, 7, 8)  # of elements of given numbers, and of meshes that the program chooses
_PERIOD = 1.0  # s
# Two correct runs differ by less than the tolerance relative to the motion, or by rounding errors
# relative to the largest coordinate. Measured: 1e-8 and 2e-15.
_MAX_DIFFERENCE = _RTOL
_MAX_ROUNDING = 1e-12


@dataclass
class Recorder:
    """Replacement of `object_code.load_object` that compiles everything and keeps the sources."""

    sources: dict[str, Any] = field(default_factory=dict)

    def __call__(self, source: Any, is_correct: Any, compiles: bool = True) -> Any:
        """Return the machine code of a source, as `object_code.load_object` does."""
        source = replace(source, ir=cache(source.module))
        code = object_code.load_object(source, is_correct)
        if code is not None:
            self.sources.setdefault(source.name + source.identity, source)
        return code


def compile_objects(folder: Path) -> None:
    """Write the objects of all levels to subfolders of `folder`, and check them.

    Raises
    ------
    RuntimeError
        If a check fails.
    """
    host = llvm.host_target()
    if host.cpu not in _LEVELS:
        return
    targets = [host._replace(cpu=cpu) for cpu in _LEVELS[: _LEVELS.index(host.cpu) + 1]]
    if find_spec("ziglang"):
        # Libraries of other compilers require the C library of this machine.
        zig_target = PLATFORMS["x86_64-linux"].zig_target
        os.environ["CC"] = f"{sys.executable} -m ziglang cc -target {zig_target}"
    recorder = Recorder()
    lane_kernels.load_object = recorder
    exercises = (model_runs, sample_runs, derivative_runs)
    identity = library.core_identity()
    for exercise in chain.from_iterable(make() for make in exercises):
        with suppress(bd.BeamdaeError):
            exercise()
    # The longest first, to keep all processes busy.
    sources = sorted(recorder.sources.values(), key=lambda source: -len(source.module()))
    print(f"compiling {len(sources)} objects for {', '.join(x.cpu for x in targets)}", flush=True)
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        for target in targets:
            target_folder = folder / object_code.target_folder(target)
            target_folder.mkdir(parents=True)
            contents = pool.map(
                partial(llvm.compile_module, target=target),
                [source.module() for source in sources],
                [source.level for source in sources],
            )
            core = library.compile_core(target)
            object_code.write_prebuilt_object(target_folder, identity, library.NAME, core)
            for source, content in zip(sources, contents, strict=True):
                object_code.write_prebuilt_object(
                    target_folder, source.identity, source.name, content
                )
    with ThreadPoolExecutor() as pool:
        commands = [[sys.executable, __file__, str(folder), target.cpu] for target in targets]
        digests = set(pool.map(subprocess.check_output, commands))
    if len(digests) > 1:
        raise RuntimeError("results of runs depend on the level of the processor")


def default_integrators() -> list[Any]:
    """Return the integrators of the catalog with their default settings."""
    return [getattr(bd, public.name)() for public in catalog.INTEGRATORS.values()]


def all_integrators() -> list[Any]:
    """Return the integrators of the catalog in all formulations, with fixed and adaptive steps."""
    result = default_integrators()
    for integrator in default_integrators():
        settings = {one.name for one in fields(integrator)}
        if "rtol" in settings and integrator.rtol is None:
            result.append(replace(integrator, rtol=_RTOL))
        for formulation in _FORMULATIONS if "formulation" in settings else ():
            with suppress(bd.BeamdaeError):
                result.append(replace(integrator, formulation=formulation))
    return result


def model_runs() -> Iterator[Callable[[], Any]]:
    """Yield short runs and the equilibrium of each model, and short runs of each study."""
    for file in sorted((ROOT / "models").rglob("*.py")):
        content = ModelFile(file)
        for model in content.models.values():
            for integrator in default_integrators():
                yield partial(run_model, model, {}, integrator)
            yield lambda model=model: bd.equilibrium(model())
        for study in content.studies.values():
            for case in study.cases:
                yield partial(run_model, case.model, case.parameters, case.integrator)


def run_model(model: Any, parameters: Any, integrator: Any) -> Any:
    """Return the results of a short run."""
    return bd.simulate(model(**parameters), integrator, _RUN_FRACTION * model.t_end)


def sample_runs() -> Iterator[Callable[[], Any]]:
    """Yield runs and equilibria of the sample beams and parts, and the motion of a driven disk."""
    sections = [replace(SampleMechanism().section, damping=damping) for damping in (0.0, _DAMPING)]
    kinds = [*({"strain": strain} for strain in STRAINS), {"formulation": EXACT_FORMULATION}]
    for kind, section, nodes in product(kinds, sections, _NODES):
        mechanism, _ = sample_mechanism({**kind, "section": section, "nodes": nodes})
        yield from sample_runs_of(mechanism, default_integrators())
    for formulation in FORMULATIONS:
        mechanism, _ = sample_mechanism({"formulation": formulation})
        yield from sample_runs_of(mechanism, all_integrators())
    for formulation, (name, arguments) in product(FORMULATIONS, SAMPLES.items()):
        mechanism, sample = sample_mechanism({"formulation": formulation})
        part = find_public(name)(**arguments(sample))
        if isinstance(part, Part):
            mechanism.add(part)
            yield from sample_runs_of(mechanism, default_integrators())
    yield from sample_runs_of(sampled_disk(), all_integrators())
    yield lambda: bd.periodic(driven_disk(), period=_PERIOD)


def derivative_runs() -> Iterator[Callable[[], Any]]:
    """Yield derivatives of short runs of one model."""
    model, by = bd.load_model(ROOT / "models" / "hub_beam.py"), "torque"
    t_end = _RUN_FRACTION * model.t_end
    for integrator in (bd.GeneralizedAlpha(), bd.Radau()):
        yield partial(bd.sensitivities, model, [by], integrator, t_end)
        yield partial(bd.gradient, model, bd.quantities.EndValue("tip.x"), by, integrator, t_end)


def sample_mechanism(beam: dict[str, Any]) -> tuple[Any, SampleMechanism]:
    """Return a mechanism of one beam with these settings, to which samples can be added."""
    sample = SampleMechanism()
    settings = {"curve": sample.curve, "section": sample.section, "elements": 1, **beam}
    sample.beam = sample.mechanism.add(bd.Beam("beam", **settings))
    return sample.mechanism, sample


def sample_runs_of(mechanism: Any, integrators: list[Any]) -> Iterator[Callable[[], Any]]:
    """Yield runs of a mechanism with each of the integrators, and its equilibrium."""
    for integrator in integrators:
        yield partial(bd.simulate, mechanism, integrator, _SAMPLE_TIME)
    yield partial(bd.equilibrium, mechanism)


def sampled_disk() -> Any:
    """Return a disk whose torque is set by a sampled controller, several times in a run."""
    sample = SampleMechanism()
    sample.mechanism.add(bd.Revolute("hinge", sample.ground.at(0.5, 0.4), sample.disk.at(0.5, 0.4)))
    torque = sample.mechanism.input("torque", unit="N m")
    sample.mechanism.add(bd.Moment("motor", sample.disk.at(0.5, 0.4), torque))
    angle = sample.mechanism.sensor("angle", sample.disk.at(0.5, 0.4), "angle")
    sample.mechanism.add(
        bd.Controller("servo", _SAMPLING_INTERVAL, [angle], [torque], lambda x: 0.1 - x.reads[0])
    )
    return sample.mechanism


def driven_disk() -> Any:
    """Return a disk on a spring and a damper under a periodic moment."""
    sample = SampleMechanism()
    sample.mechanism.add(bd.Revolute("hinge", sample.ground.at(0.5, 0.4), sample.disk.at(0.5, 0.4)))
    ends = sample.ground.at(0.5, 0.4), sample.disk.at(0.5, 0.4)
    sample.mechanism.add(bd.TorsionSpring("spring", *ends, stiffness=1.0))
    sample.mechanism.add(bd.TorsionSpring("damper", *ends, damping=0.1))
    sample.mechanism.add(
        bd.Moment("moment", sample.disk.at(0.5, 0.4), law=bd.sine(1.0, 1.0 / _PERIOD))
    )
    return sample.mechanism


def check_level(folder: Path, cpu: str) -> str:
    """Return a digest of runs of all models with the objects of a level.

    Raises
    ------
    RuntimeError
        If an object is missing, or a run differs from the run of interpreted code.
    """
    target = llvm.host_target()._replace(cpu=cpu)
    llvm.host_target = lambda: target
    object_code.FOLDER = folder

    def refuse(*_: Any) -> bytes:
        raise RuntimeError("an object was not compiled in advance, or is wrong")

    llvm.compile_module = library.compile_core = refuse
    digest = hashlib.sha256()
    for file in sorted((ROOT / "models").glob("*.py")):
        for model in ModelFile(file).models.values():
            for integrator in default_integrators():
                q = run_model(model, {}, integrator).q
                digest.update(q.tobytes())
                os.environ["BEAMDAE_NATIVE"] = "off"
                expected = run_model(model, {}, integrator).q
                del os.environ["BEAMDAE_NATIVE"]
                motion, size = np.max(np.abs(expected - expected[0])), np.max(np.abs(expected))
                difference = np.max(np.abs(q - expected))
                if not difference <= _MAX_DIFFERENCE * motion + _MAX_ROUNDING * size:
                    raise RuntimeError(
                        f"{model.name}: machine code for {cpu} and interpreted code differ by "
                        f"{difference:g} after a motion of {motion:g} with {integrator}"
                    )
    return digest.hexdigest()


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as cache_folder:
        # Nothing is loaded from, or left in, the cache of the user.
        os.environ["XDG_CACHE_HOME"] = cache_folder
        os.environ.pop("BEAMDAE_NATIVE", None)
        if sys.argv[2:]:
            print(check_level(Path(sys.argv[1]), sys.argv[2]))
        else:
            compile_objects(Path(sys.argv[1]))
