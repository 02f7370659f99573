# SPDX-License-Identifier: GPL-3.0-or-later
"""Another extension that brings a newer llvmlite: PatchNet computes with its own."""

import shutil
import zipfile
from pathlib import Path

import pytest

from patchnet.tests.real_blender.executable import Blender

WHEEL = "llvmlite-99.0-py3-none-any.whl"
MANIFEST = f"""
schema_version = "1.0.0"
id = "other"
version = "1.0.0"
name = "Other"
tagline = "Brings a newer llvmlite"
maintainer = "Others"
type = "add-on"
blender_version_min = "4.5.0"
license = ["SPDX:GPL-3.0-or-later"]
wheels = ["./wheels/{WHEEL}"]
"""
JOB = "bpy.ops.patchnet.run_all(scope='VISIBLE', depth=5, light='two-lights', cameras='Far', size=(16, 16))"


@pytest.fixture
def other(tmp_path: Path) -> Path:
    """Zip of an extension with a wheel that cannot be imported."""
    wheel = tmp_path / WHEEL
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr("llvmlite/__init__.py", "raise ImportError('this llvmlite is of another extension')\n")
        info = "llvmlite-99.0.dist-info"
        archive.writestr(f"{info}/METADATA", "Metadata-Version: 2.1\nName: llvmlite\nVersion: 99.0\n")
        archive.writestr(
            f"{info}/WHEEL", "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        archive.writestr(
            f"{info}/RECORD", f"llvmlite/__init__.py,,\n{info}/METADATA,,\n{info}/WHEEL,,\n{info}/RECORD,,\n"
        )
    path = tmp_path / "other.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("blender_manifest.toml", MANIFEST)
        archive.writestr("__init__.py", "def register():\n    pass\n\n\ndef unregister():\n    pass\n")
        archive.write(wheel, f"wheels/{WHEEL}")
    return path


def test_its_own_wheels_compute(installed: Blender, archive: Path, other: Path, yard: Path, out: Path) -> None:
    resources, brought = out / "other-wheels", out / "other.zip"
    resources.mkdir()
    shutil.copy(other, brought)
    blender = Blender(
        installed.prefix, installed.program, installed.environment | {"BLENDER_USER_RESOURCES": str(resources)}
    )
    for path in (archive, brought):
        done = blender.run("--command", "extension", "install-file", "-r", "user_default", "--enable", path)
        assert done.returncode == 0, done.stdout + done.stderr
    done = blender.run("-b", yard, "--python-exit-code", "1", "--python-expr", f"import bpy; print({JOB})")
    said = done.stdout + done.stderr
    assert done.returncode == 0 and "{'FINISHED'}" in said and "Traceback" not in said, said
    assert "Another extension brings llvmlite 99.0 for all: PatchNet computes with its own" in said
    (folder,) = (resources / "extensions" / ".user" / "user_default" / "patchnet" / "cache" / "wheels").iterdir()
    assert {"llvmlite", "numba", "wheels.txt"} <= {path.name for path in folder.iterdir()}
