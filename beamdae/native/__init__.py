"""Machine code by LLVM: kernels of elements, loops of integrators, and the cache of both.

A plain Python loop becomes machine code as follows. A loop is a function of one dataclass whose
fields are numbers, arrays, and nested dataclasses or named tuples of these (`loops`). It operates
on whole arrays through `loop_functions`, which use numpy in plain Python. `CompiledLoop` lays the
dataclass out as a table of numbers and addresses, looks for the machine code of the loop in the
cache and among the objects installed with the package (`object_cache`, `prebuilt_objects`,
`object_code`), and otherwise has numba translate the loop to LLVM IR (`numba_compiler`; `structs`
defines the numba type of the table, `overloads` the compiled `loop_functions`) and LLVM compile
that (`llvm`). CasADi functions skip numba: `lane_code` writes their instructions as IR with one
copy per vector lane, and `lane_kernels` makes them callable. If any of this fails, loops run as
plain Python and kernels in CasADi's virtual machine.

May import: linear, errors. No mechanics here; numba is imported only while a loop is compiled.
To extend: add array operations of loops to `loop_functions` and their compiled versions to
`overloads`.
"""
