"""Compiled: sums of rows, eight numbers at a time.

The states of a loop are few. Loops over so few numbers a compiler leaves to scalar code, as the numbers that remain
after it has made room for many; here the products are spelled out as vectors of eight (which a machine with shorter
ones halves). Measured with `benchmarks/paired.py`: the elbow's run of six seconds takes 0.83 ms of processor
time with them, and 3.0 ms with the same sums as plain loops.

All rows that come here have a length that is a multiple of eight (`padded`), zero beyond what they hold.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, config, types
from numba.extending import intrinsic as compiled_intrinsic, register_jitable

from eppanalysis.arrays import Array
from eppanalysis.kernels.simd.plain import PLAIN, VECTOR_SIZE

_VECTOR = ir.VectorType(ir.DoubleType(), VECTOR_SIZE)
_BITS = ir.VectorType(ir.IntType(1), VECTOR_SIZE)


def intrinsic(function: Any) -> Any:
    """Numba's decorator of the same name; where numba is switched off, the function of that name in plain numpy."""
    return PLAIN[function.__name__] if config.DISABLE_JIT else compiled_intrinsic(function)


@register_jitable
def padded(n):
    """Length of a row that holds n numbers."""
    return (n + VECTOR_SIZE - 1) // VECTOR_SIZE * VECTOR_SIZE


def aligned(*shapes: tuple[int, ...]) -> list[Array]:
    """Arrays of zeros that begin where eight numbers do: to fetch eight across such a border takes twice as long.

    All are parts of one, as most of the time would go into asking where each begins.
    """
    sizes = [math.prod(shape) for shape in shapes]
    wide = np.zeros(VECTOR_SIZE + sum(size + -size % VECTOR_SIZE for size in sizes))
    first = -wide.ctypes.data % (wide.itemsize * VECTOR_SIZE) // wide.itemsize
    found = []
    for shape, size in zip(shapes, sizes, strict=True):
        found.append(wide[first : first + size].reshape(shape))
        first += size + -size % VECTOR_SIZE
    return found


def aligned_by_name(shapes: dict[str, tuple[int, ...]]) -> dict[str, Array]:
    """As `aligned`, with names."""
    return dict(zip(shapes, aligned(*shapes.values()), strict=True))


class _Code:
    """Writes the instructions of one intrinsic."""

    def __init__(self, context: Any, builder: Any, signature: Any, args: Any) -> None:
        self.context, self.builder, self.signature, self.args = context, builder, signature, args

    def array(self, k: int) -> tuple[Any, list[Any]]:
        """Address of argument k's numbers, and its shape."""
        array = self.context.make_array(self.signature.args[k])(self.context, self.builder, self.args[k])
        return array.data, cgutils.unpack_tuple(self.builder, array.shape)

    def integer(self, value: int) -> Any:
        return self.context.get_constant(types.intp, value)

    def zeros(self) -> Any:
        """A place for eight sums, set to zero."""
        place = cgutils.alloca_once(self.builder, _VECTOR)
        self.builder.store(ir.Constant(_VECTOR, [0.0] * VECTOR_SIZE), place)
        return place

    def bits(self, value: int) -> Any:
        """A place for a bit for each number of a vector, all set to one value."""
        place = cgutils.alloca_once(self.builder, _BITS)
        self.builder.store(ir.Constant(_BITS, [value] * VECTOR_SIZE), place)
        return place

    def compare(self, how: str, place: Any, pattern: int) -> Any:
        """Whether all bits of a place together are, or are not, a pattern."""
        kind = ir.IntType(VECTOR_SIZE)
        whole = self.builder.bitcast(self.builder.load(place), kind)
        return self.builder.icmp_unsigned(how, whole, ir.Constant(kind, pattern))

    def spread(self, number: Any) -> Any:
        """A vector of the same number throughout."""
        one = self.builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), number, ir.Constant(ir.IntType(32), 0))
        return self.builder.shuffle_vector(
            one, one, ir.Constant(ir.VectorType(ir.IntType(32), VECTOR_SIZE), [0] * VECTOR_SIZE)
        )

    def number(self, address: Any, place: Any) -> Any:
        return self.builder.load(self.builder.gep(address, [place]))

    def place(self, address: Any, place: Any) -> Any:
        """Address of eight numbers."""
        return self.builder.bitcast(self.builder.gep(address, [place]), _VECTOR.as_pointer())

    def eight(self, address: Any, place: Any) -> Any:
        return self.builder.load(self.place(address, place), align=8)

    def keep(self, eight: Any, address: Any, place: Any) -> None:
        self.builder.store(eight, self.place(address, place), align=8)

    def add_product(self, a: Any, b: Any, c: Any) -> Any:
        """a * b + c, rounded twice: not fused, on machines that could, either."""
        return self.builder.fadd(self.builder.fmul(a, b), c)

    def sum(self, eight: Any) -> Any:
        """Sum of the numbers of a vector."""
        width = VECTOR_SIZE
        while width > 1:
            width //= 2
            kind = ir.VectorType(ir.IntType(32), width)
            lower, upper = (
                self.builder.shuffle_vector(eight, eight, ir.Constant(kind, list(range(first, first + width))))
                for first in (0, width)
            )
            eight = self.builder.fadd(lower, upper)
        return self.builder.extract_element(eight, ir.Constant(ir.IntType(32), 0))

    def size(self, a: Any) -> Any:
        """Absolute values."""
        kind = ir.FunctionType(_VECTOR, [_VECTOR])
        name = f"llvm.fabs.v{VECTOR_SIZE}f64"
        return self.builder.call(cgutils.get_or_insert_function(self.builder.module, kind, name), [a])

    def blocks(self, length: Any) -> Any:
        """Loop over the beginnings of eight numbers each; a context."""
        return cgutils.for_range_slice(
            self.builder, self.integer(0), length, self.integer(VECTOR_SIZE), intp=length.type
        )


