# SPDX-License-Identifier: GPL-3.0-or-later
"""The built wheel contains the whole tree."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PARTS = ("patchnet_addon", "operators", "training", "commands")
ROOT_FILES = ("__init__.py", "__main__.py", "blender_manifest.toml")
BUILD_FILES = ("pyproject.toml", "setup.py", "README.md", "LICENSE")


def package_files(root: Path) -> set[str]:
    """Every file of the package below `root`, as a path relative to it."""
    found = {path for part in PARTS for path in (root / part).rglob("*") if path.is_file()}
    kept = {path for path in found if "__pycache__" not in path.parts and not path.name.startswith(".")}
    return {path.relative_to(root).as_posix() for path in kept} | set(ROOT_FILES)


def build_wheel(source: Path, out: Path) -> set[str]:
    """Build the wheel of `source` into `out` and return the names in it."""
    command = [sys.executable, "-m", "pip", "wheel", str(source), "--no-build-isolation", "--no-deps", "-w", str(out)]
    done = subprocess.run([*command, "--quiet"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (wheel,) = out.glob("patchnet_blender-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the checkout, with one new package and one new data folder; a build leaves things beside the code."""
    copy = tmp_path_factory.mktemp("source") / "checkout"
    copy.mkdir()
    for name in {*ROOT_FILES, *BUILD_FILES}:
        shutil.copy(ROOT / name, copy / name)
    for part in PARTS:
        shutil.copytree(ROOT / part, copy / part, ignore=shutil.ignore_patterns("__pycache__", ".*"))
    new = copy / "patchnet_addon" / "new_folder" / "deeper"
    new.mkdir(parents=True)
    (new / "__init__.py").touch()
    (new.parent / "__init__.py").touch()
    data = copy / "patchnet_addon" / "new_data"
    data.mkdir()
    for name in ("weights.safetensors", "card.md", "table.json"):
        (data / name).write_text("{}")
    return copy


def test_wheel_holds_the_whole_tree(source: Path, tmp_path: Path) -> None:
    names = build_wheel(source, tmp_path)
    held = {name.removeprefix("patchnet/") for name in names if name.startswith("patchnet/")}
    assert held == package_files(source)


def test_every_folder_with_code_is_a_package() -> None:
    """But for presets: Blender runs their files, nobody imports them."""
    files = [path for part in PARTS for path in (ROOT / part).rglob("*.py")]
    folders = {path.parent for path in files if "presets" not in path.relative_to(ROOT).parts}
    assert [str(folder) for folder in sorted(folders) if not (folder / "__init__.py").is_file()] == []
