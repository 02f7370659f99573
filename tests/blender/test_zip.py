# SPDX-License-Identifier: GPL-3.0-or-later
"""The extension's zip contains all that runs in Blender and nothing else."""

import ast
import re
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
STARTERS = {"patchnet_addon/process/client.py"}  # starts Blender's own Python: the engine process
WHEELS = [f"{name}-1-cp313-cp313-win_amd64.whl" for name in ("llvmlite", "numba")]


@pytest.fixture(scope="module")
def builder() -> Iterator[ModuleType]:
    """The script that builds zips."""
    sys.path.insert(0, str(ROOT / ".ci"))
    import build_extension

    yield build_extension
    sys.path.remove(str(ROOT / ".ci"))


@pytest.fixture(scope="module")
def plain(builder: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The plain zip."""
    path: Path = builder.build(ROOT, tmp_path_factory.mktemp("zip") / "patchnet.zip")
    return path


@pytest.fixture(scope="module")
def names(plain: Path) -> set[str]:
    """The files in the plain zip."""
    with zipfile.ZipFile(plain) as archive:
        return {name for name in archive.namelist() if not name.endswith("/")}


def test_all_code_of_blender_is_in_the_zip(names: set[str]) -> None:
    tree = {path for part in ("commands", "operators", "patchnet_addon") for path in (ROOT / part).rglob("*.py")}
    code = {path.relative_to(ROOT).as_posix() for path in tree}
    assert {name for name in names if name.endswith(".py")} == code | {"__init__.py"}
    assert {"LICENSE", "blender_manifest.toml", "patchnet_addon/network/weights/patchnet.safetensors"} <= names


def imported(name: str) -> Iterator[str]:
    """Files of the tree that a file imports, in functions too."""
    for node in ast.walk(ast.parse((ROOT / name).read_text())):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = (ROOT / name).parents[node.level - 1].joinpath(*(node.module or "").split("."))
            for path in (base, *(base / alias.name for alias in node.names)):
                for file in (path.with_suffix(".py"), path / "__init__.py"):
                    if file.is_file():
                        yield file.relative_to(ROOT).as_posix()


def test_nothing_in_the_zip_imports_what_was_left_out(names: set[str]) -> None:
    code = sorted(name for name in names if name.endswith(".py"))
    lost = {(name, file) for name in code for file in imported(name) if file not in names}
    assert lost == set()


def test_the_extension_starts_no_other_program_than_blender(names: set[str]) -> None:
    starters = {name for name in names if name.endswith(".py") and "subprocess" in (ROOT / name).read_text()}
    assert starters == STARTERS, "the platform takes what starts Blender alone: see docs/extensions-platform.md"


@pytest.mark.parametrize(
    ("more", "wrong"),
    [
        ([], []),
        (["wheels/numpy-2.2-cp313-cp313-win_amd64.whl"], ["wheels/numpy-2.2-cp313-cp313-win_amd64.whl"]),
        (["tests/test_x.py", "training/net.py"], ["tests/test_x.py", "training/net.py"]),
        (["operators/notes.blend", "patchnet_addon/torch.so"], ["operators/notes.blend", "patchnet_addon/torch.so"]),
    ],
)
def test_strangers_are_found(builder: ModuleType, names: set[str], more: list[str], wrong: list[str]) -> None:
    held = {*names, *(f"wheels/{name}" for name in WHEELS), *more}
    assert builder.strangers(held, WHEELS) == wrong
    torch = "torch-2.9-cp313-cp313-win_amd64.whl"
    assert builder.strangers({*names, f"wheels/{torch}"}, [torch]) == [f"wheels/{torch}"], "whatever is bundled"
    assert builder.strangers(names - {"LICENSE"}, WHEELS[:1]) == ["no LICENSE", f"no wheels/{WHEELS[0]}"]


@pytest.mark.parametrize(
    ("pythons", "first", "last"),
    [(["3.11"], "4.5.0", "5.1.0"), (["3.13"], "5.1.0", None), (["3.11", "3.13"], "4.5.0", None)],
)
def test_manifest_names_wheels_and_blenders(
    builder: ModuleType, pythons: list[str], first: str, last: str | None
) -> None:
    before = (ROOT / "blender_manifest.toml").read_text()
    manifest = tomllib.loads(builder.with_wheels_named(before, "windows-x64", pythons, WHEELS))
    assert manifest["wheels"] == [f"./wheels/{name}" for name in WHEELS] and manifest["platforms"] == ["windows-x64"]
    assert (manifest["blender_version_min"], manifest.get("blender_version_max")) == (first, last)
    kept = tomllib.loads(before)
    assert {name: manifest[name] for name in kept if name != "blender_version_min"} == {
        name: value for name, value in kept.items() if name != "blender_version_min"
    }


def test_bundled_versions_are_those_that_tests_use() -> None:
    tested = (ROOT / "constraints.txt").read_text().splitlines()
    lines = (ROOT / ".ci" / "wheels.txt").read_text().splitlines()
    bundled = [line.removesuffix(" \\") for line in lines if "==" in line and "--hash" not in line]
    assert len(bundled) == 2 and set(bundled) <= set(tested)
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text())
    credited = [line for line in manifest["copyright"] if "(" in line]
    assert sorted(re.findall(r"\((\w+)\)", " ".join(credited))) == sorted(line.partition("==")[0] for line in bundled)