def _write_row_sum(code, start, rows, weights, scale, out):
    """scale * (start + weights @ rows) into out; the arrays by the numbers of the arguments, `start` may be None."""
    builder = code.builder
    source, (_, width) = code.array(rows)
    factor, (count,) = code.array(weights)
    target, (length,) = code.array(out)
    with code.blocks(length) as (column, _):
        # Even and odd rows apart: one sum alone would wait for its own last addition at every row. `plain` adds in this
        # order.
        sums = code.zeros(), code.zeros()
        if start is not None:
            builder.store(code.eight(code.array(start)[0], column), sums[0])
        with code.blocks(count) as (first, _):
            for r in range(VECTOR_SIZE):
                row = builder.add(first, code.integer(r))
                values = code.eight(source, builder.add(builder.mul(row, width), column))
                total = sums[r % 2]
                builder.store(
                    code.add_product(code.spread(code.number(factor, row)), values, builder.load(total)), total
                )
        both = builder.fadd(builder.load(sums[0]), builder.load(sums[1]))
        code.keep(builder.fmul(code.spread(scale), both), target, column)
    return code.context.get_dummy_value()


@intrinsic
def row_sum(typingctx, rows, weights, scale, out):  # numba reads no annotations
    """out = scale * weights @ rows, with as many columns as `out` has."""

    def write(context, builder, signature, args):
        return _write_row_sum(_Code(context, builder, signature, args), None, 0, 1, args[2], 3)

    return types.none(rows, weights, types.float64, out), write


@intrinsic
def row_sum_from(typingctx, start, rows, weights, scale, out):
    """out = scale * (start + weights @ rows)."""

    def write(context, builder, signature, args):
        return _write_row_sum(_Code(context, builder, signature, args), 0, 1, 2, args[3], 4)

    return types.none(start, rows, weights, types.float64, out), write


def _write_each(code, rows, expression):
    """Set the row that is the first argument from its old values and those of the other rows, place by place."""
    addresses = [code.array(k)[0] for k in range(rows)]
    with code.blocks(code.array(0)[1][0]) as (place, _):
        code.keep(expression(*(code.eight(a, place) for a in addresses)), addresses[0], place)
    return code.context.get_dummy_value()


@intrinsic
def add(typingctx, out, a):
    """out += a."""

    def write(context, builder, signature, args):
        return _write_each(_Code(context, builder, signature, args), 2, builder.fadd)

    return types.none(out, a), write


@intrinsic
def take(typingctx, out, a):
    """out = a."""

    def write(context, builder, signature, args):
        return _write_each(_Code(context, builder, signature, args), 2, lambda _, a: a)

    return types.none(out, a), write


@intrinsic
def take_sizes(typingctx, out, a):
    """out = abs(a)."""

    def write(context, builder, signature, args):
        code = _Code(context, builder, signature, args)
        return _write_each(code, 2, lambda _, a: code.size(a))

    return types.none(out, a), write


@intrinsic
def add_sizes(typingctx, out, a, scale):
    """out += scale * abs(a)."""

    def write(context, builder, signature, args):
        code = _Code(context, builder, signature, args)
        scale = code.spread(args[2])
        return _write_each(code, 2, lambda out, a: code.add_product(scale, code.size(a), out))

    return types.none(out, a, types.float64), write


