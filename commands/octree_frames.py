# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet octree --frames`: an octree file for each frame."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from ..operators.animation.frame_maker import Common, FrameMaker
from ..operators.pipeline.output_files import OCTREE_NAME
from ..operators.scene.placements import VISIBLE
from ..patchnet_addon.lightmap.page_cache import KeptPages
from ..patchnet_addon.octree.file import save_octree
from ..patchnet_addon.runtime.file_kinds import OCTREE, FileKind
from ..patchnet_addon.runtime.progress import Steps
from .octree import build, hide_from_renders, without
from .shared.stage_clock import StageClock

_NOT_IN_FILES = ("scene", "out", "frames", "overwrite", "same_grid", "timings", "command")


class OctreeMaker(FrameMaker):
    """Lit octrees alone."""

    def __init__(self, args: argparse.Namespace, clock: StageClock) -> None:
        self._args, self._clock = args, clock
        self.scope, self.exposure, self.bakes = VISIBLE, args.exposure, args.light == "cycles"
        if texts := without(args):
            bpy.app.handlers.frame_change_post.append(_hide(texts))  # their keys may show them again

    def settings_text(self, common: Common) -> str:
        """Arguments that the octree depends on."""
        values = vars(self._of_frame(common))
        return repr(sorted((name, value) for name, value in values.items() if name not in _NOT_IN_FILES))

    def files(self, context: bpy.types.Context) -> dict[str, FileKind]:
        """Return the kind of the one file that is made."""
        return {OCTREE_NAME: OCTREE}

    def make(self, context: bpy.types.Context, common: Common, folder: Path) -> Steps[dict[str, Any]]:
        """Write the one file."""
        with KeptPages() as kept:
            octree = yield from build(self._of_frame(common), self._clock, kept)
            with self._clock.stage("save"):
                save_octree(octree, folder / OCTREE_NAME)
        figures = {"depth": octree.depth, "nodes": octree.node_count, "leaves": octree.leaf_count}
        return {"exposure": octree.exposure, "octree": figures | {"bytes": octree.nbytes}, "views": []}

    def _of_frame(self, common: Common) -> argparse.Namespace:
        values = {"exposure": common.exposure, "daylight": common.daylight, "bounds": common.bounds}
        return argparse.Namespace(**(vars(self._args) | values))


def _hide(texts: list[str]) -> Callable[..., None]:
    return lambda *_: hide_from_renders(texts)
