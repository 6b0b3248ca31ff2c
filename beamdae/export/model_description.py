"""Model descriptions of FMUs, versions 2.0 and 3.0 of the Functional Mock-up Interface.

https://fmi-standard.org
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import version
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from beamdae.core.compilers import CORE_FLAGS
from beamdae.export.model_source import Output, Value
from beamdae.model_parameters import parse_unit

LOG_CATEGORY = "logStatusError"


@dataclass(frozen=True)
class Description:
    """Contents of a model description.

    Attributes
    ----------
    name, identifier
        Name of the model, and name of the binaries (a C identifier).
    token
        GUID or instantiation token.
    step, stop
        Default communication step and end time [s].
    values, outputs
        Inputs, parameters and outputs; value references count values, then outputs.
    sources
        Names of the source files to compile.
    internal_step
        Internal step [s]; None if the FMU chooses its internal steps.
    """

    name: str
    identifier: str
    token: str
    step: float
    stop: float
    values: tuple[Value, ...]
    outputs: tuple[Output, ...]
    sources: tuple[str, ...]
    internal_step: float | None = None


def write_description(description: Description, fmi: int) -> str:
    """Return modelDescription.xml for FMI 2.0 (`fmi` = 2) or 3.0 (3)."""
    return _format(_describe(description, fmi))


def write_build_description(description: Description) -> str:
    """Return sources/buildDescription.xml of FMI 3.0."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    build = SubElement(root, "BuildConfiguration", modelIdentifier=description.identifier)
    files = SubElement(
        build,
        "SourceFileSet",
        {"language": "C11", "compiler": "gcc", "compilerOptions": " ".join(CORE_FLAGS)},
    )
    for name in description.sources:
        SubElement(files, "SourceFile", name=name)
    SubElement(build, "Library", name="m")
    return _format(root)


def _describe(x: Description, fmi: int) -> Element:
    """Return the root of a model description; the versions name some attributes differently."""
    is_2 = fmi == 2
    root = Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{fmi}.0",
            "modelName": x.name,
            "guid" if is_2 else "instantiationToken": x.token,
            "generationTool": f"beamdae {version('beamdae')}",
            "variableNamingConvention": "flat",
        },
    )
    interface = SubElement(
        root,
        "CoSimulation",
        {
            "modelIdentifier": x.identifier,
            "canHandleVariableCommunicationStepSize": "true",
            "canGetAndSetFMUstate" if is_2 else "canGetAndSetFMUState": "true",
            "canSerializeFMUstate" if is_2 else "canSerializeFMUState": "true",
            f"providesDirectionalDerivative{'' if is_2 else 's'}": _flag(bool(x.values)),
        },
    )
    if is_2:
        files = SubElement(interface, "SourceFiles")
        for name in x.sources:
            SubElement(files, "File", name=name)
    elif x.internal_step is not None:
        interface.set("fixedInternalStepSize", repr(x.internal_step))
    _add_common(root, x)
    variables = SubElement(root, "ModelVariables")
    for k, (attributes, number) in enumerate(_list_variables(x, has_time=not is_2)):
        attributes = {**attributes, "valueReference": str(k)}
        if is_2:
            SubElement(SubElement(variables, "ScalarVariable", attributes), "Real", number)
        else:
            SubElement(variables, "Float64", {**attributes, **number})
    structure = SubElement(root, "ModelStructure")
    references = range(len(x.values), len(x.values) + len(x.outputs))
    for name in ("Output", "InitialUnknown") if x.outputs else ():
        unknowns = SubElement(structure, f"{name}s") if is_2 else structure
        for k in references:
            if is_2:
                SubElement(unknowns, "Unknown", index=str(1 + k))
            else:
                SubElement(unknowns, name, valueReference=str(k))
    return root


def _list_variables(
    x: Description, has_time: bool
) -> Iterator[tuple[dict[str, str], dict[str, str]]]:
    """Yield name, causality and variability, and the type, of inputs, parameters and outputs."""
    for value in x.values:
        yield {"name": value.name, **_role(value)}, _number(value)
    for output in x.outputs:
        role = {"causality": "output", "variability": "continuous"}
        yield {"name": output.name, **role}, _unit(output.unit)
    if has_time:
        role = {"causality": "independent", "variability": "continuous"}
        yield {"name": "time", **role}, _unit("s")


def _add_common(root: Element, x: Description) -> None:
    units = {y.unit for y in x.values} | {y.unit for y in x.outputs} | {"s"}
    definitions = SubElement(root, "UnitDefinitions")
    for unit in sorted(units - {"-", ""}):
        element = SubElement(definitions, "Unit", name=unit)
        exponents = base_exponents(unit)
        if exponents is not None:
            SubElement(element, "BaseUnit", {k: str(n) for k, n in exponents.items() if n})
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name=LOG_CATEGORY)
    times = {"startTime": "0.0", "stopTime": repr(x.stop), "stepSize": repr(x.step)}
    SubElement(root, "DefaultExperiment", times)


def _role(value: Value) -> dict[str, str]:
    if value.is_input:
        return {"causality": "input", "variability": "continuous"}
    return {"causality": "parameter", "variability": "tunable"}


def _number(value: Value) -> dict[str, str]:
    limits = {"min": value.low, "max": value.high}
    finite = {name: repr(x) for name, x in limits.items() if math.isfinite(x)}
    return {"start": repr(value.start), **finite, **_unit(value.unit)}


def _unit(unit: str) -> dict[str, str]:
    return {"unit": unit} if unit not in ("-", "") else {}


def _flag(value: bool) -> str:
    return "true" if value else "false"


def base_exponents(unit: str) -> dict[str, int] | None:
    """Return the exponents of the base units of a unit such as 'N m/rad'; None if unknown.

    Units that differ from a product of base units by a factor, such as 'mm', are unknown, too.
    """
    parsed = parse_unit(unit)
    return parsed[1] if parsed is not None and parsed[0] == 1 else None


def _format(root: Element) -> str:
    indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{tostring(root, "unicode")}\n'