@intrinsic
def take_larger(typingctx, out, a, b):
    """out = max(abs(a), b)."""

    def write(context, builder, signature, args):
        code = _Code(context, builder, signature, args)

        def larger(_, a, b):
            size = code.size(a)
            return builder.select(builder.fcmp_ordered(">", size, b), size, b)

        return _write_each(code, 3, larger)

    return types.none(out, a, b), write


def _write_extreme(how, context, builder, signature, args):
    def chosen(out, a):
        return builder.select(builder.fcmp_ordered(how, a, out), a, out)

    return _write_each(_Code(context, builder, signature, args), 2, chosen)


@intrinsic
def lower_to(typingctx, out, a):
    """out = min(out, a)."""
    return types.none(out, a), partial(_write_extreme, "<")


@intrinsic
def raise_to(typingctx, out, a):
    """out = max(out, a)."""
    return types.none(out, a), partial(_write_extreme, ">")


@intrinsic
def cubics_below(typingctx, start, start_rate, step, end_rate, third, noise, stray):
    """Whether all curves that stray from a cubic by so much at most stay below zero; not, where one is not a number.

    The cubics are known by value and rate at start and end (start + step), `third` is a third of the step's length, and
    what strays from them vanishes at both ends with its rate: it counts in the middle one of five Bernstein
    coefficients. A curve that starts within its noise of zero starts on zero.
    """

    def write(context, builder, signature, args):
        code = _Code(context, builder, signature, args)
        addresses = [code.array(k)[0] for k in (0, 1, 2, 3, 5, 6)]
        nothing, half, more, beyond = (ir.Constant(_VECTOR, [v] * VECTOR_SIZE) for v in (0.0, 0.5, 0.75, 8.0 / 3.0))
        third = code.spread(args[4])
        below = code.bits(1)
        with code.blocks(code.array(0)[1][0]) as (place, _):
            a, da, step, db, noise, stray = (code.eight(address, place) for address in addresses)
            level = builder.fsub(nothing, noise)
            b, rise, fall = builder.fadd(a, step), builder.fmul(third, da), builder.fmul(third, db)
            on_zero = builder.fcmp_ordered(">", a, level)
            first = builder.select(on_zero, nothing, a)
            middle = builder.fmul(half, builder.fadd(builder.fadd(first, rise), builder.fsub(b, fall)))
            coefficients = (
                builder.fadd(first, builder.fmul(more, rise)),
                builder.fadd(middle, builder.fmul(beyond, stray)),
                builder.fsub(b, builder.fmul(more, fall)),
                b,
            )
            # Ordered comparisons are false of what is not a number: it proves nothing.
            low = builder.fcmp_ordered("<=", a, noise)
            for coefficient in coefficients:
                low = builder.and_(low, builder.fcmp_ordered("<=", coefficient, level))
            builder.store(builder.and_(builder.load(below), low), below)
        return code.compare("==", below, 2**VECTOR_SIZE - 1)

    return types.boolean(start, start_rate, step, end_rate, types.float64, noise, stray), write


def _write_sum(code, gather):
    """Sum over two rows, the first arguments; `gather` takes eight of each and the sums so far to the next sums."""
    left, (length,) = code.array(0)
    right, _ = code.array(1)
    total = code.zeros()
    with code.blocks(length) as (place, _):
        a, b = code.eight(left, place), code.eight(right, place)
        code.builder.store(gather(a, b, code.builder.load(total)), total)
    return code.sum(code.builder.load(total))


@intrinsic
def dot(typingctx, a, b):
    """Sum of a * b."""

    def write(context, builder, signature, args):
        code = _Code(context, builder, signature, args)
        return _write_sum(code, code.add_product)

    return types.float64(a, b), write


@intrinsic
def rises(typingctx, a, b):
    """Sum of the positive ones among the products a * b."""

    def write(context, builder, signature, args):
        nothing = ir.Constant(_VECTOR, [0.0] * VECTOR_SIZE)

        def gather(a, b, total):
            product = builder.fmul(a, b)
            positive = builder.select(builder.fcmp_ordered(">", product, nothing), product, nothing)
            return builder.fadd(total, positive)

        return _write_sum(_Code(context, builder, signature, args), gather)

    return types.float64(a, b), write


