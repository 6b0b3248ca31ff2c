"""Linear systems of fixed sparsity: orders of elimination, pivots, factors."""
