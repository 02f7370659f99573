# SPDX-License-Identifier: GPL-3.0-or-later
"""Direction of imports: training/commands -> commands -> operators -> patchnet_addon; rules for kernels."""

import ast
import importlib
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from numba.core.registry import CPUDispatcher

from patchnet.patchnet_addon.runtime import kernels
from patchnet.patchnet_addon.surface import polygon
from patchnet.patchnet_addon.tracing.tile import ray_of

from .source_imports import imported_by

ROOT = Path(__file__).resolve().parents[2]
RESEARCH = ROOT / "training/commands"  # may import all
FORBIDDEN = {
    "patchnet_addon": ("operators", "training", "commands"),
    "training": ("operators", "commands"),
    "operators": ("training", "commands"),
    "commands": ("training",),
}

IMPORT_ALL = """
import importlib, pkgutil, sys

packages, blocked, skipped = (set(words.split(",")) for words in sys.argv[1:4])
sys.modules.update(dict.fromkeys(blocked))  # none can be imported
for package in map(importlib.import_module, packages):
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
        if not module.name.endswith("__main__") and not any(word and word in module.name for word in skipped):
            importlib.import_module(module.name)
            print(module.name)
"""

BLENDER = ("bpy", "bmesh", "gpu", "mathutils", "addon_utils")
NOT_IN_THE_ZIP = ("torch", "safetensors", "scipy", "skimage", "PIL", "matplotlib")

LIGHT = """
import sys
import patchnet, patchnet.__main__, patchnet.commands
heavy = {"bpy", "numba", "torch", "numpy"} & set(sys.modules)
assert not heavy, heavy
"""


def run_python(code: str, *arguments: str) -> str:
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def modules_of(part: str) -> list[Path]:
    return sorted(path for path in (ROOT / part).rglob("*.py") if "__pycache__" not in path.parts)


@cache
def imported(path: Path) -> list[tuple[str, Path | str, str]]:
    """What all import statements of a module bind, those within functions too: see `imported_by`."""
    nodes = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Import | ast.ImportFrom)]
    return [found for node in nodes for found in imported_by(path, node)]


def imported_parts(path: Path) -> set[str]:
    """The top folders of this tree, and other packages, that a module imports."""
    return {module if isinstance(module, str) else module.relative_to(ROOT).parts[0] for _, module, _ in imported(path)}


def test_engine_and_training_import_without_blender() -> None:
    pytest.importorskip("torch")
    packages = "patchnet.patchnet_addon,patchnet.training"
    imported = run_python(IMPORT_ALL, packages, ",".join(BLENDER), "training.commands").split()
    assert {"patchnet.patchnet_addon.runtime.errors", "patchnet.training.settings"} <= set(imported)


def test_engine_imports_with_what_the_extension_bundles() -> None:
    """Only files named for torch may need it, and nothing needs what Blender users do not have."""
    imported = run_python(IMPORT_ALL, "patchnet.patchnet_addon", ",".join(BLENDER + NOT_IN_THE_ZIP), "torch").split()
    assert "patchnet.patchnet_addon.runtime.errors" in imported


def test_command_and_package_are_light() -> None:
    run_python(LIGHT)


@pytest.mark.parametrize("part", sorted(FORBIDDEN))
def test_direction_of_imports(part: str) -> None:
    modules = [path for path in modules_of(part) if not path.is_relative_to(RESEARCH)]
    found = {path.relative_to(ROOT).as_posix(): imported_parts(path) for path in modules}
    assert {name: parts for name, parts in found.items() if not parts.isdisjoint(FORBIDDEN[part])} == {}


@pytest.mark.parametrize("part", FORBIDDEN)
def test_only_relative_imports(part: str) -> None:
    """The tree is `patchnet` for pip and `bl_ext.<repository>.patchnet` in Blender, so it never names itself."""
    assert [path.name for path in modules_of(part) if "patchnet" in imported_parts(path)] == []


