# SPDX-License-Identifier: GPL-3.0-or-later
"""Values that Blender's process exchanges with the engine's: pickled here, and read without numba and Blender."""

import pickle
import subprocess
import sys

import numpy as np

from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.image.background import Ground
from patchnet.patchnet_addon.light.rounds import first_round
from patchnet.patchnet_addon.lod.fitted_levels import FittedLevels
from patchnet.patchnet_addon.lod.memory import Contents
from patchnet.patchnet_addon.network.weights import load_weights
from patchnet.patchnet_addon.octree.leaf_levels import LeafLevels
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.ranking import rank
from patchnet.patchnet_addon.sampling.refined_picture import refined_view
from patchnet.patchnet_addon.sampling.registry import STRATEGIES
from patchnet.patchnet_addon.sampling.strokes import Painted
from patchnet.patchnet_addon.sampling.trace import trace_view
from patchnet.patchnet_addon.surface.gloss import Gloss
from patchnet.patchnet_addon.surface.local_mesh import LocalMesh
from patchnet.patchnet_addon.surface.mesh import Material
from patchnet.patchnet_addon.surface.scene_mesh import MeshInstances, SceneMesh
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.supersample import supersample

from .octree_samples import random_octree, with_boxes, with_sides

EYE = Camera.look_at(np.array([1.9, -1.1, 1.4]), np.full(3, 0.5), fov=0.8, size_px=(9, 7))

READ = """
import pickle, sys

sys.modules.update(dict.fromkeys(["numba", "llvmlite", "torch", "bpy", "mathutils"]))  # none can be imported
values = pickle.load(sys.stdin.buffer)
print(*(type(value).__name__ for value in values))
"""


def surface() -> SceneMesh:
    mesh = LocalMesh("Plate", np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.int32), None, None, None)
    slots, links = np.zeros((1, 1), np.int32), np.zeros(1, np.int32)
    part = MeshInstances(mesh, ("Plate",), np.eye(4)[None], slots, {}, links)
    return SceneMesh((part,), (Material("Paint"),), ("Paint",), [], (frozenset(),), (Gloss(),))


def exchanged() -> list[object]:
    """One of each kind, and a ranking by each strategy."""
    octree = with_sides(with_boxes(random_octree()))
    coded = drain(encode_octree(octree, load_weights()))
    rankings = []
    for strategy in STRATEGIES.values():
        buffers = drain(trace_view(octree, EYE, [strategy], coded=coded))
        rankings.append(rank(strategy, buffers, 0.2))
    refined = drain(refined_view(octree, EYE, rankings[0], rankings[0].refined_samples(16, 0.2)))
    levels = FittedLevels(LeafLevels.uniform(3, 1), 3, 64, None)
    parts = Contents(), first_round(4, 8), Ground(EYE, None, 1.0), drain(supersample(octree, EYE, 2))
    return [coded, *rankings, refined, levels, *parts, Painted(octree.grid, np.ones((2, 2), np.float32)), surface()]


def test_exchanged_values_need_neither_numba_nor_blender() -> None:
    values = exchanged()
    done = subprocess.run([sys.executable, "-c", READ], input=pickle.dumps(values), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    assert done.stdout.decode().split() == [type(value).__name__ for value in values]
