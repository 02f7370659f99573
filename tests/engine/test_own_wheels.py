# SPDX-License-Identifier: GPL-3.0-or-later
"""Wheels of this extension, where another extension brings newer versions: the engine process computes with its own."""

import os
import subprocess
import sys
import time
import zipfile
from importlib.metadata import distribution
from pathlib import Path

import pytest

from patchnet.patchnet_addon.process import own_wheels
from patchnet.patchnet_addon.runtime.cache_folder import WHEELS

ROOT = Path(__file__).resolve().parents[2]
BROUGHT = ("llvmlite", "numba")
TAG = "cp{}{}".format(*sys.version_info)

# Blender's process: an extension's folder, whose parent is first in the path after what other extensions bring.
OWNER = """
import logging, sys
sys.path[:] = {path!r}
logging.basicConfig(format="%(message)s", stream=sys.stdout)
import numpy as np
from patchnet.patchnet_addon.process import client
from patchnet.patchnet_addon.process import computed as process
from patchnet.tests.engine import process_work as work
{before}
process.use_engine_process()
print("total", process.answer(work.kernel_total, np.ones(100)))
print("from", process.answer(work.place_of, "llvmlite"))
print("refused", process.refused())
process.leave_engine_process()
"""


@pytest.fixture(scope="module")
def extension(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The extension as Blender installs it: the code, and wheels of the versions that are installed here."""
    folder = tmp_path_factory.mktemp("repository") / "patchnet"
    (folder / "wheels").mkdir(parents=True)
    for name in ("__init__.py", "blender_manifest.toml", "patchnet_addon", "tests", "training"):
        (folder / name).symlink_to(ROOT / name)
    for package in BROUGHT:
        found = distribution(package)
        with zipfile.ZipFile(folder / "wheels" / f"{package}-{found.version}-{TAG}-{TAG}-any.whl", "w") as wheel:
            for path in found.files or ():
                if path.parts[0] != ".." and path.suffix != ".pyc":
                    wheel.write(path.locate(), str(path))
    other_python = folder / "wheels" / "llvmlite-0.1.0-cp27-cp27m-any.whl"
    other_python.write_bytes(b"Blender installs no such wheel, and none may be read")
    return folder


@pytest.fixture(scope="module")
def newer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Blender's folder of wheels, with an llvmlite of another extension that cannot even be imported."""
    folder = tmp_path_factory.mktemp("site-packages")
    (folder / "llvmlite").mkdir()
    (folder / "llvmlite" / "__init__.py").write_text("raise ImportError('this llvmlite is of another extension')\n")
    (folder / "llvmlite-99.0.dist-info").mkdir()
    text = "Metadata-Version: 2.1\nName: llvmlite\nVersion: 99.0\n"
    (folder / "llvmlite-99.0.dist-info" / "METADATA").write_text(text)
    return folder


def said_by(extension: Path, cache: Path, *first: Path, before: str = "") -> dict[str, str]:
    """Lines of an owner by their first word; "told" has its warnings, "errors" what both processes wrote besides."""
    path = [*map(str, first), str(extension.parent), *sys.path]
    environment = os.environ | {"PATCHNET_CACHE": str(cache)}
    code = OWNER.format(path=path, before=before)
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False, cwd=cache
    )
    said = {"told": "", "errors": done.stderr}
    for line in done.stdout.splitlines():
        word, _, rest = line.partition(" ")
        said |= {word: rest} if word in ("total", "from", "refused") else {"told": said["told"] + line}
    return said


def test_newer_wheels_of_another_extension(extension: Path, newer: Path, tmp_path: Path) -> None:
    own = distribution("llvmlite").version
    said = said_by(extension, tmp_path, newer)
    assert said["total"] == "100.0", said
    (folder,) = (tmp_path / WHEELS).iterdir()
    assert Path(said["from"]).is_relative_to(folder)
    assert said["told"] == f"Another extension brings llvmlite 99.0 for all: PatchNet computes with its own {own}"
    assert {path.name for path in folder.iterdir()} >= {"llvmlite", "numba", "wheels.txt"}

    unpacked = (folder / "wheels.txt").stat().st_mtime_ns
    said = said_by(extension, tmp_path, newer)
    assert (folder / "wheels.txt").stat().st_mtime_ns == unpacked, "it is unpacked once"
    assert said["total"] == "100.0", said

    (folder / "wheels.txt").unlink()  # as a deletion that was stopped leaves it
    (folder / "llvmlite" / "__init__.py").unlink()
    left_over = folder.with_name(f".{folder.name}.01234567.tmp")
    left_over.mkdir()
    os.utime(left_over, (0, time.time() - 30 * 24 * 3600.0))
    assert said_by(extension, tmp_path, newer)["total"] == "100.0"
    assert list((tmp_path / WHEELS).iterdir()) == [folder]


def test_nothing_is_unpacked_without_need(extension: Path, tmp_path: Path) -> None:
    said = said_by(extension, tmp_path)
    assert said["total"] == "100.0" and said["told"] == "", said
    assert not (tmp_path / WHEELS).exists()


def test_without_a_process_the_danger_is_told(extension: Path, newer: Path, tmp_path: Path) -> None:
    """Blender's process imports what is there."""
    own = distribution("llvmlite").version
    said = said_by(extension, tmp_path, newer, before="client._python = lambda: '/bin/false'")
    danger = f"Another extension brings llvmlite 99.0 for all, PatchNet needs {own}: its kernels may fail"
    assert danger in said["told"] and "PatchNet cannot start its engine process" in said["told"]
    assert "this llvmlite is of another extension" in said["errors"]


def test_a_full_disk_is_told(extension: Path, newer: Path, tmp_path: Path) -> None:
    (tmp_path / WHEELS).write_text("no folder")
    said = said_by(extension, tmp_path, newer)
    assert f"llvmlite cannot be unpacked into {tmp_path / WHEELS}" in said["errors"]
    assert "make room, or name another folder" in said["errors"]


def test_a_checkout_has_no_wheels() -> None:
    assert own_wheels.other_versions() == [] == own_wheels.own_path()
