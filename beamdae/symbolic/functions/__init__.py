"""CasADi functions: their instructions, lookups in tables, and calls with numpy arrays.

May import: native.
To extend: operations of CasADi without machine code belong in `row_programs`.
"""
