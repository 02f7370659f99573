# SPDX-License-Identifier: GPL-3.0-or-later
"""Fixtures of the tests of benchmarks, and how torch's threads wait, as in `patchnet lab train`."""

import os
import sys
from types import SimpleNamespace

import numpy as np
import pytest

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before a test loads torch


class GridOfSeven:
    """A voxel grid that says how many voxels it has as Open3D's does."""

    def __str__(self):
        return "VoxelGrid with 7 voxels."


@pytest.fixture
def peer(monkeypatch):
    """A stand-in for Open3D, which is large and optional, that keeps what it was given."""
    calls = SimpleNamespace(meshes=[], sides=[])

    def create(mesh, side):
        calls.meshes.append(mesh)
        calls.sides.append(side)
        return GridOfSeven()

    module = SimpleNamespace(
        __version__="0.0",
        utility=SimpleNamespace(Vector3dVector=np.asarray, Vector3iVector=np.asarray),
        geometry=SimpleNamespace(
            TriangleMesh=lambda vertices, triangles: vertices[triangles],
            VoxelGrid=SimpleNamespace(create_from_triangle_mesh=create),
        ),
    )
    monkeypatch.setitem(sys.modules, "open3d", module)
    return calls
