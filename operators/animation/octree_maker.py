# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames that are an octree file each: what `patchnet octree --frames` makes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ...patchnet_addon.runtime.file_kinds import OCTREE, FileKind
from ...patchnet_addon.runtime.progress import Steps, drain
from ...patchnet_addon.runtime.stage_clock import StageClock
from ..pipeline.lit_octree import LitOctree, Recipe, build_lit_octree
from ..pipeline.output_files import OCTREE_NAME
from ..settings.job_settings import JobSettings
from .frame_maker import FrameMaker, SharedSettings


class OctreeMaker(FrameMaker):
    """Makes lit octrees alone, by settings and a recipe; `wanted` is all that the recipe depends on, as text."""

    def __init__(self, settings: JobSettings, recipe: Recipe, wanted: str) -> None:
        self._settings, self._recipe, self._wanted = settings, recipe, wanted
        self.scope, light = settings.surface.scope, settings.light
        self.exposure, self.bakes = light.exposure, light.is_baked

    def settings_text(self, common: SharedSettings) -> str:
        """Settings that the octree depends on."""
        return f"{self._of_frame(common)!r} {self._wanted}"

    def files(self, context: bpy.types.Context) -> dict[str, FileKind]:
        """Kind of the only file."""
        return {OCTREE_NAME: OCTREE}

    def make(self, context: bpy.types.Context, common: SharedSettings, folder: Path) -> Steps[dict[str, Any]]:
        """Write the octree of a frame."""
        from ...patchnet_addon.lightmap.page_cache import BakePageCache
        from ...patchnet_addon.octree.file import save_octree

        clock = StageClock()
        with BakePageCache() as kept:
            made = yield from build_lit_octree(context, self._of_frame(common), clock, kept, self._recipe)
            save_octree(made.octree, folder / OCTREE_NAME)
        octree = made.octree
        figures = {"depth": octree.depth, "nodes": octree.node_count, "leaves": octree.leaf_count}
        warnings = [*made.warnings, *self._unseen(made)]
        octree_figures = figures | {"bytes": octree.nbytes}
        return {"exposure": octree.exposure, "octree": octree_figures, "views": [], "warnings": warnings}

    def _unseen(self, made: LitOctree) -> list[str]:
        """Reasons why cameras that the octree is fitted to see nothing, or only black."""
        from ...patchnet_addon.tracing.unseen import why_unseen_by

        if made.layout is None or self._recipe.cameras is None:
            return []
        return why_unseen_by(made.octree, drain(self._recipe.cameras(made.source)))

    def _of_frame(self, common: SharedSettings) -> JobSettings:
        return self._settings.changed(exposure=common.exposure, daylight=common.daylight, bounds=common.bounds)
