# SPDX-License-Identifier: GPL-3.0-or-later
"""Source hashes: version of the code behind a result, by following imports.

Cached and resumed results must come from the same code. The imports of a module are its dependencies, so no list of
folders has to be maintained.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
# Imports within this package are relative; those within functions count as well.
_IMPORT = re.compile(r"^[ \t]*from[ \t]+(\.+)([\w.]*)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)", re.MULTILINE)


def source_hash(*modules: str, root: Path = ROOT) -> str:
    """Hash (16 hex digits) of the sources of modules and of all modules of this package that they import.

    modules: names such as "operators.cycles.bake.bake". root: folder of the package. File names are not part of the
    hash; a moved file changes the imports of others.
    """
    digest = hashlib.sha256()
    for content in sorted(hashlib.sha256(path.read_bytes()).digest() for path in dependencies(modules, root)):
        digest.update(content)
    return digest.hexdigest()[:16]


@cache
def code_hash(module: str) -> str:
    """`source_hash` of a module of this package when it is first asked for."""
    return source_hash(module)


def dependencies(modules: Iterable[str], root: Path = ROOT) -> set[Path]:
    """Files of modules and of all modules of this package that they import, directly or indirectly.

    Raises ValueError for an unknown module.
    """
    waiting = []
    for name in modules:
        path = _file(root, name.split("."))
        if path is None:
            raise ValueError(f"There is no module {name} in {root}")
        waiting.append(path)
    found: set[Path] = set()
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            waiting.extend(_imported(root, path))
    return found


def _imported(root: Path, path: Path) -> list[Path]:
    """Files that a file imports, and their packages."""
    here = list(path.parent.relative_to(root).parts)
    found = []
    for dots, module, names in _IMPORT.findall(path.read_text(encoding="utf-8")):
        base = here[: len(here) - len(dots) + 1] + (module.split(".") if module else [])
        candidates = [base[:count] for count in range(1, len(base) + 1)]
        candidates += [[*base, name] for name in re.findall(r"\w+", re.sub(r"\bas\s+\w+|#.*", "", names))]
        found += [file for parts in candidates if (file := _file(root, parts)) is not None]
    return found


def _file(root: Path, parts: list[str]) -> Path | None:
    path = root.joinpath(*parts)
    for candidate in (path.with_name(f"{path.name}.py"), path / "__init__.py"):
        if candidate.is_file():
            return candidate
    return None
