# SPDX-License-Identifier: GPL-3.0-or-later
"""Page mesh: the triangles of one page of charts, as arrays and as a Blender mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from ....patchnet_addon.lightmap.charts import Charts
from ...scene.scene_mesh import Run, SceneMesh
from ...scene_access.polygons import add_polygons
from .object_data import OBJECT

CHART_LAYER = "PatchNet Charts"
SURFACE_LAYER = "PatchNet Surface"


@dataclass(frozen=True, eq=False)
class PageTriangles:
    """Placed triangles of one page.

    triangles: (N,) int64 indices in the source. corners_world: (N, 3, 3) float64. normals_world: (N, 3, 3) float32.
    uvs: (N, 3, 2) float32. chart_uvs: (N, 3, 2) float32, [0, 1]^2 is the used part of the page. materials: (N,) int32.
    pieces: (N,) int32, number of the closed piece, or -1. links: (N,) int32, index into the source's `light_links`.
    layers: corner layers by name, (N, 3, C) float32.
    """

    triangles: np.ndarray
    corners_world: np.ndarray
    normals_world: np.ndarray
    uvs: np.ndarray
    chart_uvs: np.ndarray
    materials: np.ndarray
    pieces: np.ndarray
    links: np.ndarray
    layers: dict[str, np.ndarray] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.triangles)

    @property
    def closed(self) -> np.ndarray:
        """(N,) bool: triangles of closed pieces."""
        return self.pieces >= 0

    def only(self, chosen: np.ndarray) -> PageTriangles:
        """Select the triangles where `chosen` (N,) is true."""
        return PageTriangles(
            **{name: getattr(self, name)[chosen] for name in _COLUMNS},
            layers={name: values[chosen] for name, values in self.layers.items()},
        )

    def on_image(self, pages: int, place: int) -> PageTriangles:
        """Move the charts onto page `place`, 0 at the bottom, of an image of stacked pages."""
        uvs = (self.chart_uvs * np.array([1.0, 1.0 / pages]) + np.array([0.0, place / pages])).astype(np.float32)
        return replace(self, chart_uvs=uvs)

    def turned(self, material_shift: int) -> PageTriangles:
        """Turn the triangles to face the other way, their material indices raised by `material_shift`."""
        wind = [0, 2, 1]
        return replace(
            self,
            corners_world=self.corners_world[:, wind],
            normals_world=-self.normals_world[:, wind],
            uvs=self.uvs[:, wind],
            chart_uvs=self.chart_uvs[:, wind],
            materials=self.materials + material_shift,
            layers={name: values[:, wind] for name, values in self.layers.items()},
        )


_COLUMNS = ("triangles", "corners_world", "normals_world", "uvs", "chart_uvs", "materials", "pieces", "links")


def joined(parts: Sequence[PageTriangles]) -> PageTriangles:
    """Triangles of all parts; missing layers are zero, narrower ones are widened."""
    widths: dict[str, int] = {}
    for part in parts:
        for name, values in part.layers.items():
            widths[name] = max(widths.get(name, 0), values.shape[-1])
    layers = {
        name: np.concatenate([_widened(part.layers.get(name), (len(part), 3, width)) for part in parts])
        for name, width in widths.items()
    }
    return PageTriangles(
        **{name: np.concatenate([getattr(p, name) for p in parts]) for name in _COLUMNS}, layers=layers
    )


def _widened(values: np.ndarray | None, shape: tuple[int, ...]) -> np.ndarray:
    """Layer of shape (N, 3, C) from one with fewer numbers, as shaders read it: a number is gray, alpha is 1."""
    wanted = shape[-1]
    if values is not None and values.shape[-1] == wanted:
        return values
    wide = np.zeros(shape, np.float32)
    wide[..., 3:] = 1.0
    if values is not None:
        width = values.shape[-1]
        wide[..., : min(wanted, 3) if width == 1 else width] = values
    return wide


def page_triangles(
    source: SceneMesh, charts: Charts, page: int, pieces: np.ndarray, coordinates: bool
) -> PageTriangles:
    """Triangles with an area whose charts lie on a page.

    pieces: (T,) int32, number of the closed piece, -1 for none. coordinates: with object coordinates as a layer.
    """
    parts: list[PageTriangles] = []
    first = 0
    for run in (run for runs in source.runs() for run in runs):
        mask = charts.page[first : first + len(run)] == page
        if mask.any():
            parts.append(_part(run, mask, first, charts, pieces, coordinates))
        first += len(run)
    return joined(parts)


def _part(
    run: Run, mask: np.ndarray, first: int, charts: Charts, pieces: np.ndarray, coordinates: bool
) -> PageTriangles:
    from ....patchnet_addon.octree.voxelize import triangle_areas_and_normals

    corners, mesh = run.corners_world(), run.instances.mesh
    areas, flat = triangle_areas_and_normals(corners)
    mask = mask & (areas > 0.0)
    normals = run.normals_world()
    if normals is None:
        normals = np.repeat(flat[:, None], 3, axis=1).astype(np.float32)
    uvs = np.zeros((len(run), 3, 2), np.float32) if mesh.uvs is None else run.per_corner(mesh.uvs)
    triangles = first + np.flatnonzero(mask)
    size = charts.page_size[charts.page[triangles]][:, None]
    layers = {name: run.per_corner(values) for name, values in mesh.layers.items()}
    for name, values in run.instances.values.items():
        of_triangle = np.repeat(values[run.lo : run.hi], run.last - run.first, axis=0)
        layers[name] = np.repeat(of_triangle[:, None], 3, axis=1)
    if coordinates:
        layers[OBJECT] = run.per_corner(mesh.vertices[mesh.triangles])
    return PageTriangles(
        triangles=triangles,
        corners_world=corners[mask],
        normals_world=normals[mask],
        uvs=uvs[mask],
        chart_uvs=(charts.corner_texels(triangles) / size).astype(np.float32),
        materials=run.materials()[mask],
        pieces=pieces[triangles],
        links=np.repeat(run.instances.links[run.lo : run.hi], run.last - run.first)[mask],
        layers={name: values[mask] for name, values in layers.items()},
    )


def fill_mesh(
    mesh: bpy.types.Mesh, part: PageTriangles, materials: Sequence[bpy.types.Material], offset_world: float
) -> None:
    """Fill an empty mesh with these triangles, moved by `offset_world` along their normals."""
    from ....patchnet_addon.octree.voxelize import triangle_areas_and_normals

    corners = part.corners_world + triangle_areas_and_normals(part.corners_world)[1][:, None] * offset_world
    add_polygons(mesh, corners)
    for material in materials:
        mesh.materials.append(material)
    mesh.polygons.foreach_set("material_index", part.materials.astype(np.int32))
    mesh.update(calc_edges=True)
    _add_layer(mesh, SURFACE_LAYER, part.uvs)
    mesh.uv_layers[SURFACE_LAYER].active_render = True
    _add_layer(mesh, CHART_LAYER, part.chart_uvs)
    for name, values in part.layers.items():
        _add_layer(mesh, name, values)
    normals = mesh.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER")
    normals.data.foreach_set("vector", np.ascontiguousarray(part.normals_world, np.float32).ravel())


def _add_layer(mesh: bpy.types.Mesh, name: str, values: np.ndarray) -> None:
    """Add a UV map or attribute of values (N, 3, C). `uv_layers.new` is limited to eight maps."""
    kind, key = {
        1: ("FLOAT", "value"), 2: ("FLOAT2", "vector"), 3: ("FLOAT_VECTOR", "vector"), 4: ("FLOAT_COLOR", "color")
    }[values.shape[-1]]  # fmt: skip
    attribute = mesh.attributes.new(name, kind, "CORNER")
    attribute.data.foreach_set(key, np.ascontiguousarray(values, np.float32).ravel())
