# SPDX-License-Identifier: GPL-3.0-or-later
"""World behind a viewport's picture: one colour, or a map that a timer renders. Drawing of pictures and messages."""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy
import numpy as np

from ...patchnet_addon.image.background import BLACK
from ...patchnet_addon.image.cube_map import CubeMap
from ...patchnet_addon.octree.octree import Octree
from ..cycles.background import SeenWorld, seen_world
from ..cycles.daylight import has_light
from ..overlay import paint
from ..scene.fingerprint import world_hash
from ..schema.values import CYCLES
from ..session.scene_session import session_of
from ..session.world_maps import ask_for_map

_SCALE, _LEAST_SCALE = 1.4, 0.75  # of messages, over that of the overlay's texts
_MARGIN_PX = 20
World = np.ndarray | CubeMap | None
_KINDS = ("WORLD", "NODETREE", "IMAGE", "TEXTURE", "LIGHT")


def draw_picture(
    texture: Any, region: bpy.types.Region, engine: bpy.types.RenderEngine, scene: bpy.types.Scene
) -> None:
    """Fill a region with a scene-linear texture, premultiplied by alpha; Blender applies its view transform."""
    import gpu  # it needs a window
    from gpu_extras.presets import draw_texture_2d

    gpu.state.blend_set("ALPHA_PREMULT")
    engine.bind_display_space_shader(scene)
    draw_texture_2d(texture, (0, 0), region.width, region.height)
    engine.unbind_display_space_shader()
    gpu.state.blend_set("NONE")


def draw_message(region: bpy.types.Region, text: str) -> None:
    """Draw a sentence in the middle of the region."""
    scale, room = _SCALE * bpy.context.preferences.system.ui_scale, region.width - 2 * _MARGIN_PX
    scale = max(min(scale, scale * room / paint.text_size(text, scale)[0]), _LEAST_SCALE)
    width, _ = paint.text_size(text, scale)
    paint.write(text, max((region.width - width) / 2, _MARGIN_PX), region.height / 2, scale)


class WorldBehind(NamedTuple):
    """World to draw, see `ViewportPreview`; identity: a key, equal for worlds that look alike."""

    world: World
    identity: Any


class ViewportWorld:
    """World of a viewport, evaluated again after Blender reports a change of its data."""

    def __init__(self) -> None:
        self._key = ""
        self._known: tuple[Any, ...] | None = None
        self._asked = ""

    def updated(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Note a change of the scene."""
        if any(depsgraph.id_type_updated(kind) for kind in _KINDS):
            self.forget()

    def forget(self) -> None:
        """Evaluate the world again at the next drawing."""
        self._known = None

    def behind(self, depsgraph: bpy.types.Depsgraph, octree: Octree) -> WorldBehind:
        """World behind `octree` now; until a new map is ready, black or the former map."""
        scene = depsgraph.scene
        if scene.render.film_transparent:
            return WorldBehind(None, "transparent")
        seen = self._seen(depsgraph, octree)
        if seen.color is not None:
            return WorldBehind(seen.color, seen.color.tobytes())
        kept = session_of(scene.original).world
        if (kept is None or kept.key != self._key) and self._asked != self._key:
            self._asked = self._key
            ask_for_map(scene.original)
        if kept is None or kept.map is None:
            return WorldBehind(BLACK, "no map")
        return WorldBehind(kept.map, kept.key)

    def _seen(self, depsgraph: bpy.types.Depsgraph, octree: Octree) -> SeenWorld:
        """World of the scene; updates the key of a world that varies, but only after a change."""
        scene = depsgraph.scene
        state = id(octree), scene.original.session_uid, scene.world and scene.world.original.session_uid
        if self._known is None or self._known[0] != state:
            baked = octree.provenance.get("light") == CYCLES
            daylit = baked and not has_light(depsgraph)
            self._known = state, daylit
            seen = seen_world(depsgraph, baked=baked, daylight=daylit)
            self._key = world_hash(seen.world) if seen.world is not None else ""
            self._asked = "" if seen.color is not None else self._asked
            return seen
        return seen_world(depsgraph, baked=self._known[1], daylight=self._known[1])
