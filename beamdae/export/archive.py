"""Archives of FMUs: sources, binaries and descriptions, and the time of their steps."""

from __future__ import annotations

import io
import json
import subprocess
import tempfile
import uuid
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from beamdae.core.compilers import (
    Platform,
    compile_objects,
    current_platform,
    find_compiler,
    link_library,
    link_program,
)
from beamdae.core.library import FOLDER
from beamdae.errors import BeamdaeError
from beamdae.export.c_code import UnsupportedOperationError, format_string
from beamdae.export.model_description import (
    Description,
    write_build_description,
    write_description,
)
from beamdae.export.model_source import ExportedModel, write_model_source

C_FOLDER = Path(__file__).parent / "c"
_SHARED_SOURCES = ("instance.c", "points.c", "variables.c")
_SHARED_HEADERS = (
    "stepper.h",
    "instance.h",
    "tables.h",
    "points.h",
    "variables.h",
    "model.h",
)
# Parts of the core besides the loop of the method.
_CORE_SOURCES = ("linear.c", "sums.c", "steps.c")
_CORE_HEADERS = ("core.h", "arrays.h", "elimination.h")
_INTERFACE_HEADERS = {
    2: ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"),
    3: ("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h"),
}
_BENCHMARK = "benchmark.c"
# Entries of the archive have the same date, so that equal models give equal files.
_DATE = (1980, 1, 1, 0, 0, 0)
_FILE_MODE = 0o100755  # regular, executable file
_LICENSE = """\
The sources of this FMU were written by beamdae and are licensed under the MIT license.
The headers fmi2*.h and fmi3*.h are licensed under the 2-Clause BSD license by the Modelica
Association Project "FMI"; the files contain the text of the license.
"""


class StepTimes(NamedTuple):
    """Measured times of one internal step on this machine [s].

    Attributes
    ----------
    median, percentile, worst
        Median, 99.9th percentile and maximum, in which other processes may interrupt the step.
    processor
        Maximum of the processor time, without interruptions (on Windows, the same as `worst`).
    steps
        Number of measured steps.
    error
        Largest difference of an output from steps whose iterations converge to rounding, relative
        to the range of the output in the measured steps; NaN if the iterations of these steps do
        not converge, and with adaptive steps, whose error is controlled.
    row_exchanges
        Number of matrices that could not be eliminated in the fixed order. The elimination with row
        exchanges takes a time proportional to the cube of the number of unknowns.
    """

    median: float
    percentile: float
    worst: float
    processor: float
    steps: int
    error: float
    row_exchanges: int


def list_sources(kind: str, fmi: int) -> tuple[str, ...]:
    """Return the names of the source files for "radau" or "alpha" and a version of FMI."""
    steps = "model.c", f"{kind}_steps.c", *_SHARED_SOURCES, f"{kind}.c", *_CORE_SOURCES
    return *steps, f"fmi{fmi}.c"


def compile_archive(
    part: str,
    exported: ExportedModel,
    description: Description,
    fmi: int,
    targets: Sequence[Platform],
    timed_steps: int,
) -> tuple[dict[str, bytes], dict[str, bytes], StepTimes | None]:
    """Return texts and binaries of the archive by name, and the times of steps.

    Raises
    ------
    BeamdaeError
        If a formula has no C expression, there is no compiler, or steps cannot be timed.
    """
    try:
        model_source = write_model_source(exported)
    except UnsupportedOperationError as problem:
        raise BeamdaeError(
            f"{part}: a formula of the model has no C expression ({problem}); use other functions."
        ) from None
    # Equal models have equal tokens.
    contents = model_source + write_description(description, fmi)
    token = f"{{{uuid.uuid5(uuid.NAMESPACE_URL, contents)}}}"
    description = replace(description, token=token)
    sources = {"model.c": f"{model_source}\nconst char model_token[] = {format_string(token)};\n"}
    headers = *_SHARED_HEADERS, *_CORE_HEADERS, *_INTERFACE_HEADERS[fmi]
    for name in (*description.sources[1:], *headers):
        file = C_FOLDER / name
        sources[name] = (file if file.exists() else FOLDER / name).read_text("utf-8")
    texts = {"modelDescription.xml": write_description(description, fmi)}
    texts |= {f"sources/{name}": text for name, text in sources.items()}
    texts["documentation/licenses/license.txt"] = _LICENSE
    if fmi == 3:
        texts["sources/buildDescription.xml"] = write_build_description(description)
    binaries: dict[str, bytes] = {}
    times = None
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for source, text in sources.items():
            (folder / source).write_text(text, "utf-8")
        (folder / _BENCHMARK).write_bytes((C_FOLDER / _BENCHMARK).read_bytes())
        for target in targets:
            compiler = find_compiler(part, target)
            is_timed = timed_steps > 0 and target == current_platform()
            files = [folder / x for x in (*description.sources, *([_BENCHMARK] * is_timed))]
            objects = compile_objects(part, compiler, target, files, folder)
            library = folder / f"{target.name}{target.suffix}"
            parts = [objects[x] for x in description.sources]
            link_library(part, compiler, target, parts, library)
            place = target.fmi2_name if fmi == 2 else target.name
            entry = f"binaries/{place}/{description.identifier}{target.suffix}"
            binaries[entry] = library.read_bytes()
            if is_timed:
                # Windows runs only files with this suffix.
                program = folder / "benchmark.exe"
                interface = ("variables.c", f"fmi{fmi}.c")
                parts = [x for name, x in objects.items() if name not in interface]
                link_program(part, compiler, parts, program)
                times = _measure(part, program, timed_steps)
    return {name: text.encode() for name, text in texts.items()}, binaries, times


def _measure(part: str, program: Path, steps: int) -> StepTimes:
    command, remedy = [str(program), str(steps)], ""
    try:
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        message = result.stdout.strip()
        if not result.returncode:
            return StepTimes(**json.loads(message))
    except (OSError, ValueError) as problem:
        message = str(problem)
        remedy = "set the environment variable CC to a compiler for this machine, or "
    raise BeamdaeError(
        f"{part}: steps cannot be timed ({message}); {remedy}pass timed_steps=0 to omit the "
        "measurement."
    )


def pack_archive(contents: Mapping[str, bytes]) -> bytes:
    """Return a ZIP archive."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in contents.items():
            info = zipfile.ZipInfo(name, _DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = _FILE_MODE << 16
            archive.writestr(info, content)
    return stream.getvalue()
