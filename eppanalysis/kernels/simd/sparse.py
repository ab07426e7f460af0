"""Compiled: sums of the rows of a matrix of which most is zero, eight numbers at a time.

Of each eight columns only the rows are kept that are not zero there: `entries` (k, 8) one after the other, their `rows`
in the matrix, and of each eight columns where they end (`ends`). Four of them go beside each other, so that each eight
columns have a multiple of four, the last ones zero.
"""

from numba.core import cgutils, types

from eppanalysis.kernels.simd.vectors import VECTOR_SIZE, _Code, intrinsic


def _write_sparse_sum(code, start, first, scale, out, of_entries):
    """scale * (start + weights @ a matrix kept so) into out; the arrays by the numbers of the arguments."""
    builder, begin = code.builder, cgutils.alloca_once_value(code.builder, code.integer(0))
    (entries, rows, ends, factor), (target, (length,)) = (code.array(first + k)[0] for k in range(4)), code.array(out)
    with code.blocks(length) as (column, block):
        sums = [code.zeros() for _ in range(4)]
        if start is not None:
            builder.store(code.eight(code.array(start)[0], column), sums[0])
        end = code.number(ends, block)
        fours = cgutils.for_range_slice(builder, builder.load(begin), end, code.integer(4), intp=end.type)
        with fours as (place, _):
            for r in range(4):
                entry = builder.add(place, code.integer(r))
                values = of_entries(code.eight(entries, builder.mul(entry, code.integer(VECTOR_SIZE))))
                weight = code.spread(code.number(factor, code.number(rows, entry)))
                builder.store(code.add_product(weight, values, builder.load(sums[r])), sums[r])
        builder.store(end, begin)
        a, b, c, d = (builder.load(part) for part in sums)
        both = builder.fadd(builder.fadd(a, b), builder.fadd(c, d))
        code.keep(builder.fmul(code.spread(scale), both), target, column)
    return code.context.get_dummy_value()


@intrinsic
def sparse_sum(typingctx, entries, rows, ends, weights, scale, out):
    """out = scale * weights @ a matrix kept so."""

    def write(context, builder, signature, args):
        return _write_sparse_sum(_Code(context, builder, signature, args), None, 0, args[4], 5, lambda a: a)

    return types.none(entries, rows, ends, weights, types.float64, out), write


@intrinsic
def sparse_sum_from(typingctx, start, entries, rows, ends, weights, scale, out):
    """out = scale * (start + weights @ a matrix kept so)."""

    def write(context, builder, signature, args):
        return _write_sparse_sum(_Code(context, builder, signature, args), 0, 1, args[5], 6, lambda a: a)

    return types.none(start, entries, rows, ends, weights, types.float64, out), write


@intrinsic
def sparse_size_sum(typingctx, entries, rows, ends, weights, scale, out):
    """out = scale * weights @ the absolute values of a matrix kept so."""

    def write(context, builder, signature, args):
        code = _Code(context, builder, signature, args)
        return _write_sparse_sum(code, None, 0, args[4], 5, code.size)

    return types.none(entries, rows, ends, weights, types.float64, out), write
