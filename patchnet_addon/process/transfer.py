# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages between the two processes: pickles, whose arrays lie in shared memory and are never copied a second time.

Objects of dataclasses with `eq=False` are equal only to themselves, so they stay themselves: Blender's process numbers
each when it sends it, sends it once, and gets the same object back. A `Remote` stays in the engine.
"""

from __future__ import annotations

import io
import itertools
import pickle
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from ..runtime.errors import EngineGoneError
from .segments import Place, Segment, new_segment, opened, segment_of

Value = TypeVar("Value")
REPORT, RESULT, ERROR = "report", "result", "error"  # kinds of the engine's messages
_LEAST_BYTES = 2048  # of an array in shared memory
_ALIGNMENT = 64


class Remote(Generic[Value]):
    """Object that stays in the process that computes: its `value` there, and only a handle in Blender's.

    Functions that get one as an argument of `computed` get its value.
    """

    def __init__(self, value: Value) -> None:
        self.value = value


def called(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """Call a function with the values of remotes among its arguments."""
    return function(*(argument.value if isinstance(argument, Remote) else argument for argument in arguments))


class _Handle(Remote[Any]):
    """Remote in Blender's process; the engine frees the object when the handle is gone."""

    def __init__(self, number: int, exchange: BlenderExchange) -> None:
        self.number, self.exchange = number, exchange
        weakref.finalize(self, exchange.gone.append, number).atexit = False


class Message(NamedTuple):
    """Pickle, the place of the arrays that are new in it, and objects that the receiver gets first, by number."""

    payload: bytes
    arrays: Place | None
    objects: list[tuple[int, bytes]]


class Packed(NamedTuple):
    """Bytes of a message. held: segments that must live until it is read. numbers: of the objects that it brings."""

    data: bytes
    held: list[Any]
    numbers: list[int]


class _Exchange(ABC):
    """One side's knowledge of the objects that both have."""

    @abstractmethod
    def number_to_send(self, thing: Any) -> tuple[int, bool] | None:
        """Number of an object with an identity, and whether the receiver has it; None to send it without one."""

    @abstractmethod
    def found(self, number: int) -> Any:
        """Object of a number that the other side has sent."""

    def packed(self, thing: Any) -> Packed:
        """Message with a content."""
        packing = _Packing(self)
        payload = packing.pickled(thing)
        segment = packing.segment()
        message = Message(payload, None if segment is None else segment.place, packing.objects)
        numbers = [number for number, _ in packing.objects]
        return Packed(pickle.dumps(tuple(message)), [segment, *packing.segments], numbers)

    def unpacked(self, data: bytes) -> Any:
        """Content of a message."""
        message = Message(*pickle.loads(data))
        arrays = None if message.arrays is None else opened(message.arrays)
        return self._content(message, arrays)

    def _content(self, message: Message, arrays: Segment | None) -> Any:
        return _Unpickler(message.payload, arrays, self).load()


class BlenderExchange(_Exchange):
    """Blender's side. gone: numbers of objects that ended here since the last message; sent: those that are there."""

    _all = itertools.count(1)

    def __init__(self) -> None:
        self.gone: list[int] = []
        self.sent: set[int] = set()
        self._objects: weakref.WeakValueDictionary[int, Any] = weakref.WeakValueDictionary()
        self._numbers: weakref.WeakKeyDictionary[Any, int] = weakref.WeakKeyDictionary()

    def number_to_send(self, thing: Any) -> tuple[int, bool] | None:
        """As in the base; a new object gets a number. Raises EngineGoneError for a remote of an engine that ended."""
        if isinstance(thing, _Handle):
            if thing.exchange is not self:
                raise EngineGoneError("PatchNet's engine has ended meanwhile: run this again")
            return thing.number, True
        number = self._numbers.get(thing)
        if number is None:
            number = self._numbers[thing] = next(self._all)
            self._objects[number] = thing
            weakref.finalize(thing, self.gone.append, number).atexit = False
        return number, number in self.sent

    def found(self, number: int) -> Any:
        """As in the base."""
        if number < 0 and number not in self._objects:
            self._objects[number] = handle = _Handle(number, self)
            return handle
        return self._objects[number]

    def take_gone(self) -> list[int]:
        """Numbers of objects that the engine need not keep any longer."""
        gone = [self.gone.pop() for _ in range(len(self.gone))]
        self.sent.difference_update(gone)
        return gone


