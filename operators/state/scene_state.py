# SPDX-License-Identifier: GPL-3.0-or-later
"""Hashes of the data-blocks that voxels and their light depend on, to tell what changed from what was only reported.

Blender reports far more than changes: after an undo everything, and the lamps whenever its dependency graph is built
anew, as when a window closes or a collection is added. The state is taken of the user's own data, not of what Blender
evaluates from it, so that it is the same in every process that opened the same file.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import NamedTuple

import bpy
import numpy as np

from ..scene_access.frames import fcurves
from ..scene_access.own import is_own
from .digest import Digest, names, values_of
from .gloss_view import place_of_gloss

SURFACE, LIGHT, VIEW = "surface", "light", "view"
Key = tuple[str, str]  # type and full name of a data-block
MEMBERS: Key = ("", "scene")

_LIGHT_TYPES = (bpy.types.Light, bpy.types.LightProbe, bpy.types.World, bpy.types.Material, bpy.types.Image,
                bpy.types.Texture)  # fmt: skip
_LAMPS = frozenset({"LIGHT", "LIGHT_PROBE"})
_KINDS_OF_OBJECTS = {"CAMERA": "Camera object", "LIGHT": "Light object", "LIGHT_PROBE": "Light object"}
_WORDS = {"Material": "material", "World": "world", "Image": "image", "Camera": "camera", "Camera object": "camera",
          "Light object": "lamp"}  # fmt: skip
_PASSED_OVER = (bpy.types.Scene, bpy.types.Library, bpy.types.Action, bpy.types.WorkSpace)
# Whose contents `Digest` knows.
_WHOLE = (bpy.types.Image, bpy.types.NodeTree, bpy.types.Text, bpy.types.Collection, bpy.types.Curve)
_SKIPPED_OF_DATA = names("materials texspace_location texspace_size is_editmode")
# Of hair and points: what `Digest.geometry` hashes as arrays, far faster.
_SKIPPED_OF_STRANDS = _SKIPPED_OF_DATA | names("points curves position_data curve_offset_data normals attributes")
_OF_OBJECTS = (
    "type", "parent_type", "parent_bone", "instance_type", "instance_faces_scale", "use_instance_faces_scale",
    "use_instance_vertices_rotation", "show_instancer_for_render", "hide_render", "hide_viewport", "visible_camera",
    "is_holdout", "is_shadow_catcher", "pass_index",
)  # fmt: skip
_OF_OBJECTS_LIT = (
    "visible_diffuse", "visible_glossy", "visible_transmission", "visible_volume_scatter", "visible_shadow",
)  # fmt: skip
_OF_RENDERS = ("use_simplify", "simplify_subdivision_render", "simplify_child_particles_render", "hair_type")
_OF_CYCLES = (
    "max_bounces", "diffuse_bounces", "glossy_bounces", "transmission_bounces", "volume_bounces",
    "transparent_max_bounces", "caustics_reflective", "caustics_refractive", "blur_glossy", "use_fast_gi",
    "fast_gi_method", "ao_bounces_render", "light_sampling_threshold", "use_light_tree",
)  # fmt: skip
_REFERRED = ("parent", "instance_collection", "data")
# Modifiers whose result may differ between frames without any keys.
MOVES_BY_ITSELF = frozenset(
    {"CLOTH", "SOFT_BODY", "FLUID", "OCEAN", "WAVE", "DYNAMIC_PAINT", "PARTICLE_SYSTEM", "NODES", "MESH_CACHE",
     "MESH_SEQUENCE_CACHE", "BUILD", "EXPLODE"}
)  # fmt: skip
_POSITION = "position"
_KEYFRAME_VALUES = ("co", "handle_left", "handle_right")


class _Hashes(NamedTuple):
    """Hashes of one data-block: what makes the surface, what lights it and how it looks, and what cameras see."""

    surface: str = ""
    light: str = ""
    view: str = ""


@dataclass(frozen=True)
class SceneState:
    """State of a scene at some moment.

    entries: hashes by data-block. layer: name of the view layer. frame: the present one if something is animated.
    seconds: what it took to find out. gloss_from: where the camera stands that gloss is seen from, empty where none is.
    """

    entries: dict[Key, _Hashes]
    layer: str
    frame: int | None
    seconds: float
    gloss_from: str = ""

    def identity(self, *more: object) -> str:
        """32 hex digits over all of it but the cameras, and over `more`."""
        digest = Digest()
        lit = sorted((key, hashes.surface, hashes.light) for key, hashes in self.entries.items() if any(hashes[:2]))
        digest.text(lit, self.layer, self.frame, *more)
        return digest.hexdigest()

    def differences(self, now: SceneState) -> dict[str, list[str]]:
        """List what changed, in words, for the surface and for the light."""
        found: dict[str, list[str]] = {SURFACE: [], LIGHT: []}
        for key in dict.fromkeys((*self.entries, *now.entries)):
            before, after = (state.entries.get(key, _Hashes()) for state in (self, now))
            for step, texts in found.items():
                if getattr(before, step) != getattr(after, step):
                    texts.append(changed_text(key, step=step))
        return found

    def seen_from_camera(self, scene: bpy.types.Scene) -> SceneState:
        """State of a scene whose gloss is seen from its active camera, where that stands now."""
        return replace(self, gloss_from=place_of_gloss(scene))

    def gloss_has_moved(self, scene: bpy.types.Scene) -> bool:
        """Return whether gloss is seen from a camera, and the active one stands elsewhere now."""
        return bool(self.gloss_from) and place_of_gloss(scene) != self.gloss_from

    def changes_of(self, block: bpy.types.ID) -> list[str]:
        """Steps for which an original data-block is not what it was; none if they do not depend on it."""
        before = self.entries.get(key_of(block))
        if before is None or _passed_over(block):
            return []
        now = _Reader().hashes(block)
        return [step for step in _Hashes._fields if getattr(before, step) != getattr(now, step)]

    def fits_layer(self, scene: bpy.types.Scene, layer: str) -> bool:
        """Return whether a view layer of the scene shows what the one shows that this is the state of."""
        if layer == self.layer:
            return True
        return _members(scene, _layer(scene, layer)) == _members(scene, _layer(scene, self.layer))

    def changes_of_members(self, scene: bpy.types.Scene) -> list[str]:
        """Steps for which the scene is not what it was by its objects and settings."""
        before, now = self.entries[MEMBERS], _members(scene, _layer(scene, self.layer))
        return [step for step in _Hashes._fields if getattr(before, step) != getattr(now, step)]


def scene_state(scene: bpy.types.Scene, layer: str = "") -> SceneState:
    """Take the state of a scene without objects that show results, and of all that it refers to.

    layer: name of the view layer that is looked at, by default the context's.
    """
    begun = time.perf_counter()
    view_layer = _layer(scene, layer or _present_layer(scene))
    reader = _Reader()
    entries = {MEMBERS: _members(scene, view_layer)}
    waiting: list[bpy.types.ID] = [*scene.objects, *([scene.world] if scene.world else [])]
    while waiting:
        block = waiting.pop()
        key = key_of(block)
        if key not in entries and not _passed_over(block) and not isinstance(block, _PASSED_OVER):
            entries[key] = reader.hashes(block)
            waiting += reader.taken_references()
    frame = scene.frame_current if reader.animated else None
    return SceneState(entries, view_layer.name, frame, time.perf_counter() - begun)


def key_of(block: bpy.types.ID) -> Key:
    """Key that a data-block is found by."""
    kind = type(block).__name__
    if isinstance(block, bpy.types.Object):
        kind = _KINDS_OF_OBJECTS.get(block.type, kind)
    return kind, block.name_full


def changed_text(key: Key, verb: str = "changed", step: str = SURFACE) -> str:
    """Words for a change of a data-block that matters to a step."""
    kind, name = key
    if key == MEMBERS:
        return "objects were added, removed, shown or hidden" if step == SURFACE else "world or render settings changed"
    word = _WORDS.get(kind, "lamp" if kind.endswith("Light") else "")
    return f"{word} '{name}' {verb}".lstrip()


def _present_layer(scene: bpy.types.Scene) -> str:
    layer = bpy.context.view_layer
    return str(layer.name) if layer is not None and bpy.context.scene == scene else ""


def _layer(scene: bpy.types.Scene, name: str) -> bpy.types.ViewLayer:
    return scene.view_layers.get(name) or scene.view_layers[0]


def _members(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> _Hashes:
    """Hash which objects a view layer shows and what its collections leave out, and how Cycles renders the scene."""
    shown: set[tuple[str, tuple[bool, ...]]] = set()
    stack = [(layer.layer_collection, (False,) * 6)]
    while stack:
        item, above = stack.pop()
        collection = item.collection
        own = (item.exclude, item.holdout, item.indirect_only, item.hide_viewport)
        flags = tuple(map(max, above, (*own, collection.hide_render, collection.hide_viewport)))
        shown.update((each.name_full, flags) for each in collection.objects if _counts(each))
        stack.extend((child, flags) for child in item.children)
    hidden = sorted(each.name_full for each in scene.objects if _counts(each) and each.hide_get(view_layer=layer))
    surface, light = Digest(), Digest()
    surface.text(sorted(shown), hidden, layer.use_strand)
    world = scene.world
    if world is None or not _passed_over(world):
        light.text(world and world.name_full)
    for owner, keys in ((scene.render, _OF_RENDERS), (getattr(scene, "cycles", None), _OF_CYCLES)):
        light.text(*(getattr(owner, key, None) for key in keys))
    for key in ("material_override", "world_override"):
        block = getattr(layer, key, None)
        light.text(block and block.name_full)
    return _Hashes(surface.hexdigest(), light.hexdigest())


def _counts(item: bpy.types.Object) -> bool:
    return not is_camera(item) and not _passed_over(item)


def _passed_over(block: bpy.types.ID) -> bool:
    """Return whether a data-block shows results, or is there only while a job runs."""
    return is_own(block) or block.is_runtime_data


def is_camera(block: bpy.types.ID) -> bool:
    """Return whether a data-block is a camera, as object or as its data."""
    return isinstance(block, bpy.types.Camera) or (isinstance(block, bpy.types.Object) and block.type == "CAMERA")


class _OwnDigest(Digest):
    """Hash of one data-block alone: of others that it refers to the names count, and `references` lists them."""

    def __init__(self) -> None:
        super().__init__()
        self.references: list[bpy.types.ID] = []

    def block(self, block: bpy.types.ID | None) -> None:
        """Hash the name of a data-block; nothing of one that shows results."""
        if block is not None and _passed_over(block):
            return
        self.text(None if block is None else key_of(block))
        if block is not None:
            self.references.append(block)


class _Reader:
    """Reader that hashes data-blocks; `animated` is whether one of them changes by itself from frame to frame."""

    def __init__(self) -> None:
        self.animated = False
        self._references: list[bpy.types.ID] = []

    def taken_references(self) -> list[bpy.types.ID]:
        """Data-blocks that the last one refers to."""
        taken, self._references = self._references, []
        return taken

    def hashes(self, block: bpy.types.ID) -> _Hashes:
        """Hash one data-block."""
        surface, light, view = digests = _OwnDigest(), _OwnDigest(), _OwnDigest()
        main = view if is_camera(block) else light if _lights(block) else surface
        if isinstance(block, bpy.types.Object):
            self._object(block, main, view if main is view else light)
        elif isinstance(block, bpy.types.Mesh):
            _mesh(block, surface, light)
        else:
            _other(block, main)
        self._animation(block, main)
        self._references = [reference for digest in digests for reference in digest.references]
        return _Hashes(*("" if digest.is_empty else digest.hexdigest() for digest in digests))

    def _object(self, item: bpy.types.Object, surface: _OwnDigest, light: _OwnDigest) -> None:
        # What Blender computes from this, the world's matrix, is not known right after an undo. Cameras are not
        # compared then, and what moves them need not be part of the surface.
        moved_by = (item.matrix_world,) if is_camera(item) else (item.matrix_basis, item.matrix_parent_inverse)
        for matrix in moved_by:
            surface.text(tuple(tuple(row) for row in matrix))
        surface.text(*(getattr(item, name) for name in _OF_OBJECTS), tuple(item.color))
        for name in _REFERRED:
            surface.block(getattr(item, name))
        for modifier in item.modifiers:
            surface.modifier(modifier, depth=2)
            self.animated |= modifier.type in MOVES_BY_ITSELF
        for constraint in item.constraints:
            surface.struct(constraint, depth=2)
            self.animated |= constraint.type in MOVES_BY_ITSELF
        for system in item.particle_systems:
            surface.particles(system)
            self.animated = True
        light.text(*(getattr(item, name) for name in _OF_OBJECTS_LIT))
        light.block(item.light_linking.receiver_collection)
        light.block(item.light_linking.blocker_collection)
        for slot in item.material_slots:
            light.block(slot.material)

    def _animation(self, block: bpy.types.ID, digest: _OwnDigest) -> None:
        for owner in (block, getattr(block, "node_tree", None), getattr(block, "shape_keys", None)):
            data = getattr(owner, "animation_data", None)
            if data is None or not (data.action or len(data.drivers) or len(data.nla_tracks)):
                continue
            self.animated = True
            for curve in fcurves(data):
                digest.text(curve.data_path, curve.array_index, curve.mute, curve.extrapolation)
                for name in _KEYFRAME_VALUES:
                    digest.array(name, values_of(curve.keyframe_points, name, 2, np.float32))
            for driver in data.drivers:
                digest.text(driver.data_path, driver.array_index)
                digest.struct(driver.driver, depth=3)


def _lights(block: bpy.types.ID) -> bool:
    """Return whether a data-block, neither an object nor a mesh, makes light or shows it."""
    if isinstance(block, bpy.types.NodeTree):
        return block.type != "GEOMETRY"
    return isinstance(block, _LIGHT_TYPES) or (isinstance(block, bpy.types.Object) and block.type in _LAMPS)


def _other(block: bpy.types.ID, digest: _OwnDigest) -> None:
    if isinstance(block, _WHOLE):
        digest.contents(block)
        return
    strands = isinstance(block, bpy.types.Curves | bpy.types.PointCloud)
    digest.struct(block, _SKIPPED_OF_STRANDS if strands else _SKIPPED_OF_DATA, depth=2)
    if (tree := getattr(block, "node_tree", None)) is not None:
        digest.contents(tree)
    if hasattr(block, "attributes"):
        digest.geometry(block)


def _mesh(data: bpy.types.Mesh, surface: _OwnDigest, light: _OwnDigest) -> None:
    """Geometry to the surface, all else that a bake shows to the light."""
    if data.is_editmode:
        surface.text("edited", id(data))
    if _POSITION in data.attributes:  # not in a mesh without vertices
        surface.attribute(data.attributes[_POSITION])
    surface.faces(data)
    surface.block(data.shape_keys)
    light.geometry(data, without=_POSITION)
