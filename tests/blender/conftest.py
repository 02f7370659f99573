# SPDX-License-Identifier: GPL-3.0-or-later
"""Fixtures of the tests in Blender, whose process ends like the command: see `patchnet.__main__.leave`."""

import gc
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy
import pytest

import patchnet
from patchnet.__main__ import leave
from patchnet.patchnet_addon.light import surfel_cache
from patchnet.patchnet_addon.runtime.cache_folder import user_cache_folder
from patchnet.tests.blender.job_scene import build, moving_slab, random_weights
from patchnet.tests.blender.light_scene import on_bake

_status = pytest.StashKey[int]()
os.environ["PATCHNET_KEEP"] = "0"  # a test finds no octree of another one; test_octree_cache.py asks for some


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Remember the exit status for the very end."""
    session.config.stash[_status] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """Leave without unloading Blender, which may hang; pytest has printed its closing line by now."""
    if "bpy" in sys.modules and _status in config.stash:
        leave(config.stash[_status])


@pytest.fixture(scope="module", autouse=True)
def libraries_are_no_garbage() -> None:
    """Every job ends with a collection of garbage, which does not look through what lives on from before a file."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def light_of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of baked light that a test alone has; other processes have that of the cache folder."""
    folder = tmp_path_factory.mktemp("light")
    monkeypatch.setattr(surfel_cache, "user_cache_folder", lambda: folder)
    return folder


@pytest.fixture(scope="module")
def registered() -> Iterator[None]:
    """PatchNet is known to Blender while the tests of a file run."""
    patchnet.register()
    yield
    patchnet.unregister()


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of untrained weights."""
    return random_weights(tmp_path_factory.mktemp("weights"))


@pytest.fixture
def scene(registered: None, weights: Path) -> bpy.types.Scene:
    """The small scene, open, which uses those weights."""
    build()
    bpy.context.scene.patchnet.weights = str(weights)
    return bpy.context.scene


@pytest.fixture
def scene_file(tmp_path: Path) -> Path:
    """The small scene, open, as a .blend file; its slab moves at its frames 1 to 3."""
    return moving_slab(tmp_path)


@pytest.fixture
def empty_scene() -> None:
    """A file with nothing in it, open."""
    bpy.ops.wm.read_homefile(use_empty=True)


@pytest.fixture
def bakes(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of what Blender's bake is called for while a test runs."""
    seen: list[str] = []
    on_bake(monkeypatch, lambda target: seen.append(target.item.name))
    return seen


@pytest.fixture
def cache(tmp_path: Path) -> Path:
    """A cache folder of its own, with the kernels that are compiled already."""
    folder = tmp_path / "cache"
    folder.mkdir()
    kernels = user_cache_folder() / "kernels"
    kernels.mkdir(parents=True, exist_ok=True)
    (folder / "kernels").symlink_to(kernels)
    return folder
