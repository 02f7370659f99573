# SPDX-License-Identifier: GPL-3.0-or-later
"""How torch's threads wait, as in `patchnet lab train`; the octree that evaluations and trainings share."""

import os
from pathlib import Path

import pytest

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # before a test loads torch


@pytest.fixture(scope="session")
def shells_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Octree file of nested shells with 30,000 nodes."""
    from patchnet.patchnet_addon.octree.file import save_octree
    from patchnet.training.benchmarks.shells import octree_of_shells

    path = tmp_path_factory.mktemp("octree") / "shells.safetensors"
    save_octree(octree_of_shells(30_000), path)
    return path
