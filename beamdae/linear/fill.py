"""Which entries the factors of a matrix have, from its pattern and pivots alone."""

from __future__ import annotations

from bisect import bisect_left


def fill(starts: list[int], indices: list[int]) -> tuple[list[list[int]], list[list[int]]]:
    """Rows above and below the diagonal of each column of the factors, ascending.

    Whatever the numbers are: no entry counts on cancellation. `starts` and `indices` are the CSC
    pattern of the matrix whose pivots are its diagonal, in order. A column holds what is reached
    from its entries through the columns before; of these only the rows down to the first one that
    is symmetric have to be followed (Eisenstat & Liu, SIAM J. Matrix Anal. Appl. 13 (1992) 202).
    """
    size = len(starts) - 1
    above: list[list[int]] = []
    below: list[list[int]] = []
    followed: list[list[int]] = []
    pruned = [False] * size
    seen = [-1] * size
    for j in range(size):
        seen[j] = j
        reached = []
        todo = indices[starts[j] : starts[j + 1]]
        while todo:
            row = todo.pop()
            if seen[row] != j:
                seen[row] = j
                reached.append(row)
                if row < j:
                    todo.extend(followed[row])
        reached.sort()
        split = bisect_left(reached, j)
        above.append(reached[:split])
        below.append(reached[split:])
        followed.append(below[j])
        for k in above[j]:
            if not pruned[k]:
                place = bisect_left(below[k], j)
                if place < len(below[k]) and below[k][place] == j:
                    followed[k] = below[k][: place + 1]
                    pruned[k] = True
    return above, below
