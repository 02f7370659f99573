# SPDX-License-Identifier: GPL-3.0-or-later
"""Light linking of a bake: its mesh is lit by the lamps that shine on the objects it stands for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import bpy

from ...scene.light_links import Links, emitters, members
from ...scene_access.overrides import changed
from ...scene_access.temporary import temporary


@contextmanager
def lit_as(target: bpy.types.Object, links: Links) -> Iterator[None]:
    """Make `target` a member of receiver collections within the block.

    The collections stay as they are, they may be linked from another file: their lamps get copies with one more member.
    """
    states = dict(links)
    with ExitStack() as stack:
        for emitter in list(emitters()):
            collection = emitter.light_linking.receiver_collection
            if collection.name_full in states:
                copy = stack.enter_context(_with_member(collection, target, states[collection.name_full]))
                stack.enter_context(changed(emitter.light_linking, receiver_collection=copy))
        yield


@contextmanager
def _with_member(
    collection: bpy.types.Collection, item: bpy.types.Object, state: str
) -> Iterator[bpy.types.Collection]:
    with temporary(bpy.data.collections.new("PatchNet Bake"), collection) as copy:
        for member, its_state in (members(collection) | {item: state}).items():
            copy.objects.link(member)
            copy.collection_objects[-1].light_linking.link_state = its_state
        yield copy
