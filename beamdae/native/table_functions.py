"""Functions that read single rows of tables, for CasADi and as LLVM IR.

Kernels call them instead of evaluating all rows, so that neither compilation nor evaluation takes
longer for long tables. `beamdae.symbolic.table_lookups` differentiates them.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca

FIND = "table_find"
PICK = "table_pick"
SPREAD = "table_spread"

_MAX_FUNCTIONS = 256


def _define(name: str, inputs: list[Any], output: Any, is_linear: bool = True) -> ca.Function:
    # Rows are constant in derivatives. CasADi would not set derivatives of a function without any
    # differentiable input.
    options: dict[str, Any] = {"never_inline": True, "is_diff_in": [False, is_linear]}
    return ca.Function(name, inputs, [output], options)


@lru_cache(_MAX_FUNCTIONS)
def find_function(count: int) -> ca.Function:
    """Return the function (x, axis) of the last row k < count - 1 with axis[k] <= x, or 0."""
    x, axis = ca.MX.sym("x"), ca.MX.sym("axis", count)
    return _define(FIND, [x, axis], ca.low(axis, x, {"lookup_mode": "binary"}), False)


@lru_cache(_MAX_FUNCTIONS)
def pick_function(count: int, width: int) -> ca.Function:
    """Return the function (k, numbers) of `width` of `count` numbers, starting with number k."""
    row, numbers = ca.MX.sym("row"), ca.MX.sym("numbers", count)
    return _define(PICK, [row, numbers], ca.vertcat(*(numbers[row + i] for i in range(width))))


@lru_cache(_MAX_FUNCTIONS)
def spread_function(count: int, width: int) -> ca.Function:
    """Return the function (k, values) of `count` zeros, with the values starting at number k."""
    row, values, numbers = ca.MX.sym("row"), ca.MX.sym("values", width), ca.MX.zeros(count)
    for i in range(width):
        numbers.nz[row + i] = values[i]
    return _define(SPREAD, [row, values], numbers)


# %rows is the first row of the table; rows are `padded` doubles apart. The bisection is that of
# `casadi_low`, so that axes which do not ascend give the same row, too.
_LANE_FUNCTIONS = """
define internal {T} @lanes.find(ptr %rows, i64 %padded, i64 %n, {T} %x) noinline nounwind {{
begin:
%last = sub i64 %n, 1
%lastbutone = sub i64 %n, 2
br label %lane
lane:
%l = phi i64 [0, %begin], [%l.next, %done]
%r = phi {T} [zeroinitializer, %begin], [%r.next, %done]
%z = extractelement {T} %x, i64 %l
%p = getelementptr double, ptr %rows, i64 %l
%p.second = getelementptr double, ptr %p, i64 %padded
%second = load double, ptr %p.second, align 8
%isbefore = fcmp olt double %z, %second
br i1 %isbefore, label %done, label %after
after:
%o.last = mul i64 %padded, %last
%p.last = getelementptr double, ptr %p, i64 %o.last
%final = load double, ptr %p.last, align 8
%isafter = fcmp ogt double %z, %final
br i1 %isafter, label %done, label %bisect
bisect:
%start = phi i64 [0, %after], [%start.next, %bisect]
%stop = phi i64 [%last, %after], [%stop.next, %bisect]
%sum = add i64 %start, %stop
%pivot = lshr i64 %sum, 1
%o = mul i64 %padded, %pivot
%p.pivot = getelementptr double, ptr %p, i64 %o
%value = load double, ptr %p.pivot, align 8
%isless = fcmp olt double %z, %value
%start.next = select i1 %isless, i64 %start, i64 %pivot
%stop.next = select i1 %isless, i64 %pivot, i64 %stop
%bound = select i1 %isless, i64 %stop, i64 %start
%isfound = icmp eq i64 %pivot, %bound
br i1 %isfound, label %done, label %bisect
done:
%k = phi i64 [0, %lane], [%lastbutone, %after], [%pivot, %bisect]
%kd = sitofp i64 %k to double
%r.next = insertelement {T} %r, double %kd, i64 %l
%l.next = add i64 %l, 1
%more = icmp slt i64 %l.next, {W}
br i1 %more, label %lane, label %end
end:
ret {T} %r.next
}}
define internal {T} @lanes.pick(ptr %rows, i64 %padded, {T} %k) noinline nounwind {{
begin:
br label %lane
lane:
%l = phi i64 [0, %begin], [%l.next, %lane]
%r = phi {T} [zeroinitializer, %begin], [%r.next, %lane]
%kd = extractelement {T} %k, i64 %l
%ki = fptosi double %kd to i64
%o = mul i64 %padded, %ki
%i = add i64 %o, %l
%p = getelementptr double, ptr %rows, i64 %i
%value = load double, ptr %p, align 8
%r.next = insertelement {T} %r, double %value, i64 %l
%l.next = add i64 %l, 1
%more = icmp slt i64 %l.next, {W}
br i1 %more, label %lane, label %end
end:
ret {T} %r.next
}}
define internal void @lanes.clear(ptr %rows, i64 %padded, i64 %n) noinline nounwind {{
begin:
br label %row
row:
%k = phi i64 [0, %begin], [%k.next, %row]
%o = mul i64 %padded, %k
%p = getelementptr double, ptr %rows, i64 %o
store {T} zeroinitializer, ptr %p, align 8
%k.next = add i64 %k, 1
%more = icmp slt i64 %k.next, %n
br i1 %more, label %row, label %end
end:
ret void
}}
define internal void @lanes.put(ptr %rows, i64 %padded, {T} %k, {T} %x) noinline nounwind {{
begin:
br label %lane
lane:
%l = phi i64 [0, %begin], [%l.next, %lane]
%kd = extractelement {T} %k, i64 %l
%ki = fptosi double %kd to i64
%o = mul i64 %padded, %ki
%i = add i64 %o, %l
%p = getelementptr double, ptr %rows, i64 %i
%value = extractelement {T} %x, i64 %l
store double %value, ptr %p, align 8
%l.next = add i64 %l, 1
%more = icmp slt i64 %l.next, {W}
br i1 %more, label %lane, label %end
end:
ret void
}}"""


def write_lane_functions(vector: str, width: int) -> str:
    """Return the IR of the functions for vectors of the LLVM type `vector` with `width` lanes."""
    return _LANE_FUNCTIONS.format(T=vector, W=width)
