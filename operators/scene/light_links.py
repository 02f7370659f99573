# SPDX-License-Identifier: GPL-3.0-or-later
"""Light linking: which lamps and emitters shine on an object, as membership in their receiver collections."""

from __future__ import annotations

import bpy

from ...patchnet_addon.surface.scene_mesh import Links


def emitters() -> list[bpy.types.Object]:
    """Objects with a receiver collection."""
    return [item for item in bpy.data.objects if item.light_linking.receiver_collection]


def members(collection: bpy.types.Collection) -> dict[bpy.types.Object, str]:
    """Objects of a receiver collection and their states; objects of a child have the state of the child."""
    result: dict[bpy.types.Object, str] = {}
    for child, entry in zip(collection.children, collection.collection_children, strict=True):
        result |= dict.fromkeys(child.all_objects, entry.light_linking.link_state)
    for item, entry in zip(collection.objects, collection.collection_objects, strict=True):
        result[item] = entry.light_linking.link_state
    return result


class LightLinks:
    """Memberships of placed objects; distinct ones are numbered."""

    def __init__(self) -> None:
        self.distinct: dict[Links, int] = {}
        self._of: dict[str, set[tuple[str, str]]] = {}
        for collection in {emitter.light_linking.receiver_collection for emitter in emitters()}:
            for item, state in members(collection).items():
                self._of.setdefault(item.name_full, set()).add((collection.name_full, state))

    def number(self, instance: bpy.types.DepsgraphObjectInstance) -> int:
        """Number of an instance's memberships; its instancer's precede those of the object itself, as in Cycles."""
        links: Links = frozenset()
        if self._of:
            owners = (instance.parent, instance.object) if instance.is_instance else (instance.object,)
            found = (self._of.get(item.original.name_full) for item in owners)
            links = frozenset(next((each for each in found if each), ()))
        return self.distinct.setdefault(links, len(self.distinct))
