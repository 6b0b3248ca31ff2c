"""Machine code by LLVM: kernels across elements, and the cache and loader of any such code.

May import: errors. Knows no mechanics; `lanes` and `operations` alone know CasADi.
Next: a compiled loop is an `objects.Source` of LLVM IR, as the kernels of `lanes` are.
"""
