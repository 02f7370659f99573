# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules for kernels that numba does not check: what breaks them compiles, and goes wrong without a word."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from patchnet.patchnet_addon.tracing.tile import ray_of

ROOT = Path(__file__).resolve().parents[2]
MODULES = [path for folder in ("patchnet_addon", "training") for path in sorted((ROOT / folder).rglob("*.py"))]


def kernels(source: str) -> Iterator[ast.FunctionDef]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef) and any(ast.unparse(name) == "kernel" for name in node.decorator_list):
            yield node


def lost_writes(kernel: ast.FunctionDef) -> list[str]:
    """Assignments to elements of an attribute, which numba drops in a parallel function (numba issue 5872)."""
    found = []
    for node in ast.walk(kernel):
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for target in targets:
            parts = target.elts if isinstance(target, ast.Tuple) else [target]
            found += [
                ast.unparse(part)
                for part in parts
                if isinstance(part, ast.Subscript) and isinstance(part.value, ast.Attribute)
            ]
    return found


def test_no_kernel_writes_to_an_array_in_a_tuple() -> None:
    found = [(path.name, kernel) for path in MODULES for kernel in kernels(path.read_text(encoding="utf-8"))]
    assert len(found) > 10
    assert [(name, kernel.name, lost) for name, kernel in found if (lost := lost_writes(kernel))] == []


@pytest.mark.parametrize("line", ["hits.node[i] = 1", "hits.node[i] += 1", "hits.node[i], x = 1, 2"])
def test_such_writes_are_found(line: str) -> None:
    (kernel,) = kernels(f"@kernel\ndef trace(hits):\n    for i in prange(3):\n        {line}\n")
    assert lost_writes(kernel) == ["hits.node[i]"]


def test_python_cannot_call_a_device_function():
    """It has no code for that: a call would end the process."""
    with pytest.raises(TypeError, match="ray_of is a device function: call it from a kernel, or its py_func"):
        ray_of(1, 2)
    assert ray_of.py_func(4, 4) == 48
