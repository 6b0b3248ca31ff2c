"""Initial words of the instances of a model: a table of the core, followed by its arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from beamdae.core.tables import Layout, address_of
from beamdae.export.c_code import Tables
from beamdae.symbolic.sums.kernel_sums import Sum, SumPlan

Array = np.ndarray

_WORD = 8  # bytes


class Image:
    """Words of a layout, and of the arrays to which it refers.

    Arrays of indices are constants, which instances share.

    Parameters
    ----------
    layout
        Layout of the table.
    first
        Arrays that follow the table, in this order; the others follow in the order of the layout,
        those of sums last.
    """

    def __init__(self, layout: Layout, first: Sequence[Array] = ()) -> None:
        self._layout, self._first = layout, first
        self._constants = [(k, x) for k, x in layout.arrays if x.size and x.dtype == np.uint32]
        self._arrays = [(k, x) for k, x in layout.arrays if x.size and x.dtype != np.uint32]
        self._sums = {id(x): x for x, _, _ in layout.objects if isinstance(x, Sum)}
        owned = {id(getattr(x, name)) for x in self._sums.values() for name in Sum.__slots__}
        self._arrays.sort(key=lambda pair: id(pair[1]) in owned)
        self._n_state = sum(id(x) not in owned for _, x in self._arrays)
        self._blocks = self._place_blocks()

    def _place_blocks(self) -> list[tuple[int, int, int]]:
        """Return (address, size, index of the first word) of blocks of memory, by address."""
        arrays = [*self._first, *(x for _, x in self._arrays)]
        spans = sorted((address_of(x), x.nbytes) for x in arrays if x.size)
        blocks: list[list[int]] = []
        for start, size in spans:
            # Arrays may be views of the same memory.
            if blocks and start < sum(blocks[-1]):
                blocks[-1][1] = max(blocks[-1][1], start + size - blocks[-1][0])
            else:
                blocks.append([start, size])
        starts = np.array([start for start, _ in blocks])
        order = dict.fromkeys(
            int(np.searchsorted(starts, address_of(x), "right")) - 1 for x in arrays if x.size
        )
        placed, at = [], len(self._layout.words)
        for k in order:
            start, size = blocks[k]
            placed.append((start, size // _WORD, at))
            at += size // _WORD
        return sorted(placed)

    def locate(self, array: Array) -> int:
        """Return the index of the first word of an array."""
        address = address_of(array)
        start, _, at = next(x for x in reversed(self._blocks) if x[0] <= address)
        return at + (address - start) // _WORD

    def describe(self, tables: Tables) -> dict[str, Any]:
        """Return fields of `Model` by name, as C expressions."""
        words = np.array(self._layout.words, np.int64)
        words[[k for k, _ in self._layout.arrays]] = 0  # addresses
        for x in self._layout.numbers_in(words):
            x.words[x.word] = getattr(x.owner, x.name)
        segments = [f"{{0, {len(words)}, {tables.integers(words)}}}"]
        # Of views that begin at the same word, the longest.
        arrays = sorted((x for _, x in self._arrays if x.any()), key=lambda x: x.nbytes)
        for at, array in {self.locate(x): x for x in arrays}.items():
            flat = array.ravel()
            is_integer = flat.dtype.kind == "i"
            name = tables.integers(flat) if is_integer else tables.numbers(flat.view(np.float64))
            segments.append(f"{{{at}, {array.nbytes // _WORD}, {name}}}")
        constants = [f"{{{k}, {tables.indices(x.ravel())}}}" for k, x in self._constants]
        links = [f"{{{k}, {self.locate(x)}}}" for k, x in self._arrays]
        _, size, at = max(self._blocks, key=lambda x: x[2])
        further = [x for _, x in self._arrays[self._n_state :]]
        sizes = {
            "n_words": at + size,
            "n_state": self.locate(further[0]) if further else at + size,
        }
        return sizes | _count_rows(
            tables,
            segments=("Segment", segments),
            constants=("Constant", constants),
            links=("Link", links),
        )

    def describe_sums(
        self,
        tables: Tables,
        plans: dict[int, SumPlan],
        name_of: Callable[[Any], str],
        number_of: Array,
    ) -> dict[str, Any]:
        """Return fields of `Model` on kernels, and on numbers that depend on values.

        `plans` are those of the sums by identity, `name_of` returns the C function of a batch, and
        `number_of` contains the index of each number p, or -1 for constant numbers.
        """
        codes, numbers = [], []
        for key, total in self._sums.items():
            plan = plans[key]
            if plan.batches:
                first = self.locate(total.kernels)
                codes += [f"{{{first + k}, {name_of(x)}}}" for k, x in enumerate(plan.batches)]
            number = number_of[plan.data_sources.astype(int)]
            for target, k in zip(plan.data_targets[number >= 0], number[number >= 0], strict=True):
                numbers.append(f"{{{self.locate(total.local) + int(target)}, {k}}}")
        return _count_rows(tables, codes=("Code", codes), numbers=("Number", numbers))


def _count_rows(tables: Tables, **arrays: tuple[str, list[str]]) -> dict[str, Any]:
    """Return the names of arrays of structures by field, and the numbers of their rows."""
    fields: dict[str, Any] = {f"n_{name}": len(rows) for name, (_, rows) in arrays.items()}
    return fields | {name: tables.rows(kind, rows) for name, (kind, rows) in arrays.items()}
