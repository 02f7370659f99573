# SPDX-License-Identifier: GPL-3.0-or-later
"""Hashes of the data-blocks that voxels and their light depend on, which tell changes from other updates.

Blender reports far more updates than changes: everything after an undo, and all lamps when it rebuilds its dependency
graph, as when a window closes or a collection is added. The state is read from the user's original data, not from
evaluated data, so that it is the same in each process that opens the same file.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import NamedTuple

import bpy

from ...patchnet_addon.runtime.omissions import Omissions
from ...patchnet_addon.runtime.progress import Progress, Steps, drain
from .block_hashes import LAMPS, BlockReader, OwnDigest, Part, may_appear, passed_over
from .digest import composed

SURFACE, LIGHT = "surface", "light"
Named = tuple[str, str]  # word for a kind of data-block, and its name
_SCENE = 0  # in the place of a session_uid: settings of the scene and its view layer

# Never more than light, whatever refers to them.
_LIGHT_TYPES = (bpy.types.Light, bpy.types.LightProbe, bpy.types.World, bpy.types.Material)
_SURFACES = frozenset({"MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD"})
_SHADING = frozenset({"VOLUME", "GREASEPENCIL"})  # these have no voxels
_WORDS = {"LIGHT": "lamp", "LIGHT_PROBE": "lamp"}  # by type of object
_OWN_WORDS = {bpy.types.Material: "material", bpy.types.World: "world", bpy.types.Image: "image",
              bpy.types.Texture: "texture", bpy.types.ShaderNodeTree: "node group"}  # fmt: skip
_PASSED_OVER = (bpy.types.Scene, bpy.types.Library, bpy.types.Action, bpy.types.WorkSpace)
_OF_RENDERS = ("use_simplify", "simplify_subdivision_render", "simplify_child_particles_render", "hair_type")
_OF_CYCLES = (
    "max_bounces", "diffuse_bounces", "glossy_bounces", "transmission_bounces", "volume_bounces",
    "transparent_max_bounces", "caustics_reflective", "caustics_refractive", "blur_glossy", "use_fast_gi",
    "fast_gi_method", "ao_bounces_render", "light_sampling_threshold", "use_light_tree", "min_light_bounces",
    "min_transparent_bounces", "volume_step_rate", "volume_max_steps", "texture_limit_render",
)  # fmt: skip
_OVERRIDES = "material_override", "world_override"  # of a view layer
_SETTINGS = "world or render settings", ""
_UNREAD = Part("", ())
_A_STEP = 256  # data-blocks
_NEIGHBOURS = 4  # references that are followed, to tell data-blocks with the same values apart


class Change(NamedTuple):
    """Change of a scene: the outdated steps, and a sentence without a full stop."""

    steps: tuple[str, ...]
    text: str


class _Entry(NamedTuple):
    """Hashes of one data-block: `main` counts for `step`; `look`, its appearance in light, for the light alone.

    named: None where the name of its `owner`, the session_uid of an object, says more.
    """

    named: Named | None
    owner: int
    step: str
    main: Part
    look: Part

    def changed_steps(self, now: _Entry) -> tuple[str, ...]:
        """Steps that are outdated by a change of the data-block."""
        found = [SURFACE if SURFACE in (self.step, now.step) else LIGHT] if self.main != now.main else []
        found += [LIGHT] if self.look != now.look else []
        return tuple(dict.fromkeys(found))


@dataclass(frozen=True)
class SceneState:
    """State of a scene at a moment, by value: names do not count, nor do cameras.

    entries: hashes by session_uid of the data-block. shown: visibility of each object in renders of the view layer.
    layer: its name. chosen: session_uids of the objects that have voxels, None for all. frame: the current one if
    something is animated. seconds: time that reading the state took. gloss_from: place of the camera that gloss was
    baked for, empty without one. warnings: sentences about what cannot be read.
    """

    entries: dict[int, _Entry]
    shown: dict[int, tuple[object, ...]]
    layer: str
    chosen: frozenset[int] | None
    frame: int | None
    seconds: float
    gloss_from: str = ""
    warnings: tuple[str, ...] = ()

    def identity(self, *more: object) -> str:
        """32 hex digits over all of it and `more`; the same in each process."""
        marks = {uid: composed(entry.main.text, entry.look.text) for uid, entry in self.entries.items()}
        near = {uid: (uid, *entry.main.references, *entry.look.references) for uid, entry in self.entries.items()}
        for _ in range(_NEIGHBOURS):
            marks = {uid: composed(*(marks.get(each, "") for each in uids)) for uid, uids in near.items()}
        shown = sorted((marks[uid], repr(how)) for uid, how in self.shown.items())
        return composed(sorted(marks.values()), shown, self.layer, self.frame, *more)

    def differences(self, now: SceneState, scene: bpy.types.Scene) -> list[Change]:
        """List later changes; none if all values are equal, even in other data-blocks."""
        found = self._differences_of_shown(now.shown, scene)
        for uid, before in self.entries.items():
            after = now.entries.get(uid)  # None: its users changed, too
            if after is not None and (steps := before.changed_steps(after)):
                named = after.named or now.entries.get(after.owner, before).named or _SETTINGS
                found.append(Change(steps, _text(named, "changed")))
        return found if found and self.identity() != now.identity() else []

    def fits_layer(self, scene: bpy.types.Scene, layer: str) -> bool:
        """Return whether a view layer shows the same objects as the layer of this state."""
        if layer == self.layer:
            return True
        return _shown(scene, _layer(scene, layer)) == _shown(scene, _layer(scene, self.layer))

    def _differences_of_shown(self, now: dict[int, tuple[object, ...]], scene: bpy.types.Scene) -> list[Change]:
        if self.shown == now:
            return []
        there = {item.session_uid: item for item in scene.objects}
        found = []
        for uid in dict.fromkeys((*self.shown, *now)):
            before, after = self.shown.get(uid), now.get(uid)
            if before == after:
                continue
            entry, item = self.entries.get(uid), there.get(uid)
            step = entry.step if entry is not None else LIGHT
            if item is not None and _has_voxels(item, self.chosen):
                step = SURFACE
            if after is None:
                verb = "was hidden" if item is not None else "was removed"
            elif before is None:
                verb = "was added"
            else:
                verb = "changed"
            named = (entry and entry.named) if item is None else _named(item)
            found.append(Change((step,), _text(named or _SETTINGS, verb)))
        return found


def scene_state(
    scene: bpy.types.Scene, layer: str = "", chosen: frozenset[int] | None = None, *, keys: bool = True
) -> SceneState:
    """Read the state of a scene at once, see `state_steps`."""
    return drain(state_steps(scene, layer, chosen, keys=keys))


def state_steps(
    scene: bpy.types.Scene,
    layer: str = "",
    chosen: frozenset[int] | None = None,
    *,
    selected: bool = False,
    keys: bool = True,
) -> Steps[SceneState]:
    """Read the state of a scene and of all data-blocks that it refers to, without objects that show results.

    layer: name of the view layer, by default that of the context. chosen: session_uids of the objects that have voxels,
    None for all; selected: those that are selected now. keys: with keyframes, and not their present values alone.
    Raises ReferenceError if data-blocks are deleted between two steps.
    """
    begun = time.perf_counter()
    present = bpy.context.view_layer if bpy.context.scene == scene else None
    view_layer = _layer(scene, layer or (present.name if present is not None else ""))
    found = _shown(scene, view_layer)
    if selected:
        chosen = frozenset(uid for uid, (item, _) in found.items() if item.select_get(view_layer=view_layer))
    reader, unread = BlockReader(keys=keys), Omissions()
    entries = {_SCENE: _settings(scene, view_layer)}
    waiting: dict[str, list[tuple[bpy.types.ID, int]]] = {SURFACE: [], LIGHT: []}
    for item, _ in found.values():
        waiting[SURFACE if _has_voxels(item, chosen) else LIGHT].append((item, item.session_uid))
    lit_by = scene.world, *(getattr(view_layer, key, None) for key in _OVERRIDES)
    waiting[LIGHT] += [(block, 0) for block in lit_by if block is not None]
    behind = scene.background_set.objects if scene.background_set is not None else ()
    waiting[LIGHT] += [(item, item.session_uid) for item in behind if _counts(item)]
    animated = any(may_appear(item) for item in scene.objects)
    for step in (SURFACE, LIGHT):
        while waiting[step]:
            block, owner = waiting[step].pop()
            uid = block.session_uid
            if uid in entries or passed_over(block) or isinstance(block, _PASSED_OVER):
                continue
            owner = uid if isinstance(block, bpy.types.Object) else owner
            mine = LIGHT if isinstance(block, _LIGHT_TYPES) else step
            main = look = _UNREAD
            references: list[bpy.types.ID] = []
            lit_references: list[bpy.types.ID] = []
            with unread.leaving_out(found[owner][0].name if owner in found else block.name):
                main, look, (references, lit_references) = reader.parts(block)
            entries[uid] = _Entry(_named(block), owner, mine, main, look)
            animated |= reader.animated
            waiting[mine] += [(other, owner) for other in references]
            waiting[LIGHT] += [(other, owner) for other in lit_references]
            if len(entries) % _A_STEP == 0:
                paused = time.perf_counter()
                yield Progress(0, 1, "Reading the scene")
                begun += time.perf_counter() - paused
    frame = scene.frame_current if animated else None
    shown = {uid: how for uid, (_, how) in found.items()}
    warnings = tuple(unread.sentences("Object", "not watched for changes"))
    return SceneState(entries, shown, view_layer.name, chosen, frame, time.perf_counter() - begun, warnings=warnings)


def _named(block: bpy.types.ID) -> Named | None:
    """Word and name for a data-block; None where its object is named instead."""
    if isinstance(block, bpy.types.Object):
        return _WORDS.get(block.type, ""), block.name_full
    return next(((word, block.name_full) for kind, word in _OWN_WORDS.items() if isinstance(block, kind)), None)


def _text(named: Named, verb: str) -> str:
    word, name = named
    return f"{word} '{name}' {verb}".lstrip() if name else f"{word} {verb}"


def _layer(scene: bpy.types.Scene, name: str) -> bpy.types.ViewLayer:
    return scene.view_layers.get(name) or scene.view_layers[0]


def _shown(
    scene: bpy.types.Scene, layer: bpy.types.ViewLayer
) -> dict[int, tuple[bpy.types.Object, tuple[object, ...]]]:
    """Objects of a view layer that have voxels or light them, by session_uid, and their visibility in renders."""
    found: dict[int, tuple[bpy.types.Object, set[tuple[bool, ...]]]] = {}
    stack = [(layer.layer_collection, (False,) * 2)]
    while stack:
        item, above = stack.pop()
        if item.exclude or item.collection.hide_render:
            continue
        flags = tuple(map(max, above, (item.holdout, item.indirect_only)))
        for each in item.collection.objects:
            if _counts(each):
                found.setdefault(each.session_uid, (each, set()))[1].add(flags)
        stack.extend((child, flags) for child in item.children)
    return {uid: (item, tuple(sorted(flags))) for uid, (item, flags) in found.items()}


def _settings(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> _Entry:
    """Settings of Cycles, and overrides of the view layer."""
    surface, light = OwnDigest(), OwnDigest()
    surface.text(layer.use_strand, layer.use_solid)
    light.text(layer.use_sky, layer.use_volumes)
    light.block(scene.world)
    for values in settings_of_light(scene):
        light.text(*values)
    for key in _OVERRIDES:
        light.block(getattr(layer, key, None))
    return _Entry(_SETTINGS, 0, SURFACE, surface.part(), light.part())


def settings_of_light(scene: bpy.types.Scene) -> list[list[object]]:
    """Values of the render settings, and of Cycles', that light depends on."""
    owners = (scene.render, _OF_RENDERS), (getattr(scene, "cycles", None), _OF_CYCLES)
    return [[getattr(owner, key, None) for key in keys] for owner, keys in owners]


def _counts(item: bpy.types.Object) -> bool:
    """Return whether an object itself has voxels or lights them; others count if these refer to them."""
    if passed_over(item) or item.hide_render:
        return False
    if item.type in _SURFACES or item.type in LAMPS or item.type in _SHADING:
        return True
    return item.instance_collection is not None or (item.field is not None and item.field.type != "NONE")


def with_surface(scene: bpy.types.Scene, chosen: frozenset[int] | None) -> frozenset[int]:
    """Session_uids of the chosen objects of a scene that can have voxels."""
    return frozenset(item.session_uid for item in scene.objects if _has_voxels(item, chosen))


def _has_voxels(item: bpy.types.Object, chosen: frozenset[int] | None) -> bool:
    if chosen is not None and item.session_uid not in chosen:
        return False
    seen = item.visible_camera and not item.is_holdout and not item.is_shadow_catcher
    return seen and (item.type in _SURFACES or item.instance_collection is not None)
