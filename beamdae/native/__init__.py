"""Machine code by LLVM: kernels across elements, loops of integrators, their cache and loader.

May import: errors. Knows no mechanics; `lanes` and `operations` alone know CasADi, `machine` alone
drives LLVM, and `numba_compiler`, `overloads`, `structs` are imported only to compile a loop.
Next: what another loop does with whole arrays is a function of `vectors`, and one of `overloads`.
"""
