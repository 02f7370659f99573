# SPDX-License-Identifier: GPL-3.0-or-later
"""Replacement of a scene's materials by changed copies, for as long as something is rendered."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager

import bpy

from ..scene_access.overrides import changed, put_back_when_saved
from ..scene_access.temporary import temporary

_MOST_LAYERS = 1024  # transparent ones that a ray passes, as Cycles' panel offers


@contextmanager
def replaced_materials(
    scene: bpy.types.Scene, names: Sequence[str], change: Callable[[bpy.types.Material, str], None]
) -> Iterator[None]:
    """Use changed copies of materials, by full name, within the block; all is as before after it.

    change: is called with a copy and the material's name. Rays pass as many transparent layers as Cycles lets them.
    """
    library = {material.name_full: material for material in bpy.data.materials}
    with ExitStack() as stack:
        stack.enter_context(changed(scene.cycles, transparent_max_bounces=_MOST_LAYERS))
        for name in names:
            stack.enter_context(_replaced(library[name], change))
        yield


@contextmanager
def _replaced(material: bpy.types.Material, change: Callable[[bpy.types.Material, str], None]) -> Iterator[None]:
    """Put a changed copy in the place of a material, wherever it is used."""
    with temporary(material.copy(), material) as copy:
        change(copy, material.name)

        def use() -> None:
            material.user_remap(copy)

        def put_back() -> None:
            copy.user_remap(material)

        use()
        try:
            with put_back_when_saved(put_back, use):
                yield
        finally:
            put_back()
