# SPDX-License-Identifier: GPL-3.0-or-later
"""Incremental bake: what of the last bake of a scene stays, and what of the scene is baked again (methods 7.2i)."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ....patchnet_addon.runtime.progress import Progress, Steps
from ....patchnet_addon.runtime.worker import computed, run_in_worker
from ...scene.scene_mesh import MeshInstances, SceneMesh
from ...settings.groups import LightSettings
from ...state.digest import Digest
from .bake_key import add_mesh, code_hash
from .gloss_passes import baked_with_gloss
from .scene_items import NotFollowedError, change_of, scene_items
from .translucency import is_translucent

if TYPE_CHECKING:  # it brings numba, which nothing imports before it computes
    from ....patchnet_addon.lightmap.charts import Charts
    from ....patchnet_addon.lightmap.incremental.follow import Change, Levels
    from ....patchnet_addon.lightmap.incremental.record import BakeRecord


@dataclass(eq=False)
class Incremental:
    """Part of a bake that is left to do, and the record of it that the next one takes its light from.

    charts: of the triangles that are baked again, those of the whole surface if nothing stays. texels: (N, C) of all
    charts, what stays is in them. before: (T,) int64, which triangle of the last bake stays as this one, -1 for none.
    turned: (T,) bool, baked on the back.
    notes: what was baked and why, for reports.
    """

    whole: Charts
    charts: Charts
    texels: np.ndarray
    before: np.ndarray
    drift: np.ndarray
    turned: np.ndarray
    notes: dict[str, Any]
    _key: str = ""
    _placed: list[str] = field(default_factory=list)
    _counts: np.ndarray = field(default_factory=lambda: np.empty(0, np.int64))
    _scene: dict[str, Any] = field(default_factory=dict)

    def finish(self, texels: np.ndarray) -> np.ndarray:
        """Texels of the whole surface with those (N, C) that were baked on `charts`; kept for the next bake."""
        from ....patchnet_addon.lightmap.incremental.record import BakeRecord, save_record
        from ....patchnet_addon.lightmap.incremental.texels import copied

        if self.charts is self.whole:
            self.texels = texels
        elif len(texels):
            again = np.where(self.before < 0, np.arange(len(self.before)), -1)
            copied(self.texels, self.whole, texels, self.charts, again)
        record = BakeRecord(self.whole, self.texels, self.drift, self.turned, self._placed, self._counts, self._scene)
        save_record(self._key, record)
        return self.texels


def incremental_bake(
    depsgraph: bpy.types.Depsgraph,
    source: SceneMesh,
    charts: Charts,
    light: LightSettings,
    channels: int,
    turned: np.ndarray,
    switches: tuple[object, ...],
) -> Steps[Incremental]:
    """Compare the scene with that of its last bake.

    turned: (T,) bool, triangles that are baked on the back; those that were on the other side are baked again.
    switches: whatever else determines the light; bakes with others have records of their own.
    """
    from ....patchnet_addon.lightmap.incremental.record import load_record

    yield Progress(0, 1, "Looking for what changed")
    scene = depsgraph.scene.original
    digest = Digest()
    digest.text(code_hash(), bpy.app.version_string, bpy.data.filepath, scene.name_full, switches)
    key = digest.hexdigest()
    now = scene_items(depsgraph, bool(light.daylight))
    placed, counts = _placed_meshes(source)
    record = yield from computed(lambda: load_record(key), Progress(0, 1, "Looking for what changed"))
    texels = np.zeros((charts.page_count * charts.page_side**2, channels), np.float32)
    nothing = np.full(source.triangle_count, -1, np.int64)
    found = Incremental(charts, charts, texels, nothing, np.zeros(source.triangle_count, np.float32), turned, {})
    found._key, found._placed, found._counts, found._scene = key, placed, counts, now
    reason = "there is no earlier bake"
    if record is not None and record.texels.shape[1] == channels:
        try:
            yield from _keep(found, source, record, change_of(record.scene, now), light)
            reason = ""
        except NotFollowedError as cause:
            reason = str(cause)
    found.notes = _notes(found, light, reason)
    return found


def _keep(
    found: Incremental, source: SceneMesh, record: BakeRecord, change: Change, light: LightSettings
) -> Steps[None]:
    """Fill in what stays."""
    from ....patchnet_addon.lightmap.incremental.follow import follow
    from ....patchnet_addon.lightmap.incremental.texels import charts_of, copied, same_charts, with_partners

    before = record.triangles_before(found._placed, found._counts)
    before[~same_charts(record.charts, found.whole, before)] = -1
    before[record.turned[before] != found.turned] = -1  # of -1, too: that stays -1
    stays = before >= 0
    drift = np.where(stays, record.drift[np.where(stays, before, 0)], 0.0)
    if len(change.boxes) or change.lit:
        levels = yield from computed(lambda: _levels(source, record, before), Progress(0, 1, "Following light"))
        white = levels.white if light.exposure is None else 1.0 / light.exposure
        brightest = max(levels.brightest, found._scene["sky"])
        limit = light.tolerance * white
        steps = run_in_worker(lambda: follow(source, change, brightest, limit), Progress(0, 1, "Following light"))
        touched, bound = yield from steps
        drift += bound
        stays &= ~touched & (drift <= limit) & ~_seen_from_elsewhere(source, light)
    stays &= ~with_partners(found.whole, ~stays)
    found.before = np.where(stays, before, -1)
    found.drift = np.where(stays, drift, 0.0).astype(np.float32)
    if stays.any():
        found.charts = charts_of(found.whole, ~stays)
        copied(found.texels, found.whole, record.texels, record.charts, found.before)


def _levels(source: SceneMesh, record: BakeRecord, before: np.ndarray) -> Levels:
    """Levels of the light of the last bake, on what is still there of its surface."""
    from ....patchnet_addon.lightmap.chart_lookup import triangle_means
    from ....patchnet_addon.lightmap.incremental.follow import Levels, luminance_of_emission
    from ....patchnet_addon.octree.voxelize import triangle_areas_and_normals

    dark = np.array([luminance_of_emission(material) <= 0.0 for material in source.materials])
    shown, areas = [], []
    for batch in source.batches():
        part = before[batch.first_triangle : batch.first_triangle + len(batch)]
        mine = (part >= 0) & dark[batch.materials]
        means = triangle_means(record.charts, record.texels[:, :2], part[mine])
        shown.append(means[:, 0] / np.maximum(means[:, 1], 1e-3))
        areas.append(triangle_areas_and_normals(batch.corners_world[mine])[0])
    return Levels.of(np.concatenate(shown), np.concatenate(areas))


def _seen_from_elsewhere(source: SceneMesh, light: LightSettings) -> np.ndarray:
    """(T,) bool: gloss and what shines through show things that no bound is known for."""
    translucent = {material.name_full for material in bpy.data.materials if is_translucent(material)}
    through = np.array([name in translucent for name in source.material_names])
    open_ended = baked_with_gloss(source, light.gloss) | through
    return np.concatenate([open_ended[batch.materials] for batch in source.batches()])


def _placed_meshes(source: SceneMesh) -> tuple[list[str], np.ndarray]:
    """Hashes of all placed meshes with what they look like, and their triangles (I,), in the surface's order."""
    library = {material.name_full: material for material in bpy.data.materials}
    looks = [_hash_of_material(library.get(name)) for name in source.material_names]
    links = [sorted(each) for each in source.light_links]
    placed, counts = [], []
    for part in source.parts:
        digest = Digest()
        add_mesh(digest, part.mesh)
        mesh = digest.hexdigest()
        placed += [_hash_of_place(part, index, mesh, looks, links) for index in range(len(part.objects))]
        counts += [len(part.mesh)] * len(part.objects)
    return placed, np.array(counts, np.int64)


