# SPDX-License-Identifier: GPL-3.0-or-later
"""Hashes of the data-blocks that voxels and their light depend on, to tell what changed from what was only reported.

Blender reports far more than changes: after an undo everything, and the lamps whenever its dependency graph is built
anew, as when a window closes or a collection is added. The state is taken of the user's own data, not of what Blender
evaluates from it, so that it is the same in every process that opened the same file.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import bpy

from .block_hashes import LAMPS, BlockReader, OwnDigest, Part, is_camera, passed_over, place_of_gloss
from .digest import Digest, render_keys

SURFACE, LIGHT, VIEW = "surface", "light", "view"
STEPS = (SURFACE, LIGHT, VIEW)  # each needs those after it anew, too
Named = tuple[str, str]  # word for a kind of data-block, and its name
_SCENE = 0  # in the place of a session_uid: settings of the scene and its view layer

# Never more than light, whatever refers to them.
_LIGHT_TYPES = (bpy.types.Light, bpy.types.LightProbe, bpy.types.World, bpy.types.Material)
_SURFACES = frozenset({"MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES", "POINTCLOUD"})
_SHADING = frozenset({"VOLUME", "GREASEPENCIL"})  # without voxels
_WORDS = {"CAMERA": "camera", "LIGHT": "lamp", "LIGHT_PROBE": "lamp"}  # by type of object
_OWN_WORDS = {bpy.types.Material: "material", bpy.types.World: "world", bpy.types.Image: "image",
              bpy.types.Texture: "texture", bpy.types.ShaderNodeTree: "node group"}  # fmt: skip
_PASSED_OVER = (bpy.types.Scene, bpy.types.Library, bpy.types.Action, bpy.types.WorkSpace)
_OF_RENDERS = ("use_simplify", "simplify_subdivision_render", "simplify_child_particles_render", "hair_type")
_OF_CYCLES = (
    "max_bounces", "diffuse_bounces", "glossy_bounces", "transmission_bounces", "volume_bounces",
    "transparent_max_bounces", "caustics_reflective", "caustics_refractive", "blur_glossy", "use_fast_gi",
    "fast_gi_method", "ao_bounces_render", "light_sampling_threshold", "use_light_tree",
)  # fmt: skip
_SETTINGS = "world or render settings", ""
_NEIGHBOURS = 4  # so far is followed what data-blocks refer to, to tell two apart that have the same values
_SLOW_S = 0.02


class Change(NamedTuple):
    """Comparison of one thing: what it is, the steps that it does not fit any more, and that in words."""

    key: Hashable
    steps: tuple[str, ...]
    text: str


class _Entry(NamedTuple):
    """One data-block: `main` counts for `step`, `look`, how it looks in light, never for more than light.

    named: None where the object says more, through which it was found: `owner`, a session_uid. seconds: of its hashes.
    """

    named: Named | None
    owner: int
    step: str
    main: Part
    look: Part
    seconds: float = 0.0

    def changed_steps(self, now: _Entry, step: str) -> tuple[str, ...]:
        """Steps that it does not fit any more, if its main part counts for `step`."""
        found = [step] if self.main != now.main else []
        found += [_at_most(LIGHT, step)] if self.look != now.look else []
        return tuple(dict.fromkeys(found))


@dataclass(frozen=True)
class SceneState:
    """State of a scene at some moment, by value: names do not count.

    entries: hashes by session_uid of the data-block. shown: of objects that count, how the view layer shows them.
    layer: its name. chosen: session_uids of the objects that have voxels, None for all. frame: the present one if
    something is animated. seconds: what it took to find out. gloss_from: where the camera stands that gloss is seen
    from, empty where none is.
    """

    entries: dict[int, _Entry]
    shown: dict[int, tuple[object, ...]]
    layer: str
    chosen: frozenset[int] | None
    frame: int | None
    seconds: float
    gloss_from: str = ""

    def identity(self, *more: object) -> str:
        """32 hex digits over all of it but the cameras, and over `more`; the same in each process."""
        lit = {uid: entry for uid, entry in self.entries.items() if entry.step != VIEW}
        marks = {uid: _short(entry.main.text, entry.look.text) for uid, entry in lit.items()}
        near = {uid: (uid, *entry.main.references, *entry.look.references) for uid, entry in lit.items()}
        for _ in range(_NEIGHBOURS):
            marks = {uid: _short(*(marks.get(each, "") for each in uids)) for uid, uids in near.items()}
        digest = Digest()
        digest.text(sorted(marks.values()), sorted((marks[uid], repr(how)) for uid, how in self.shown.items()))
        digest.text(self.layer, self.frame, *more)
        return digest.hexdigest()

    def differences(self, now: SceneState, scene: bpy.types.Scene) -> list[Change]:
        """List what is not as it was; nothing where all has the same values, be it in other data-blocks."""
        found = self._differences_of_shown(now.shown, scene)
        for uid, before in self.entries.items():
            after = now.entries.get(uid)  # what refers to others changed, too
            if after is None:
                continue
            if steps := before.changed_steps(after, min(before.step, after.step, key=STEPS.index)):
                named = after.named or now.entries.get(after.owner, before).named or _SETTINGS
                found.append(Change(uid, steps, _text(named, "changed")))
        lasting = [change for change in found if change.steps != (VIEW,)]
        return lasting if lasting and self.identity() != now.identity() else []

    def seen_from_camera(self, scene: bpy.types.Scene) -> SceneState:
        """State of a scene whose gloss is seen from its active camera, where that stands now."""
        return replace(self, gloss_from=place_of_gloss(scene))

    def gloss_has_moved(self, scene: bpy.types.Scene) -> bool:
        """Return whether gloss is seen from a camera, and the active one stands elsewhere now."""
        return bool(self.gloss_from) and place_of_gloss(scene) != self.gloss_from

    def compared(self, scene: bpy.types.Scene, block: bpy.types.ID, verb: str = "changed") -> Change | None:
        """Compare an original data-block with what it was; None for one that nothing depends on."""
        before = self.entries.get(block.session_uid)
        if before is None or passed_over(block):
            return None
        main, look, _ = BlockReader().parts(block)
        step = before.step
        if isinstance(block, bpy.types.Object) and step == LIGHT and _has_voxels(block, self.chosen):
            step = SURFACE
        steps = before.changed_steps(before._replace(main=main, look=look), step)
        text = _text(_named(block) or self._owner(scene, before.owner), verb) if steps else ""
        return Change(block.session_uid, steps, text)

    def is_slow(self, block: bpy.types.ID) -> bool:
        """Return whether to compare a data-block takes too long to do it after each movement of the mouse."""
        entry = self.entries.get(block.session_uid)
        return entry is not None and entry.seconds > _SLOW_S

    def fits_layer(self, scene: bpy.types.Scene, layer: str) -> bool:
        """Return whether a view layer of the scene shows what the one shows that this is the state of."""
        if layer == self.layer:
            return True
        return _shown(scene, _layer(scene, layer)) == _shown(scene, _layer(scene, self.layer))

    def differences_of_scene(self, scene: bpy.types.Scene) -> list[Change]:
        """List what the view layer shows otherwise, settings of the scene, and what Blender does not report."""
        layer = _layer(scene, self.layer)
        shown = {uid: how for uid, (_, how) in _shown(scene, layer).items()}
        found = self._differences_of_shown(shown, scene)
        before = self.entries[_SCENE]
        if steps := before.changed_steps(_settings(scene, layer), SURFACE):
            found.append(Change(_SCENE, steps, _text(_SETTINGS, "changed")))
        return found

    @staticmethod
    def is_of_scene(key: Hashable) -> bool:
        """Return whether `differences_of_scene` tells of what has this key."""
        return key == _SCENE or isinstance(key, tuple)

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
                verb = "changed" if before[1] == after[1] else "was hidden" if after[1] else "was shown"
            named = (entry and entry.named) if item is None else _named(item)
            found.append(Change(("shown", uid), (step,), _text(named or _SETTINGS, verb)))
        return found

    def _owner(self, scene: bpy.types.Scene, uid: int) -> Named:
        """Name an object as it is called now."""
        known = self.entries[uid].named if uid in self.entries else None
        item = scene.objects.get(known[1]) if known else None
        if item is None or item.session_uid != uid:
            item = next((each for each in scene.objects if each.session_uid == uid), None)
        return (item and _named(item)) or known or _SETTINGS


def scene_state(
    scene: bpy.types.Scene, layer: str = "", chosen: frozenset[int] | None = None, *, selected: bool = False
) -> SceneState:
    """Take the state of a scene without objects that show results, and of all that it refers to.

    layer: name of the view layer that is looked at, by default the context's. chosen: session_uids of the objects that
    have voxels, None for all; selected: those that are selected now.
    """
    begun = time.perf_counter()
    view_layer = _layer(scene, layer or _present_layer(scene))
    found = _shown(scene, view_layer)
    if selected:
        chosen = frozenset(uid for uid, (item, _) in found.items() if item.select_get(view_layer=view_layer))
    reader = BlockReader()
    entries = {_SCENE: _settings(scene, view_layer)}
    waiting: dict[str, list[tuple[bpy.types.ID, int]]] = {step: [] for step in STEPS}
    for item, _ in found.values():
        waiting[SURFACE if _has_voxels(item, chosen) else LIGHT].append((item, item.session_uid))
    if scene.world is not None:
        waiting[LIGHT].append((scene.world, 0))
    waiting[VIEW] += [(item, item.session_uid) for item in scene.objects if is_camera(item)]
    animated = False
    for step in STEPS:
        while waiting[step]:
            block, owner = waiting[step].pop()
            uid = block.session_uid
            if uid in entries or passed_over(block) or isinstance(block, _PASSED_OVER):
                continue
            at, owner = time.perf_counter(), uid if isinstance(block, bpy.types.Object) else owner
            mine = _at_most(LIGHT, step) if isinstance(block, _LIGHT_TYPES) else step
            main, look, references = reader.parts(block)
            entries[uid] = _Entry(_named(block), owner, mine, main, look, time.perf_counter() - at)
            animated |= reader.animated and mine != VIEW
            for target, blocks in ((mine, references[0]), (_at_most(LIGHT, mine), references[1])):
                waiting[target] += [(other, owner) for other in blocks]
    frame = scene.frame_current if animated else None
    shown = {uid: how for uid, (_, how) in found.items()}
    return SceneState(entries, shown, view_layer.name, chosen, frame, time.perf_counter() - begun)


def _named(block: bpy.types.ID) -> Named | None:
    """Word and name for a data-block; None where those of an object that it is a part of say more."""
    if isinstance(block, bpy.types.Object):
        return _WORDS.get(block.type, ""), block.name_full
    return next(((word, block.name_full) for kind, word in _OWN_WORDS.items() if isinstance(block, kind)), None)


def _text(named: Named, verb: str) -> str:
    word, name = named
    return f"{word} '{name}' {verb}".lstrip() if name else f"{word} {verb}"


def _at_most(most: str, step: str) -> str:
    """Return the step, or `most` where that needs less to be done again."""
    return STEPS[max(STEPS.index(most), STEPS.index(step))]


def _short(*texts: str) -> str:
    return hashlib.blake2b("|".join(texts).encode(), digest_size=16).hexdigest()


def _present_layer(scene: bpy.types.Scene) -> str:
    layer = bpy.context.view_layer
    return str(layer.name) if layer is not None and bpy.context.scene == scene else ""


def _layer(scene: bpy.types.Scene, name: str) -> bpy.types.ViewLayer:
    return scene.view_layers.get(name) or scene.view_layers[0]


def _shown(
    scene: bpy.types.Scene, layer: bpy.types.ViewLayer
) -> dict[int, tuple[bpy.types.Object, tuple[object, ...]]]:
    """Objects of a view layer that have voxels or light them, by session_uid, and how it shows them.

    With values that count for renders alone: Blender reports no change of them.
    """
    found: dict[int, tuple[bpy.types.Object, set[tuple[bool, ...]]]] = {}
    stack = [(layer.layer_collection, (False,) * 3)]
    while stack:
        item, above = stack.pop()
        if item.exclude or item.collection.hide_render:
            continue
        hidden = item.hide_viewport or item.collection.hide_viewport
        flags = tuple(map(max, above, (item.holdout, item.indirect_only, hidden)))
        for each in item.collection.objects:
            if _counts(each):
                found.setdefault(each.session_uid, (each, set()))[1].add(flags)
        stack.extend((child, flags) for child in item.children)
    return {
        uid: (item, (sorted(flags), item.hide_get(view_layer=layer), *_unreported(item)))
        for uid, (item, flags) in found.items()
    }


def _unreported(item: bpy.types.Object) -> Iterator[object]:
    """Values of an object that renders take in the place of others, of whose changes Blender reports none."""
    systems = (system.settings for system in item.particle_systems)
    for owner in (*item.modifiers, item.data, *systems):
        for key in render_keys(owner) if owner is not None else ():
            yield getattr(owner, key)


def _settings(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> _Entry:
    """How Cycles renders the scene, and what it puts in the place of its objects' own."""
    surface, light = OwnDigest(), OwnDigest()
    surface.text(layer.use_strand)
    light.block(scene.world)
    for owner, keys in ((scene.render, _OF_RENDERS), (getattr(scene, "cycles", None), _OF_CYCLES)):
        light.text(*(getattr(owner, key, None) for key in keys))
    for key in ("material_override", "world_override"):
        light.block(getattr(layer, key, None))
    return _Entry(_SETTINGS, 0, SURFACE, surface.part(), light.part())


def _counts(item: bpy.types.Object) -> bool:
    """Return whether an object of a scene has voxels or lights them, by itself and not as what others refer to."""
    if passed_over(item) or item.hide_render:
        return False
    if item.type in _SURFACES or item.type in LAMPS or item.type in _SHADING:
        return True
    return item.instance_collection is not None or (item.field is not None and item.field.type != "NONE")


def with_surface(scene: bpy.types.Scene, chosen: frozenset[int] | None) -> frozenset[int]:
    """Session_uids of a scene's objects that may have voxels, of those that are chosen."""
    return frozenset(item.session_uid for item in scene.objects if _has_voxels(item, chosen))


def _has_voxels(item: bpy.types.Object, chosen: frozenset[int] | None) -> bool:
    if chosen is not None and item.session_uid not in chosen:
        return False
    seen = item.visible_camera and not item.is_holdout and not item.is_shadow_catcher
    return seen and (item.type in _SURFACES or item.instance_collection is not None)
