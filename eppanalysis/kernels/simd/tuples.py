"""Named tuples of arrays that kernels take by address.

Numba hands a named tuple over by value: some four hundred words for the tables of a model, written out in every
function and at every call, which took most of the time to compile the engine. A class marked with `by_address` is
handed over as the address of a frame instead, in which each array is its own address and its shape; reading a field
makes the array from these. All arrays must be contiguous, of floats or whole numbers of 64 bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from typing import Any, TypeVar

import numpy as np
from llvmlite import ir
from numba.core import cgutils, config, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    intrinsic,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)

Tuple = TypeVar("Tuple", bound=type)

_WORD = ir.IntType(64)
_BYTES = 8
_NUMBERS = {"f": types.float64, "i": types.int64}


class Arrays(types.Type):
    """Numba's type of such a tuple: for each field its name, the letter of its numbers, its dimensions."""

    def __init__(self, title: str, fields: tuple[tuple[str, str, int], ...]) -> None:
        self.title, self.fields = title, fields
        self.arrays = {name: types.Array(_NUMBERS[letter], ndim, "C") for name, letter, ndim in fields}
        #: Where each array begins in the frame, and the frame's length.
        *self.places, self.words = accumulate((1 + ndim for _, _, ndim in fields), initial=0)
        super().__init__(f"{title}({''.join(f'{letter}{ndim}' for _, letter, ndim in fields)})")

    def __reduce__(self) -> Any:
        return Arrays, (self.title, self.fields)

    def of_rows(self) -> Arrays:
        """Type of the tuple of the arrays' rows."""
        return Arrays(self.title, tuple((name, letter, ndim - 1) for name, letter, ndim in self.fields))


def by_address(cls: Tuple) -> Tuple:
    """Mark a named tuple of arrays: kernels take it by address."""

    @typeof_impl.register(cls)
    def kind(value: Any, context: Any) -> Arrays:
        return Arrays(cls.__name__, _fields_of(value))

    return cls


def _fields_of(value: Any) -> tuple[tuple[str, str, int], ...]:
    """The fields of a tuple as its type has them.

    Raises
    ------
    TypeError
        For arrays that kernels do not take by address.
    """
    cls = type(value)
    for name, a in zip(cls._fields, value, strict=True):
        if a.dtype not in ("f8", "i8") or not a.flags.c_contiguous:
            raise TypeError(f"{cls.__name__}.{name} is no contiguous array of floats or whole numbers of 64 bits.")
    return tuple((name, a.dtype.kind, a.ndim) for name, a in zip(cls._fields, value, strict=True))


@register_model(Arrays)
class _Address(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _WORD.as_pointer())


@infer_getattr
class _Fields(AttributeTemplate):
    key = Arrays

    def generic_resolve(self, kind, name):
        return kind.arrays.get(name)


def _word(builder, frame, place):
    return builder.gep(frame, [_WORD(place)], inbounds=True)


@lower_getattr_generic(Arrays)
def _read(context, builder, kind, frame, name):
    """The array of a field, from its words."""
    from numba.np.arrayobj import populate_array

    array_kind, first = kind.arrays[name], kind.places[list(kind.arrays).index(name)]
    array = context.make_array(array_kind)(context, builder)
    address, *shape = (builder.load(_word(builder, frame, first + i)) for i in range(1 + array_kind.ndim))
    strides = [_WORD(_BYTES)]
    for length in shape[:0:-1]:
        strides.insert(0, builder.mul(strides[0], length))
    data = builder.inttoptr(address, array.data.type)
    populate_array(array, data=data, shape=shape, strides=strides[: len(shape)], itemsize=_BYTES, meminfo=None)
    return array._getvalue()


@unbox(Arrays)
def _unbox(kind, value, c):
    """The frame of a named tuple, on the stack of the call from Python; the tuple keeps the arrays."""
    builder = c.builder
    frame = cgutils.alloca_once(builder, _WORD, size=_WORD(kind.words))
    failed = cgutils.false_bit
    for k, array_kind in enumerate(kind.arrays.values()):
        native = c.unbox(array_kind, c.pyapi.tuple_getitem(value, k))
        array = c.context.make_array(array_kind)(c.context, builder, native.value)
        words = builder.ptrtoint(array.data, _WORD), *cgutils.unpack_tuple(builder, array.shape)
        for i, word in enumerate(words):
            builder.store(word, _word(builder, frame, kind.places[k] + i))
        failed = builder.or_(failed, native.is_error)
        if c.context.enable_nrt:
            c.context.nrt.decref(builder, array_kind, native.value)
    return NativeValue(frame, is_error=failed)


def _plain_rows(stack, k):
    """The tuple of the rows k of all arrays, where numba is switched off."""
    return type(stack)(*(a[k] for a in stack))


@intrinsic
def rows(typingctx, stack, k):
    """The tuple of the rows k of all arrays, in one frame for each place in a kernel where this is written."""
    kind = stack.of_rows()

    def write(context, builder, signature, args):
        frame = cgutils.alloca_once(builder, _WORD, size=_WORD(kind.words))
        for (_, _, ndim), whole, first in zip(kind.fields, stack.places, kind.places, strict=True):
            shape = [builder.load(_word(builder, args[0], whole + 2 + i)) for i in range(ndim)]
            skipped = builder.mul(args[1], _WORD(_BYTES))
            for length in shape:
                skipped = builder.mul(skipped, length)
            address = builder.add(builder.load(_word(builder, args[0], whole)), skipped)
            for i, word in enumerate((address, *shape)):
                builder.store(word, _word(builder, frame, first + i))
        return frame

    return kind(stack, types.intp), write


def frames_of(tuples: Sequence[Any]) -> Any:
    """Frames of tuples of one type, one a row, for :func:`tuple_at`; valid for as long as the tuples live.

    Their arrays may be of any lengths: a kernel that takes many tuples so is compiled once, however many there are.

    Raises
    ------
    TypeError
        If the types differ.
    """
    if len({(type(one), _fields_of(one)) for one in tuples}) > 1:
        raise TypeError("Tuples of several types have no common frame.")
    if config.DISABLE_JIT:
        return tuple(tuples)
    words = [[w for a in one for w in (a.__array_interface__["data"][0], *a.shape)] for one in tuples]
    return np.array(words, np.int64)


def _plain_tuple_at(like, frames, k):
    """The tuple of row k, where numba is switched off."""
    return frames[k]


@intrinsic
def tuple_at(typingctx, like, frames, k):
    """The tuple in row k of the frames of tuples of the type of `like`."""

    def write(context, builder, signature, args):
        array = context.make_array(signature.args[1])(context, builder, args[1])
        return builder.gep(array.data, [builder.mul(args[2], _WORD(like.words))], inbounds=True)

    return like(like, frames, types.intp), write


if config.DISABLE_JIT:
    rows, tuple_at = _plain_rows, _plain_tuple_at
