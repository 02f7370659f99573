# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures that are shown before a job's view is traced: of the first ray of each pixel, and of a stand-in's."""

from __future__ import annotations

import numpy as np

from ...patchnet_addon.image.background import BLACK, Ground
from ...patchnet_addon.image.unfinished import Meanwhile, Unfinished
from ...patchnet_addon.octree.grid import Grid
from ...patchnet_addon.octree.octree import Octree
from ...patchnet_addon.process.computed import computed
from ...patchnet_addon.runtime.progress import Progress, Steps
from ...patchnet_addon.surface.scene_mesh import SceneMesh
from ...patchnet_addon.tracing.camera import Camera
from ..computing.grids import GridChoice
from ..computing.octrees import stand_in_octree
from ..computing.views import first_picture
from ..settings.job_settings import JobSettings

STAND_IN_DEPTH = 8  # largest depth of the voxels that are shown before the bake
STAND_IN = "two lights, until baked"


def first_look(
    octree: Octree,
    camera: Camera,
    meanwhile: Meanwhile,
    title: str = "preview",
    *,
    background: np.ndarray | None = BLACK,
) -> Steps[None]:
    """Trace the first ray of every pixel, and show the picture with a title over a background, see `View`."""
    ground = Ground(camera, background, octree.exposure)
    tracing = Progress(0, 1, f"{camera.name}: Tracing the preview")
    picture = yield from computed(first_picture, octree, ground, at=tracing)
    meanwhile(Unfinished(camera.name, title, picture))


def stand_in_look(
    source: SceneMesh, choice: GridChoice, settings: JobSettings, camera: Camera, meanwhile: Meanwhile
) -> Steps[None]:
    """Show a camera's view before the bake: coarse voxels in two lights without shadows.

    It is fast, and shows the objects and the camera of the bake.
    """
    grid = Grid.around(settings.surface.bounds_world(source), min(choice.grid.depth, STAND_IN_DEPTH))
    octree = yield from computed(stand_in_octree, source, grid, settings, at=Progress(0, 1, "Voxelizing"))
    yield from first_look(octree, camera, meanwhile, STAND_IN)
