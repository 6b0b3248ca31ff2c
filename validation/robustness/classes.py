"""Registered classes of trials, by the module and name of each `TrialClass`.

To add a class, write a module with a `TrialClass` and add its place here.
"""

from __future__ import annotations

from importlib import import_module

from robustness.trial_class import TrialClass

CLASSES = {
    "inputs": "robustness.inputs.catalog:TRIALS",
    "mechanisms": "robustness.mechanisms:TRIALS",
    "starts": "robustness.starts:TRIALS",
    "writes": "robustness.writes:TRIALS",
    "faults": "robustness.faults.catalog:TRIALS",
    "interrupts": "robustness.interrupts:TRIALS",
    "files": "robustness.files.catalog:TRIALS",
}


def load_class(name: str) -> TrialClass:
    """Import and return a registered class."""
    module, _, attribute = CLASSES[name].partition(":")
    trial_class = getattr(import_module(module), attribute)
    assert trial_class.name == name, f"{CLASSES[name]} has another name than {name}"
    return trial_class
