# SPDX-License-Identifier: GPL-3.0-or-later
"""Embree's closest hits by embreex (https://pypi.org/project/embreex), the peer of the tracer; one thread."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from ...patchnet_addon.runtime.errors import PatchNetError
from ...patchnet_addon.tracing.camera import PERSPECTIVE, Camera


def import_embree() -> ModuleType:
    """Embree's scenes, or a PatchNetError that says how to get them."""
    try:
        from embreex import mesh_construction, rtcore_scene  # noqa: F401
    except (ImportError, OSError) as cause:
        raise PatchNetError(f"Embree cannot be imported ({cause}): install patchnet-blender[peers]") from cause
    return rtcore_scene


class EmbreeScene:
    """Triangles (T, 3, 3) in Embree's bounding volume hierarchy."""

    def __init__(self, corners_world: np.ndarray) -> None:
        """Build the hierarchy; around the middle of the triangles, since Embree computes in float32."""
        from embreex.mesh_construction import TriangleMesh

        self._scene = import_embree().EmbreeScene()
        corners = corners_world.reshape(-1, 3)
        self._middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        TriangleMesh(self._scene, (corners_world - self._middle).astype(np.float32))

    @property
    def name(self) -> str:
        """Program and version."""
        from importlib.metadata import version

        return f"Embree {version('embreex').partition('.post')[0]}"

    def rays(self, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
        """Origins and directions (P, 3) float32 of the pixels' centre rays; made before anything is timed."""
        row, column = np.divmod(np.arange(camera.pixel_count), camera.width_px)
        x = (2 * column + 1) / camera.width_px - 1 + camera.shift_x
        y = (2 * row + 1) / camera.height_px - 1 + camera.shift_y
        across = x[:, None] * camera.half_x * camera.right + y[:, None] * camera.half_y * camera.up
        origin = np.repeat((camera.position_world - self._middle)[None], camera.pixel_count, axis=0)
        if camera.kind == PERSPECTIVE:
            direction = camera.forward + across
        else:
            origin, direction = origin + across, np.repeat(camera.forward[None], camera.pixel_count, axis=0)
        direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
        return origin.astype(np.float32), direction.astype(np.float32)

    def trace(self, rays: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """Triangles (P,) int32 that rays meet first, -1 for none."""
        found: np.ndarray = self._scene.run(*rays, query="INTERSECT")
        return found
