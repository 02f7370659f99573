# SPDX-License-Identifier: GPL-3.0-or-later
"""What was computed for each scene, and whether it still fits the scene. Held in memory, dropped with the file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import bpy
from bpy.app.handlers import persistent

from ..patchnet_addon.errors import SettingError
from .own import is_own

if TYPE_CHECKING:
    from ..patchnet_addon.codes.coded_octree import CodedOctree
    from ..patchnet_addon.octree.leaf_levels import LeafLevels
    from ..patchnet_addon.octree.octree import Octree

NO_VOXELS = "There are no voxels yet: run Voxelize first"
NO_CODES = "There are no codes yet: run Precompute Codes first"

_LIGHTS = {"none": "none, the surface's own colour", "cycles": "Cycles", "two-lights": "Two Lights"}
# Object types whose change changes the surface that was voxelized.
_SURFACE_TYPES = frozenset({"MESH", "CURVE", "CURVES", "SURFACE", "META", "FONT", "EMPTY", "POINTCLOUD", "VOLUME"})


@dataclass
class SceneResult:
    """The steps that are done for a scene; codes are None until they were computed.

    scope: which objects were voxelized, "SELECTED" or "VISIBLE".
    layout: levels of the leaves, None where all are on the deepest.
    light: "none" while the octree shows the surface's own colour, else the light that was baked.
    stale: the steps whose input changed since: "surface", "light".
    summary: lines for the panel, written when a step ends, so that drawing computes nothing.
    """

    octree: Octree
    scope: str
    layout: LeafLevels | None = None
    light: str = "none"
    coded: CodedOctree | None = None
    lookahead_share: float | None = None
    stale: set[str] = field(default_factory=set)
    summary: list[str] = field(default_factory=list)


_results: dict[int, SceneResult] = {}
_quiet = 0
_before_undo: tuple[frozenset[object], frozenset[object]] = (frozenset(), frozenset())
_own_step = False  # the next update comes from undoing or redoing a step of ours


def result_of(scene: bpy.types.Scene) -> SceneResult | None:
    """What is there for `scene`."""
    return _results.get(scene.session_uid)


def voxels_of(scene: bpy.types.Scene) -> SceneResult:
    """The result of `scene`; raises SettingError with what to do if there is none."""
    result = result_of(scene)
    if result is None:
        raise SettingError(NO_VOXELS)
    return result


def codes_of(scene: bpy.types.Scene) -> CodedOctree:
    """The codes of `scene`; raises SettingError with what to do if there are none."""
    coded = voxels_of(scene).coded
    if coded is None:
        raise SettingError(NO_CODES)
    return coded


def keep(scene: bpy.types.Scene, result: SceneResult) -> None:
    """Replace what is there for `scene`."""
    result.summary = _summary(result)
    _results[scene.session_uid] = result


def forget(scene: bpy.types.Scene) -> None:
    """Free the memory that results of `scene` take."""
    _results.pop(scene.session_uid, None)


@contextmanager
def quiet() -> Iterator[None]:
    """Changes within the block are our own and are undone in it: they make nothing stale."""
    global _quiet
    _quiet += 1
    try:
        yield
    finally:
        bpy.context.view_layer.update()
        _quiet -= 1


def _summary(result: SceneResult) -> list[str]:
    octree = result.octree
    lines = [
        f"Depth {'up to ' if result.layout else ''}{octree.depth}, voxel side {octree.grid.voxel_world:.4g}",
        f"{octree.leaf_count:,} voxels, {octree.node_count:,} nodes",
        f"{(octree.nbytes + (result.coded.nbytes if result.coded else 0)) / 2**20:.1f} MiB",
        f"Light: {_LIGHTS.get(result.light, result.light)}",
    ]
    if result.coded is not None:
        lines.append(f"{len(result.coded.codes):,} codes")
    if result.lookahead_share is not None:
        lines.append(f"Look-ahead on {result.lookahead_share:.1%} of hits")
    return lines


@persistent
def _on_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Mark results stale whose surface or light was changed by the person."""
    global _own_step
    if _own_step:
        _own_step = False
        return
    result = _results.get(scene.session_uid)
    if result is None or _quiet:
        return
    for update in depsgraph.updates:
        item = update.id
        if is_own(item):
            continue
        if isinstance(item, bpy.types.Object):
            moved = update.is_updated_geometry or update.is_updated_transform
            if moved and item.type in _SURFACE_TYPES:
                result.stale.add("surface")
            elif item.type in {"LIGHT", "LIGHT_PROBE"}:
                result.stale.add("light")
        elif isinstance(item, bpy.types.Material | bpy.types.World | bpy.types.Light):
            result.stale.add("light")


def _placed(scene: bpy.types.Scene) -> tuple[frozenset[object], frozenset[object]]:
    """What stands where in a scene: objects that show our results, and all others."""
    places: dict[bool, set[object]] = {True: set(), False: set()}
    for item in scene.objects:
        data = item.data.session_uid if item.data else 0
        matrix = tuple(value for row in item.matrix_basis for value in row)  # the world's is not known right after undo
        places[is_own(item)].add((item.session_uid, data, matrix))
    return frozenset(places[True]), frozenset(places[False])


@persistent
def _on_undo_pre(scene: bpy.types.Scene, _depsgraph: object = None) -> None:
    global _before_undo
    _before_undo = _placed(scene)


@persistent
def _on_undo_post(scene: bpy.types.Scene, _depsgraph: object = None) -> None:
    """After undo Blender reports every object as changed. Where only ours came, went or moved, nothing is stale."""
    global _own_step
    own, others = _placed(scene)
    _own_step = own != _before_undo[0] and others == _before_undo[1]


@persistent
def _on_load(_path: str) -> None:
    _results.clear()


def _handlers() -> list[tuple[list[Any], Callable[..., None]]]:
    """Blender's lists of handlers, and what we add to them."""
    lists = bpy.app.handlers
    return [
        (lists.depsgraph_update_post, _on_change),
        (lists.undo_pre, _on_undo_pre),
        (lists.redo_pre, _on_undo_pre),
        (lists.undo_post, _on_undo_post),
        (lists.redo_post, _on_undo_post),
        (lists.load_post, _on_load),
    ]


def register() -> None:
    """Listen to changes of scenes."""
    for handlers, function in _handlers():
        handlers.append(function)


def unregister() -> None:
    """Stop listening and free all results."""
    for handlers, function in reversed(_handlers()):
        handlers.remove(function)
    _results.clear()
