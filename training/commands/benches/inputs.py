# SPDX-License-Identifier: GPL-3.0-or-later
"""Octrees and triangles of benches: from files, or bumpy spheres."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np

from ....commands.shared.job_arguments import require_blender
from ....commands.shared.quiet import quiet_stdout
from ....patchnet_addon.network.devices import has_torch
from ....patchnet_addon.octree.build import build_octree
from ....patchnet_addon.octree.file import load_octree
from ....patchnet_addon.octree.grid import Grid
from ....patchnet_addon.octree.octree import Octree
from ....patchnet_addon.octree.voxelize import PLAIN_LEAVES, LeafDetail
from ....patchnet_addon.runtime.errors import PatchNetError
from ....patchnet_addon.runtime.progress import drain
from ....patchnet_addon.runtime.threads import limit_threads
from ....patchnet_addon.surface.mesh import Fragments, Shading, TriangleBatch, TriangleMesh
from ....patchnet_addon.surface.texture_lookup import BaseColors
from ....patchnet_addon.surface.textures import TextureTable
from ...benchmarks.shells import octree_of_shells, shell_triangles
from ...run import torch_threads

SHELLS = "shells"  # nested bumpy spheres, without a scene


def imported(title: str, module: str, advice: str = "patchnet-blender[peers]") -> ModuleType:
    """Import a module of another program; raises PatchNetError with the command to install it."""
    try:
        return import_module(module)
    except (ImportError, OSError) as cause:
        raise PatchNetError(f"{title} cannot be imported ({cause}): install {advice}") from cause


@contextmanager
def use_threads(count: int) -> Iterator[None]:
    """Limit PatchNet's kernels, and torch if it is installed, to so many threads."""
    with limit_threads(count), torch_threads(count) if has_torch() else nullcontext():
        yield


def given_octree(args: argparse.Namespace) -> tuple[Octree, str]:
    """Octree file, or a generated octree of `--nodes` nodes, and its name; raises PatchNetError."""
    if args.file is not None:
        return load_octree(args.file), args.file.name
    return octree_of_shells(args.nodes), SHELLS


def read_triangles(scene: Path | None) -> np.ndarray:
    """All placed triangles (T, 3, 3) of a scene file, in world units, or those of a bumpy sphere."""
    if scene is None:
        return shell_triangles(1.0)
    require_blender()
    import bpy

    from ....operators.scene.files import open_scene
    from ....operators.scene.read import read_scene

    with quiet_stdout():
        open_scene(scene)
        source = read_scene(bpy.context.evaluated_depsgraph_get())
        return np.concatenate([batch.corners_world for batch in source.batches()])


def voxelized(mesh: TriangleMesh, depth: int, *, exact: bool = False) -> Octree:
    """Octree of triangles under constant light, without textures; `exact`: with boxes and pieces of leaves."""
    detail, grid = PLAIN_LEAVES, Grid.around(mesh.bounds_world, depth)
    if exact:
        base = BaseColors(TextureTable.from_materials(mesh.materials), np.ones(len(mesh.materials), bool))
        detail = LeafDetail(boxes=True, base=base)
    return drain(build_octree(mesh, grid, _constant_light, exposure=1.0, detail=detail))


def _constant_light(_batch: TriangleBatch, fragments: Fragments) -> Shading:
    return Shading(np.full(len(fragments), 0.5, np.float32), np.ones(len(fragments), np.float32))
