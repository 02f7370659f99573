# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules of the extension platform for the code of the zip: docs/extensions-platform.md names them and their sources."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from .source_imports import imported_by

ROOT = Path(__file__).resolve().parents[2]
THREADS = {"threading", "_thread", "concurrent.futures", "multiprocessing.pool", "asyncio"}
NETWORK = {"socket", "ssl", "urllib", "http", "requests", "ftplib", "smtplib", "xmlrpc", "webbrowser"}
MODULES = THREADS | NETWORK | {"ctypes", "signal", "runpy", "imp"}
NAMES = {"sys.modules", "sys.path", "sys.setdlopenflags", "sys.meta_path", "os.system", "os.popen", "os.fork"}
BUILTINS = {"eval", "exec", "compile", "__import__"}

# Files that use what is forbidden in Blender's process, and why they may.
OUTSIDE = {
    # It hands the path of imports to the engine process, and changes nothing.
    "patchnet_addon/process/client.py": {"sys.path"},
    # The engine process alone imports these.
    "patchnet_addon/process/server.py": {"threading"},
    "patchnet_addon/process/start_engine.py": {"threading", "signal", "sys.path", "sys.modules"},
    # Kernels import it. Blender's process does if the system forbids the engine process, and then starts no thread.
    "patchnet_addon/runtime/threads.py": {"concurrent.futures"},
}
ENGINES_OWN = {"patchnet_addon/process/server.py", "patchnet_addon/process/start_engine.py"}
WHERE_REFUSED = {"patchnet_addon/runtime/threads.py"}
COMPILERS = {"numba", "llvmlite", "torch"}
# Files that use their own place: all read there, and none builds a path of imports from it.
OWN_PLACE = {
    "operators/gpu_view/shaders.py",  # shaders
    "operators/ui/presets_menu.py",  # presets, which Blender reads
    "patchnet_addon/network/weights.py",  # weights
    "patchnet_addon/process/client.py",  # script of the engine process
    "patchnet_addon/process/own_wheels.py",  # wheels, which it unpacks into the cache folder
    "patchnet_addon/runtime/source_hash.py",  # sources of kernels
    "patchnet_addon/runtime/versions.py",  # manifest
    "patchnet_addon/sampling/plus/weights.py",  # weights
}
# Files that open others for writing, and where those lie.
WRITING = {
    "commands/shared/quiet.py",  # the system's null device
    "operators/pipeline/job_work.py",  # the cache folder
    "patchnet_addon/codes/octree_cache.py",  # the cache folder
    "patchnet_addon/process/own_wheels.py",  # the cache folder
    "patchnet_addon/process/segments.py",  # memory, on Windows and macOS in the system's temporary folder
    "patchnet_addon/runtime/owned_folder.py",  # beside an output or in the cache folder
    "patchnet_addon/runtime/replace.py",  # outputs that the user names, after a check of what is there
    "patchnet_addon/runtime/streams.py",  # the system's null device
}
# Foreign keys are never changed, and no page of the web opened.
UNWANTED = re.compile(r"key(map|config)\w*\.(new|remove|clear)\b|url_open|bl_info|online_access|ensurepip|pip install")