def _hash_of_place(
    part: MeshInstances, index: int, mesh: str, looks: list[str], links: list[list[tuple[str, str]]]
) -> str:
    digest = Digest()
    digest.text(mesh, [looks[number] for number in part.materials[index]], links[part.links[index]])
    digest.array("matrix", part.matrices_world[index])
    for name, values in part.values.items():
        digest.array(name, values[index])
    return digest.hexdigest()


def _hash_of_material(material: bpy.types.Material | None) -> str:
    digest = Digest()
    digest.block(material)
    return digest.hexdigest()


def _notes(found: Incremental, light: LightSettings, reason: str) -> dict[str, Any]:
    """What is baked and what stays, as plain JSON values."""
    again = found.before < 0
    own = np.exp2(np.maximum(found.whole.log_width.astype(np.float64) + found.whole.log_height - 1.0, 0.0))
    notes: dict[str, Any] = {
        "tolerance": light.tolerance,
        "pages": found.whole.page_count,
        "pages_baked": found.charts.page_count if again.any() else 0,
        "pages_kept": int(found.whole.page_count - len(np.unique(found.whole.page[again]))),
        "triangles": len(again),
        "triangles_baked": int(again.sum()),
        "texels_baked": float(own[again].sum() / max(own.sum(), 1.0)),
    }
    return notes | ({"whole_because": reason} if reason else {})
