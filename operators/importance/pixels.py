# SPDX-License-Identifier: GPL-3.0-or-later
"""Importance of the pixels of a view, from an image that is stretched over it or from the weights of a vertex group.

Of a group, the centre of a voxel that a pixel shows looks for the nearest painted triangle, no farther than the voxel's
corners. So the weight follows what the preview shows, cut-outs and instances included, and no weight has to be stored
with the octree. Where a voxel holds painted and other surfaces, the painted one counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree
from mathutils.interpolate import poly_3d_calc

from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.runtime.errors import SettingError
from ...patchnet_addon.runtime.progress import Steps
from ...patchnet_addon.sampling.importance import PixelRect
from ...patchnet_addon.sampling.strokes import Lookup, Painted
from ...patchnet_addon.surface.chroma import REC709
from ..scene.render_geometry import render_geometry, shown_instances, shows_mesh
from ..state.digest import Digest
from .painted import Importance

Result = TypeVar("Result")
_PER_STEP = 1024  # a hundredth of a second


def painted_image(name: str) -> np.ndarray:
    """(h, w) float32 of an image of the open file, row 0 at the bottom: gray value of the stored pixels, times alpha.

    Raises SettingError for an image that does not exist or has no pixels.
    """
    image = bpy.data.images.get(name)
    if image is None:
        raise SettingError(f"Importance image '{name}' does not exist: choose another image")
    width, height = image.size
    channels = image.channels
    if not width * height * channels:
        raise SettingError(f"Image '{image.name}' has no pixels: find its missing file, or paint it")
    pixels = np.empty(width * height * channels, np.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(height, width, channels)
    gray = pixels[..., :3] @ REC709 if channels >= 3 else pixels[..., 0]
    return gray * pixels[..., -1] if channels in (2, 4) else gray


@dataclass(frozen=True, eq=False)
class Strokes:
    """Painted strokes; any thread may look weights up, as no call to Blender follows.

    One of `picture`, (h, w) float32 with row 0 at the bottom, and `surface`; none where all pixels matter alike.
    """

    picture: np.ndarray | None = None
    surface: PaintedSurface | None = None

    def weights(self, grid: Grid, rect: PixelRect | None = None) -> Painted | None:
        """Weights of the pixels of a view of an octree, to be computed by steps that are passed on by `answering`.

        rect: area that an image is stretched over.
        """
        return None if self.picture is None and self.surface is None else Painted(grid, self.picture, rect)

    def answering(self, steps: Steps[Result]) -> Steps[Result]:
        """Pass on steps, and fill in the weights of the surface that they ask for, some at each step."""
        lookup, known = None, 0
        try:
            while True:
                report = next(steps)
                if isinstance(report.partial, Lookup):
                    lookup, known = report.partial, 0
                    report = replace(report, partial=None)
                if lookup is not None and self.surface is not None:
                    known = self.surface.fill_in(lookup, known)
                yield report
        except StopIteration as stop:
            return stop.value
        finally:
            steps.close()


def read_strokes(importance: Importance | None, scope: str, depsgraph: bpy.types.Depsgraph) -> Strokes:
    """Read painted importance of the open file, if it has any.

    scope: of the voxelized objects. depsgraph: evaluated with render geometry meanwhile, unless it is a render's own
    graph. Raises SettingError if image or vertex group do not exist.

    A render may call this in its own thread: it only reads, meshes of its own graph, and images the way Cycles does.
    """
    if importance is None:
        return Strokes()
    if importance.vertex_group:
        with render_geometry(depsgraph):
            return Strokes(surface=PaintedSurface(depsgraph, scope, importance.vertex_group))
    return Strokes(picture=painted_image(importance.image))


def importance_key(importance: Importance | None) -> str:
    """Hash of painted importance: a frame made with other strokes is outdated."""
    if importance is None:
        return ""
    digest = Digest()
    if importance.vertex_group:
        for item in bpy.data.objects:
            if isinstance(item.data, bpy.types.Mesh) and importance.vertex_group in item.vertex_groups:
                digest.array(item.name_full, group_weights(item, item.data, importance.vertex_group))
    else:
        digest.array("picture", painted_image(importance.image))
    return digest.hexdigest()


class PaintedSurface:
    """Triangles of all objects that have a vertex group, in world units."""

    def __init__(self, depsgraph: bpy.types.Depsgraph, scope: str, group: str) -> None:
        """Read the group through `depsgraph`, as renders see it; raises SettingError if no object in scope has it."""
        points, triangles, weights, first = [], [], [], 0
        for instance in shown_instances(depsgraph, scope):
            if not shows_mesh(instance) or group not in instance.object.vertex_groups:
                continue
            part = _triangles(instance, group)
            points.append(part[0])
            triangles.append(part[1] + first)
            weights.append(part[2])
            first += len(part[0])
        if not points:
            raise SettingError(f"No voxelized object has the vertex group '{group}': paint one, or choose another")
        self._points, self._triangles = np.concatenate(points), np.concatenate(triangles)
        self._weights = np.concatenate(weights)
        self._tree = BVHTree.FromPolygons(self._points.tolist(), self._triangles.tolist(), all_triangles=True)

    def fill_in(self, lookup: Lookup, first: int) -> int:
        """Look up weights from the index `first` on, for a moment; returns the index of the next one."""
        last = min(first + _PER_STEP, len(lookup.weights))
        for index in range(first, last):
            lookup.weights[index] = self.weight(lookup.centres[index], lookup.reaches[index])
        return last

    def weight(self, point: np.ndarray, reach: float) -> float:
        """Interpolated weight of the surface nearest to a point (3,), 0 where there is none within `reach`."""
        found, _normal, index, _distance = self._tree.find_nearest(point.tolist(), reach)
        if found is None:
            return 0.0
        corners = self._triangles[index]
        # float32, whose sum is nearly 1; NaN where all corners are one point.
        shares = np.nan_to_num(poly_3d_calc(self._points[corners].tolist(), found), nan=1.0)
        return float(np.average(self._weights[corners], weights=shares))


def group_weights(item: bpy.types.Object, mesh: bpy.types.Mesh, group: str) -> np.ndarray:
    """(V,) float32 weights of a mesh's vertices in a group of its object."""
    number = item.vertex_groups[group].index
    weights = np.zeros(len(mesh.vertices), np.float32)
    for index, vertex in enumerate(mesh.vertices):
        for element in vertex.groups:
            if element.group == number:
                weights[index] = element.weight
                break
    return weights


def _triangles(instance: bpy.types.DepsgraphObjectInstance, group: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """World points (V, 3), triangles (T, 3) and weights (V,) of an instance."""
    item = instance.object
    mesh = item.data
    assert isinstance(mesh, bpy.types.Mesh)
    points = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", points)
    triangles = np.empty(len(mesh.loop_triangles) * 3, np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles)
    matrix = np.array(instance.matrix_world, np.float64)
    world = points.reshape(-1, 3).astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
    return world, triangles.reshape(-1, 3), group_weights(item, mesh, group)
