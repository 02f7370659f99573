# SPDX-License-Identifier: GPL-3.0-or-later
"""Temporary changes of settings by a job, which are undone afterwards and in files saved meanwhile.

Data-blocks of a job do not need this: they are `temporary`, and Blender never saves them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import bpy
from bpy.app.handlers import persistent

from .own import quiet

Act = Callable[[], object]
_changes: list[tuple[Act, Act]] = []  # functions that undo and redo each change, in order


@contextmanager
def put_back_when_saved(put_back: Act, make_again: Act) -> Iterator[None]:
    """Undo a change of the block while a file is saved."""
    change = put_back, make_again
    _changes.append(change)
    try:
        yield
    finally:
        _changes.remove(change)


@contextmanager
def changed(owner: bpy.types.bpy_struct, **values: Any) -> Iterator[None]:
    """Set properties of `owner` that this Blender has; restore them afterwards, and in files saved meanwhile."""
    names = [name for name in values if hasattr(owner, name)]
    before = {name: (owner.is_property_set(name), getattr(owner, name)) for name in names}
    find = _finder(owner)

    def change() -> None:
        owner = find()
        for name in names:
            setattr(owner, name, values[name])

    def put_back() -> None:
        owner = find()
        for name in reversed(names):
            was_set, value = before[name]
            setattr(owner, name, value)
            if not was_set:
                owner.property_unset(name)

    try:
        change()
        with put_back_when_saved(put_back, change):
            yield
    finally:
        with suppress(ReferenceError):  # another file may have been opened meanwhile
            put_back()


def _finder(owner: bpy.types.bpy_struct) -> Callable[[], Any]:
    """Function that finds `owner` again: Blender detects deleted data-blocks, but no deleted settings in them."""
    block = owner.id_data
    if block is None or block == owner:
        return lambda: owner
    path = owner.path_from_id()
    return lambda: block.path_resolve(path)


@persistent
def _before_save(*_: object) -> None:
    with quiet():
        for put_back, _make in reversed(_changes):
            with suppress(ReferenceError):  # removed meanwhile
                put_back()


@persistent
def _after_save(*_: object) -> None:
    with quiet():
        for _put_back, make_again in _changes:
            with suppress(ReferenceError):
                make_again()


HANDLERS = (("save_pre", _before_save), ("save_post", _after_save), ("save_post_fail", _after_save))