def circle(graph: dict[Path, set[Path]]) -> list[str]:
    """Nodes that lead from one back to itself; none if there is no circle."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as found:
        return [str(path.relative_to(ROOT)) for path in found.args[1]]
    return []


@pytest.fixture(scope="module")
def graph() -> dict[Path, set[Path]]:
    """Imports of all product modules, those within functions and for types alone too."""
    paths = [path for part in FORBIDDEN for path in modules_of(part)]
    return {path: {module for _, module, _ in imported(path) if isinstance(module, Path)} - {path} for path in paths}


def test_no_files_import_each_other_in_circles(graph: dict[Path, set[Path]]) -> None:
    assert len(graph) > 200
    assert circle(graph) == []


def test_no_folders_import_each_other_in_circles(graph: dict[Path, set[Path]]) -> None:
    folders: dict[Path, set[Path]] = {}
    for path, imported in graph.items():
        folders.setdefault(path.parent, set()).update({other.parent for other in imported} - {path.parent})
    assert circle(folders) == []


CHANGES = frozenset(
    {"add", "append", "clear", "discard", "extend", "insert", "pop", "popitem", "remove", "setdefault", "update"}
)


def written_elsewhere(path: Path) -> list[str]:
    """Statements of a module that assign to names of other modules or to their parts, or call what changes them."""
    names = [(bound, there) for bound, module, there in imported(path) if isinstance(module, Path)]
    modules, others = ({bound for bound, there in names if bool(there) == is_name} for is_name in (False, True))
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        changed, least = None, 0
        if isinstance(node, ast.Attribute | ast.Subscript) and isinstance(node.ctx, ast.Store | ast.Del):
            changed = node.value
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in CHANGES:
            changed, least = node.func.value, 1  # a module may have a function of that name
        depth = 0
        while isinstance(changed, ast.Attribute | ast.Subscript):
            changed, depth = changed.value, depth + 1
        if isinstance(changed, ast.Name) and (changed.id in others or (changed.id in modules and depth >= least)):
            found.append(f"{path.relative_to(ROOT)}:{node.lineno}: {ast.unparse(node)}")
    return found


def test_no_module_of_blender_writes_names_of_another() -> None:
    assert [line for path in modules_of("operators") for line in written_elsewhere(path)] == []


def test_such_writing_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "room.py").write_text("shown = {}\nclass Job: pass\n")
    path = tmp_path / "other.py"
    written = "room.shown = 1", "room.shown[0] = 1", "shown[0] = heat = 1", "del shown[0]", "Job.title += ''"
    written += "shown.clear()", "room.shown.pop(0)", "shown[0].heats.append(1)"
    path.write_text(
        "\n".join(("from . import room", "from .room import Job, shown", *written, "room.clear()", "Job().a = 1"))
    )
    monkeypatch.setattr(f"{__name__}.ROOT", tmp_path)
    assert [int(line.split(":")[1]) for line in written_elsewhere(path)] == [*range(3, 3 + len(written))]


def is_empty(value: ast.expr | None) -> bool:
    """Return whether an expression is a list, set or dictionary to be filled, or an object without arguments."""
    if isinstance(value, ast.Call):
        return not (value.args or value.keywords)
    return isinstance(value, ast.List | ast.Dict) and not (value.keys if isinstance(value, ast.Dict) else value.elts)


def test_state_of_blender_is_parts_of_the_window_state() -> None:
    """Modules keep none themselves; two count open blocks."""
    found = []
    for path in modules_of("operators"):
        tree = ast.parse(path.read_text())
        kept = [node for node in tree.body if isinstance(node, ast.Assign | ast.AnnAssign) and is_empty(node.value)]
        kept += [node for node in ast.walk(tree) if isinstance(node, ast.Global)]
        found += [f"{path.name}: {ast.unparse(node)}" for node in kept]
    assert found == ["overrides.py: _changes: list[tuple[Act, Act]] = []", "own.py: global _blocks"]


def test_timers_are_those_that_registration_ends() -> None:
    """Functions that Blender's timers call stand in TIMERS of their module."""
    for path in modules_of("operators"):
        tree = ast.parse(path.read_text())
        started = {
            ast.unparse(node.args[0])
            for node in ast.walk(tree)
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "bpy.app.timers.register"
        }
        if path.name != "registration.py" and started:
            (timers,) = (node for node in tree.body if ast.unparse(node).startswith("TIMERS = "))
            assert started == {ast.unparse(item) for item in timers.value.elts}, path
            name = ".".join(path.relative_to(ROOT / "operators").with_suffix("").parts)
            assert f'"{name}",' in (ROOT / "operators" / "registration.py").read_text(), path


def test_python_cannot_call_a_device_function():
    """It has no code for that: a call would end the process."""
    with pytest.raises(TypeError, match="ray_of is a device function: call it from a kernel, or its py_func"):
        ray_of(1, 2)
    assert ray_of.py_func(4, 4) == 48


def test_compiled_functions_have_names_of_their_own():
    """Those of two processes in the cache are linked by name: functions made by one line would be taken for another."""
    names = {}
    for name in kernels._with_kernels():
        try:
            module = importlib.import_module(f"patchnet.{name}")
        except ModuleNotFoundError as missing:
            if missing.name != "torch":
                raise
            continue  # training, which is not done here
        for value in vars(module).values():
            if isinstance(value, CPUDispatcher):
                function = value.py_func
                assert "<locals>" not in function.__qualname__
                cells = tuple(cell.cell_contents for cell in function.__closure__ or ())
                key = function.__module__, function.__qualname__
                assert names.setdefault(key, (function.__code__, cells)) == (function.__code__, cells)
    splits = polygon.split_x, polygon.split_y, polygon.split_z
    assert len({split.py_func.__qualname__ for split in splits}) == 3