@cache
def files_of_the_zip() -> dict[str, str]:
    """Texts of all modules in the zip, by their paths."""
    folders = ("commands", "operators", "patchnet_addon")
    paths = [ROOT / "__init__.py", *(path for folder in folders for path in (ROOT / folder).rglob("*.py"))]
    return {path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8") for path in paths}


def broken(code: str) -> set[str]:
    """Names of the rules that Python code breaks: modules that it imports, by any way, and names that it uses."""
    tree = ast.parse(code)
    imported, used = set(_imported(tree)), set(_used(tree))
    found = {rule for rule in MODULES | NAMES if any(f"{name}.".startswith(f"{rule}.") for name in imported)}
    return found | {rule for rule in NAMES | BUILTINS if any(f"{name}.".startswith(f"{rule}.") for name in used)}


def _imported(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            yield ast.unparse(node.args[0]).strip("'")


def _used(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            yield f"{node.value.id}.{node.attr}"
        elif isinstance(node, ast.Name):
            yield node.id


def writes(code: str) -> bool:
    """Return whether Python code opens files for writing."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Call):
            name = ast.unparse(node.func)
            modes = [each.value for each in (*node.args, *(word.value for word in node.keywords if word.arg == "mode"))
                     if isinstance(each, ast.Constant) and isinstance(each.value, str)]  # fmt: skip
            if name in ("open", "os.fdopen") or name.endswith(".open"):
                if name == "os.open" or any(re.fullmatch(r"[rwxabt+]*[wxa+][rwxabt+]*", mode) for mode in modes):
                    return True
            elif name.endswith((".write_text", ".write_bytes", "memfd_create", "tofile", "np.save")):
                return True
    return False


def test_blenders_process_keeps_the_rules_of_the_platform() -> None:
    found = {name: rules for name, text in files_of_the_zip().items() if (rules := broken(text))}
    assert found == OUTSIDE


def test_no_file_is_written_beside_the_code() -> None:
    texts = files_of_the_zip()
    assert {name for name, text in texts.items() if "__file__" in text} == OWN_PLACE
    assert {name for name, text in texts.items() if writes(text)} == WRITING


def test_keys_web_pages_and_legacy_names() -> None:
    found = {name: UNWANTED.findall(text) for name, text in files_of_the_zip().items() if UNWANTED.search(text)}
    assert found == {}


def is_of_the_engine(name: str) -> bool:
    """Return whether functions of a module compute: Blender's process imports the module, but calls none of them."""
    return name.startswith(("operators/computing/", "patchnet_addon/")) and not name.startswith(
        "patchnet_addon/process"
    )


@cache
def tree_of(name: str) -> ast.Module:
    """Syntax tree of a module."""
    return ast.parse(files_of_the_zip()[name])


def imports_in(tree: ast.AST, *, inside: bool) -> Iterator[ast.Import | ast.ImportFrom]:
    """Import statements, without those for types alone. inside: those in functions too."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        elif inside or not isinstance(node, ast.FunctionDef):
            yield from imports_in(node, inside=inside)


def imported(name: str, tree: ast.AST, *, inside: bool) -> Iterator[tuple[str, str, str]]:
    """Names that import statements of a module bind, their modules (paths in this tree, packages), and names there."""
    for node in imports_in(tree, inside=inside):
        for bound, module, there in imported_by(ROOT / name, node):
            yield bound, module if isinstance(module, str) else module.relative_to(ROOT).as_posix(), there


@cache
def in_blenders_process() -> dict[str, list[str]]:
    """Modules that Blender's process may import, and the way of imports to each.

    Imports in functions of the engine do not count: `computing` is about these.
    """
    begun = [name for name in files_of_the_zip() if not is_of_the_engine(name) and name not in ENGINES_OWN]
    ways = {name: [name] for name in begun}
    while begun:
        name = begun.pop()
        for _, other, _ in imported(name, tree_of(name), inside=not is_of_the_engine(name)):
            if other in files_of_the_zip() and other not in ways:
                ways[other] = [*ways[name], other]
                begun.append(other)
    return ways


@cache
def with_kernels() -> set[str]:
    """Compilers, and modules that import them at their top, also by others."""
    tops = {name: {other for _, other, _ in imported(name, tree_of(name), inside=False)} for name in files_of_the_zip()}
    found = set(COMPILERS)
    while more := {name for name, others in tops.items() if name not in found and not found.isdisjoint(others)}:
        found |= more
    return found


@cache
def computing() -> set[tuple[str, str]]:
    """Functions of the engine, by module and name, that import kernels or use a function that does."""
    uses: dict[tuple[str, str], set[tuple[str, str]]] = {}
    found = set()
    for name in filter(is_of_the_engine, set(files_of_the_zip()) - with_kernels()):
        functions = {node.name: node for node in tree_of(name).body if isinstance(node, ast.FunctionDef)}
        top = {bound: place for bound, *place in imported(name, tree_of(name), inside=False)}
        for function in functions.values():
            inside = {bound: place for bound, *place in imported(name, function, inside=True)}
            if any(module in with_kernels() for module, _ in inside.values()):
                found.add((name, function.name))
            names = {node.id for node in ast.walk(function) if isinstance(node, ast.Name)}
            places = {each: (name, each) for each in functions} | {
                each: tuple(at) for each, at in (top | inside).items()
            }
            uses[name, function.name] = {places[each] for each in names & places.keys()}
    while more := {each for each, others in uses.items() if each not in found and not found.isdisjoint(others)}:
        found |= more
    return found


def test_blenders_process_imports_no_kernels_and_no_threads() -> None:
    ways = in_blenders_process()
    assert len(ways) > 200
    with_threads = {name for name in ways if OUTSIDE.get(name, set()) & THREADS} | (ENGINES_OWN & ways.keys())
    assert {name: ways[name] for name in (with_kernels() & ways.keys() | with_threads) - WHERE_REFUSED} == {}


def test_blenders_process_calls_what_computes_by_the_engine_alone() -> None:
    """Functions that import kernels are named only as the first argument of `computed` or `answer`."""
    assert len(computing()) > 30
    found = []
    for name in (name for name in in_blenders_process() if not is_of_the_engine(name)):
        tree = tree_of(name)
        bound = {each: (module, other) for each, module, other in imported(name, tree, inside=True)}
        nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
        own = {node.id for node in nodes if isinstance(node.ctx, ast.Store)}
        calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and node.args]
        handed = {id(node.args[0]) for node in calls if ast.unparse(node.func) in ("computed", "answer")}
        found += [
            f"{name}:{node.lineno}: {node.id}" for node in nodes
            if bound.get(node.id) in computing() and id(node) not in handed and node.id not in own
        ]  # fmt: skip
    assert found == []


@pytest.mark.parametrize(
    ("code", "rule"),
    [
        ("import threading", "threading"),
        ("def f():\n    from concurrent import futures", "concurrent.futures"),
        ("from concurrent.futures import wait", "concurrent.futures"),
        ("import ctypes.util", "ctypes"),
        ("importlib.import_module('signal')", "signal"),
        ("from sys import path", "sys.path"),
        ("sys.path.insert(0, '')", "sys.path"),
        ("'bpy' in sys.modules", "sys.modules"),
        ("import urllib.request", "urllib"),
        ("from os import system", "os.system"),
        ("os.system('ls')", "os.system"),
        ("eval('1')", "eval"),
        ("run = exec", "exec"),
        ("compile('1', '', 'eval')", "compile"),
        ("__import__('x')", "__import__"),
    ],
)
def test_each_way_to_break_a_rule_is_found(code: str, rule: str) -> None:
    assert broken(code) == {rule}


@pytest.mark.parametrize(
    "code",
    [
        "from .threads import run_parts",
        "sys.pathless",
        "import multiprocessing.shared_memory",
        "shader.compile('a')",
        "socket.name",
    ],
)
def test_what_only_looks_alike_is_allowed(code: str) -> None:
    assert broken(code) == set()


@pytest.mark.parametrize(
    ("code", "is_writing"),
    [
        ("open('a', 'w')", True),
        ("path.open(mode='ab')", True),
        ("path.open('rb+')", True),
        ("path.write_text('a')", True),
        ("os.open('a', os.O_CREAT)", True),
        ("open('waxwork')", False),
        ("path.open('rb')", False),
    ],
)
def test_writing_is_found(code: str, is_writing: bool) -> None:
    assert writes(code) == is_writing
