"""CasADi functions: lookups in tables, and calls with numpy arrays.

May import: native.
To extend: an operation of CasADi that a lookup or a derivative needs has a module of its own.
"""
