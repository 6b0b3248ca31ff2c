"""Compute the stored references: `python validation/error_statements/references.py [TEXT]`.

Each case is run once with elements quartered, geometrically exact beams, a thirtieth of the
friction speed and `Radau` at 1e-7; its difference from a run with elements halved, a ninetieth of
the friction speed and 1e-6 is the uncertainty. Stored references are kept unless their names
contain TEXT. Takes about ten minutes.
"""

import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "models"), str(ROOT / "validation")]

import numpy as np
from error_statements.cases import (
    ALL,
    CHECK,
    REFERENCES,
    REFINEMENT,
    RTOL,
    SHARPNESS,
    STRIDE,
    ErrorCase,
    StoredReference,
    compare_rows,
)


def compute_reference(case: ErrorCase) -> StoredReference:
    """Return the reference of a case and its uncertainty [-], the larger of rms and peak errors."""
    fine, check = case.refine(REFINEMENT, SHARPNESS, RTOL), case.refine(*CHECK)
    moving = fine.std(ddof=0) > 1e-9 * fine.abs().max()
    fine, check = fine.loc[:, moving], check.loc[:, moving]
    uncertainty = compare_rows(check, fine)[["rms", "peak"]].max(axis=1)
    return StoredReference(
        np.array(fine.columns, dtype=str),
        fine.to_numpy()[::STRIDE].astype(np.float32),
        np.stack([fine.min(), fine.max()]).astype(np.float32),
        uncertainty.to_numpy().astype(np.float32),
    )


def store(stored: dict[str, np.ndarray], path: Path = REFERENCES) -> None:
    """Write all references."""
    path.parent.mkdir(exist_ok=True)
    np.savez_compressed(path, **stored)


def main(text: str = "") -> None:
    stored: dict[str, np.ndarray] = {}
    if REFERENCES.exists():
        with np.load(REFERENCES) as file:
            stored = {key: file[key] for key in file.files}
    names = {case.name for case in ALL}
    stored = {key: value for key, value in stored.items() if key.rpartition("/")[0] in names}
    for case in ALL:
        if f"{case.name}/rows" in stored and not (text and text in case.name):
            continue
        begin = time.process_time()
        try:
            reference = compute_reference(case)
        except Exception as error:  # A case without a reference is left out.
            print(f"{case.name}: {type(error).__name__}: {error}", flush=True)
            continue
        stored |= {f"{case.name}/{key}": getattr(reference, key) for key in StoredReference.KEYS}
        spent = time.process_time() - begin
        print(f"{case.name}: {spent:.0f} s, {np.median(reference.uncertainty):.1e}", flush=True)
        store(stored)
    store(stored)


if __name__ == "__main__":
    main(*sys.argv[1:])
