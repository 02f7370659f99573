# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene setup of a bake: a copy of the scene with its own settings, and the image, mesh and object in it.

The user's scene is not changed, because Blender can write quit.blend, autosaves and undo steps at any time. A copy is
cheap, since Blender evaluates the scene for each bake anyway.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from typing import Any

import bpy
import numpy as np

from ....patchnet_addon.runtime.errors import SceneError
from ....patchnet_addon.surface.scene_mesh import Links
from ...scene.light_links import emitters, members
from ...scene_access.overrides import changed
from ...scene_access.own import check_own_scene
from ...scene_access.temporary import scene_copy, sync_view_layers, temporary
from ...scene_access.window_job import window_is_alive
from ..daylight import daylight
from ..scene_copy import UNBIASED

_NAME = "PatchNet Bake"
# Side of a tile in texels. Cycles polls for a stop between two passes over a tile, and a pass over a whole page takes a
# CPU many seconds, too long for a window. Small tiles take up to 20 % longer, so in background a page is one tile. The
# result is the same.
_TILE_SIDE_IN_WINDOW, _TILE_SIDE = 256, 4096
# In a window: about 5 s of two cores in the demo scene, of which reading the scene takes 15 %.
_LEAST_PATHS, _PATHS_A_TRIANGLE = 1 << 20, 3


@contextmanager
def lit_as(target: bpy.types.Object, links: Links) -> Iterator[None]:
    """Make `target` a member of receiver collections within the block.

    The collections, which may be linked from another file, stay unchanged: lamps get copies of them.
    """
    states = dict(links)
    with ExitStack() as stack:
        for emitter in list(emitters()):
            collection = emitter.light_linking.receiver_collection
            if collection.name_full in states:
                copy = stack.enter_context(temporary(bpy.data.collections.new(_NAME), collection))
                for member, state in (members(collection) | {target: states[collection.name_full]}).items():
                    copy.objects.link(member)
                    copy.collection_objects[-1].light_linking.link_state = state
                stack.enter_context(changed(emitter.light_linking, receiver_collection=copy))
        yield


@contextmanager
def bake_scene(context: bpy.types.Context, *, with_daylight: bool) -> Iterator[tuple[bpy.types.Scene, str]]:
    """Copy the scene for a bake; the second value is the name of the current view layer.

    with_daylight: with our sun and sky. Raises SceneError without Cycles, and as `check_own_scene`.
    """
    check_own_scene(context.scene)
    if not hasattr(context.scene, "cycles"):
        raise SceneError("The Cycles render engine is disabled: enable its add-on, or choose Light: Two Lights")
    with scene_copy(context.scene) as scene, daylight(scene) if with_daylight else nullcontext():
        yield scene, context.view_layer.name


def set_cycles(scene: bpy.types.Scene, samples: int, seed: int, on_gpu: bool) -> None:
    """Set up Cycles for a bake in a scene of ours.

    Hair is rendered as ribbons, which do not shadow surfaces inside of them as tubes do (`scene/strands.py`). The first
    path of each texel is skipped: Cycles starts it at the texel's centre whatever the seed.
    """
    values: dict[str, Any] = UNBIASED | {
        "samples": samples + 1, "use_sample_subset": True, "sample_offset": 1, "sample_subset_length": samples,
        "seed": seed, "device": "GPU" if on_gpu else "CPU",
    }  # fmt: skip
    if not on_gpu:  # a GPU bakes large tiles fast
        values |= {"use_auto_tile": True, "tile_size": tile_side()}
    scene.render.engine, scene.cycles_curves.shape = "CYCLES", "RIBBONS"
    for name, value in values.items():
        setattr(scene.cycles, name, value)


def most_paths(triangle_count: int) -> float:
    """Most paths of one bake call: short calls in a window, which a render or an undo has to wait for."""
    return max(_LEAST_PATHS, _PATHS_A_TRIANGLE * triangle_count) if window_is_alive() else np.inf


def tile_side() -> int:
    """Side of a tile on a processor, in texels."""
    return _TILE_SIDE_IN_WINDOW if window_is_alive() else _TILE_SIDE


def bake_image(size: tuple[int, int]) -> AbstractContextManager[bpy.types.Image]:
    """Temporary image of a width and height."""
    return temporary(bpy.data.images.new(_NAME, *size, alpha=True, float_buffer=True, is_data=True))


@contextmanager
def bake_object(scene: bpy.types.Scene, mesh: bpy.types.Mesh) -> Iterator[bpy.types.Object]:
    """Object of `mesh` in a scene of ours that is invisible to all rays.

    A twin at the same place makes the mesh an instance, which rays skip as a whole. Cycles would merge a mesh with one
    user into the BVH of all others, where each ray tests its triangles, just above those of the surface.
    """
    with temporary(bpy.data.objects.new(_NAME, mesh)) as item, temporary(bpy.data.objects.new(_NAME, mesh)) as twin:
        for each in (item, twin):
            scene.collection.objects.link(each)
            # Cycles removes objects that are invisible to all rays, so volume scatter stays on.
            for ray in ("camera", "diffuse", "glossy", "transmission", "shadow"):
                setattr(each, f"visible_{ray}", False)
        sync_view_layers()  # the bake needs the object in its layer
        yield item
