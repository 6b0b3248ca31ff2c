"""Machine code of kernels by LLVM, and the cache of it.

`instructions` reads and evaluates the instructions of a CasADi function, `lane_code` writes them as
LLVM IR, with one copy per vector lane, `point_programs` writes sums over points as loops, `llvm`
compiles and loads IR, and `lane_kernels` makes the result callable. `object_code`
looks for objects in the cache and among those installed with the package. If any of this fails,
kernels run in CasADi's virtual machine.

May import: linear, errors. No mechanics here.
"""