@intrinsic
def value_and_slope(typingctx, terms, u):
    """Sum of terms[k] * u**k, and of k * terms[k] * u**k."""

    def write(context, builder, signature, args):
        code = _Code(context, builder, signature, args)
        source, (length,) = code.array(0)
        u = args[1]
        powers, whole = ir.Constant(_VECTOR, [1.0] * VECTOR_SIZE), u
        for k in range(3):
            # 1 where bit k of the place is not set, u**(2**k) where it is.
            ends = ir.Constant(ir.VectorType(ir.DoubleType(), 2), [1.0, 1.0])
            ends = builder.insert_element(ends, whole, ir.Constant(ir.IntType(32), 1))
            places = ir.Constant(ir.VectorType(ir.IntType(32), VECTOR_SIZE), [i >> k & 1 for i in range(VECTOR_SIZE)])
            powers = builder.fmul(powers, builder.shuffle_vector(ends, ends, places))
            whole = builder.fmul(whole, whole)
        step = code.spread(whole)
        value, slope = code.zeros(), code.zeros()
        with code.blocks(length) as (done, _):
            place = builder.sub(builder.sub(length, code.integer(VECTOR_SIZE)), done)
            now = code.eight(source, place)
            first = code.spread(builder.sitofp(place, ir.DoubleType()))
            counts = builder.fadd(first, ir.Constant(_VECTOR, [float(i) for i in range(VECTOR_SIZE)]))
            builder.store(code.add_product(builder.load(value), step, now), value)
            builder.store(code.add_product(builder.load(slope), step, builder.fmul(now, counts)), slope)
        sums = [code.sum(builder.fmul(builder.load(part), powers)) for part in (value, slope)]
        return context.make_tuple(builder, signature.return_type, sums)

    return types.UniTuple(types.float64, 2)(terms, types.float64), write


@intrinsic
def polynomial(typingctx, rows, last, u, out):
    """out = sum of rows[k] * u**k up to k = last (2 or more), its even and its odd terms beside each other."""

    def write(context, builder, signature, args):
        code = _Code(context, builder, signature, args)
        source, (_, width) = code.array(0)
        target, (length,) = code.array(3)
        last, u = args[1], code.spread(args[2])
        square = builder.fmul(u, u)
        turns = builder.lshr(builder.sub(last, code.integer(1)), code.integer(1))
        even = builder.icmp_signed("==", builder.and_(last, code.integer(1)), code.integer(0))
        with code.blocks(length) as (column, _):

            def row(k, column=column):
                return code.eight(source, builder.add(builder.mul(k, width), column))

            upper = cgutils.alloca_once(builder, _VECTOR)
            lower = cgutils.alloca_once(builder, _VECTOR)
            builder.store(row(last), upper)
            builder.store(row(builder.sub(last, code.integer(1))), lower)
            with cgutils.for_range(builder, turns) as turn:
                k = builder.sub(last, builder.mul(code.integer(2), builder.add(turn.index, code.integer(1))))
                builder.store(code.add_product(builder.load(upper), square, row(k)), upper)
                k = builder.sub(k, code.integer(1))
                builder.store(code.add_product(builder.load(lower), square, row(k)), lower)
            a, b = builder.load(upper), builder.load(lower)
            # Of an odd order the last two terms are left; of an even one, the first row is still missing.
            of_odd = code.add_product(a, u, b)
            of_even = code.add_product(b, u, code.add_product(a, square, row(code.integer(0))))
            code.keep(builder.select(even, of_even, of_odd), target, column)
        return context.get_dummy_value()

    return types.none(rows, types.intp, types.float64, out), write


@intrinsic
def size_sum(typingctx, rows, last, out):
    """out = sum of the absolute values of rows[1] to rows[last]."""

    def write(context, builder, signature, args):
        code = _Code(context, builder, signature, args)
        source, (_, width) = code.array(0)
        target, (length,) = code.array(2)
        with code.blocks(length) as (column, _):
            total = code.zeros()
            with cgutils.for_range(builder, args[1]) as turn:
                row = builder.add(turn.index, code.integer(1))
                values = code.eight(source, builder.add(builder.mul(row, width), column))
                builder.store(builder.fadd(builder.load(total), code.size(values)), total)
            code.keep(builder.load(total), target, column)
        return context.get_dummy_value()

    return types.none(rows, types.intp, out), write


@intrinsic
def any_above(typingctx, row, scale, limits):
    """Whether the absolute value of any number of a row, times a positive scale, is above its limit, or is none."""

    def write(context, builder, signature, args):
        code = _Code(context, builder, signature, args)
        values, (length,) = code.array(0)
        bounds, _ = code.array(2)
        scale = code.spread(args[1])
        found = code.bits(0)
        with code.blocks(length) as (place, _):
            size = builder.fmul(scale, code.size(code.eight(values, place)))
            # Unordered: what is not a number counts as above.
            above = builder.fcmp_unordered(">", size, code.eight(bounds, place))
            builder.store(builder.or_(builder.load(found), above), found)
        return code.compare("!=", found, 0)

    return types.boolean(row, types.float64, limits), write