class EngineExchange(_Exchange):
    """The engine's side, which keeps what Blender's process has numbered, and remotes, until they are gone there."""

    def __init__(self) -> None:
        self._objects: dict[int, Any] = {}
        self._numbers: dict[int, int] = {}  # by id
        self._remotes = itertools.count(-1, -1)

    def number_to_send(self, thing: Any) -> tuple[int, bool] | None:
        """As in the base; only remotes get numbers here."""
        number = self._numbers.get(id(thing))
        if number is None and isinstance(thing, Remote):
            self._keep(number := next(self._remotes), thing)
        return None if number is None else (number, True)

    def found(self, number: int) -> Any:
        """As in the base."""
        return self._objects[number]

    def _content(self, message: Message, arrays: Segment | None) -> Any:
        for number, payload in message.objects:
            self._keep(number, _Unpickler(payload, arrays, self).load())
        return super()._content(message, arrays)

    def _keep(self, number: int, thing: Any) -> None:
        """Keep an object; one that two messages bring is kept once."""
        if number not in self._objects:
            self._objects[number] = thing
            self._numbers[id(thing)] = number

    def drop(self, numbers: list[int]) -> None:
        """Drop objects that are gone in Blender's process."""
        for number in numbers:
            thing = self._objects.pop(number, None)
            self._numbers.pop(id(thing), None)


class _Packing:
    """Pickling of one message."""

    def __init__(self, exchange: _Exchange) -> None:
        self.exchange = exchange
        self.objects: list[tuple[int, bytes]] = []
        self.segments: list[Any] = []  # that are there already
        self._arrays: list[tuple[int, np.ndarray]] = []
        self._offsets: dict[int, int] = {}  # of arrays, by id
        self._numbered: set[int] = set()
        self._size = 0

    def pickled(self, thing: Any) -> bytes:
        file = io.BytesIO()
        _Pickler(file, self).dump(thing)
        return file.getvalue()

    def segment(self) -> Any:
        """New segment with all arrays that were in none; None if there are none."""
        if not self._arrays:
            return None
        segment = new_segment(self._size)
        whole = np.frombuffer(segment, np.uint8)
        for offset, array in self._arrays:
            np.copyto(whole[offset : offset + array.nbytes].view(array.dtype).reshape(array.shape), array)
        return segment

    def array_reference(self, array: np.ndarray) -> tuple[Any, ...] | None:
        """What the receiver finds an array by; None for a small one, which is in the message itself."""
        place = segment_of(array)
        if place is not None:
            self.segments.append(place[0])
            return "segment", place[0].place, place[1], array.dtype, array.shape, array.strides
        if array.nbytes < _LEAST_BYTES or array.dtype.hasobject:
            return None
        offset = self._offsets.get(id(array))
        if offset is None:
            offset = self._offsets[id(array)] = -(-self._size // _ALIGNMENT) * _ALIGNMENT
            self._arrays.append((offset, array))
            self._size = offset + array.nbytes
        return "array", offset, array.dtype, array.shape

    def number(self, thing: Any) -> int | None:
        """Number of an object, which comes with the message if the receiver does not have it."""
        found = self.exchange.number_to_send(thing)
        if found is None:
            return None
        number, is_there = found
        if not is_there and number not in self._numbered:
            self._numbered.add(number)
            self.objects.append((number, self.pickled(_Whole(thing))))
        return number


class _Whole:
    """Object to pickle itself, not its number."""

    def __init__(self, thing: Any) -> None:
        self.thing = thing


class _Pickler(pickle.Pickler):
    def __init__(self, file: io.BytesIO, packing: _Packing) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self._packing = packing

    def persistent_id(self, thing: Any) -> Any:
        if isinstance(thing, np.ndarray):
            return self._packing.array_reference(thing)
        if isinstance(thing, Remote) or _has_identity(thing):
            number = self._packing.number(thing)
            return None if number is None else ("object", number)
        return None

    def reducer_override(self, thing: Any) -> Any:
        if isinstance(thing, _Whole):
            return _reduced(thing.thing)
        return _reduced(thing) if is_dataclass(thing) and not isinstance(thing, type) else NotImplemented


def _has_identity(thing: Any) -> bool:
    kind = getattr(type(thing), "__dataclass_params__", None)
    return kind is not None and not kind.eq


def _reduced(thing: Any) -> Any:
    """A dataclass is sent by its fields, without what it has computed from them."""
    return _made, (type(thing), {item.name: getattr(thing, item.name) for item in fields(thing)})


def _made(kind: type, values: dict[str, Any]) -> Any:
    thing: Any = object.__new__(kind)
    thing.__dict__.update(values)
    return thing


class _Unpickler(pickle.Unpickler):
    def __init__(self, payload: bytes, arrays: Any, exchange: _Exchange) -> None:
        super().__init__(io.BytesIO(payload))
        self._whole = None if arrays is None else np.frombuffer(arrays, np.uint8)
        self._known: dict[int, np.ndarray] = {}
        self._exchange = exchange

    def persistent_load(self, reference: Any) -> Any:
        kind, *values = reference
        if kind == "object":
            return self._exchange.found(values[0])
        if kind == "segment":
            place, offset, dtype, shape, strides = values
            whole = np.frombuffer(opened(place), np.uint8)
            return np.ndarray(shape, dtype, whole, offset, strides)
        offset, dtype, shape = values
        assert self._whole is not None
        if offset not in self._known:
            self._known[offset] = np.ndarray(shape, dtype, self._whole, offset)
        return self._known[offset]
