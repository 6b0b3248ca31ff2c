"""Controllers: sampled laws in Python, and formulas of states."""
