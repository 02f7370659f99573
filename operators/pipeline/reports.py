# SPDX-License-Identifier: GPL-3.0-or-later
"""Report file report.json, which lists all files of a job; a later job removes listed pictures that it omits."""

from __future__ import annotations

import contextlib
import json
import os
import platform
import sys
from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from typing import Any

import bpy
import numpy as np

from ...patchnet_addon.process.computed import refused
from ...patchnet_addon.process.own_wheels import other_versions
from ...patchnet_addon.runtime.file_kinds import EXR, PNG, REPORT, FileKind
from ...patchnet_addon.runtime.outputs import identities, identity
from ...patchnet_addon.runtime.replace import replaced_file
from ...patchnet_addon.runtime.versions import installed_version, own_version

REPORT_NAME = "report.json"
_PICTURES = {ending: kind for kind in (PNG, EXR) for ending in kind.endings}


def versions() -> dict[str, Any]:
    """Versions of PatchNet, Blender, Python and libraries; None for a missing one."""
    own = {} if refused() else {each.package: each.own for each in other_versions()}
    return {
        "patchnet": own_version(),
        "blender": bpy.app.version_string,
        "python": platform.python_version(),
        "numpy": np.__version__,  # Blender's own says it only in the module
        **{name: own.get(name) or installed_version(name) for name in ("numba", "torch")},
    }


def machine() -> dict[str, Any]:
    """Kind of machine, as far as timings depend on it."""
    return {"system": sys.platform, "processor": platform.machine(), "cores": os.cpu_count()}


def files_in(folder: Path) -> dict[str, int]:
    """Bytes of all files in a folder, by their paths in it."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {path.relative_to(folder).as_posix(): path.stat().st_size for path in files}


def write_report(folder: Path, job: str, report: dict[str, Any]) -> None:
    """Write the report of a `job` with the names of all files in `folder`; raises OutputError."""
    values = {"job": job, **report, "files": sorted({*files_in(folder), REPORT_NAME})}
    write_json(folder / REPORT_NAME, values, REPORT)


def write_json(path: Path, values: dict[str, Any], kind: FileKind) -> None:
    """Write plain values to `path`; raises OutputError."""
    with replaced_file(path, kind) as file:
        file.write((json.dumps(values, indent=2, allow_nan=False) + "\n").encode())


def reported(out: Path) -> tuple[str, frozenset[str]]:
    """Job that wrote the report in `out`, and paths of its files in the folder; empty if there is none of ours."""
    path = out / REPORT_NAME
    try:
        report = json.loads(path.read_text(encoding="utf-8")) if REPORT.is_at(path) else {}
        files = frozenset(name for name in report.get("files", ()) if is_inside(name))
    except (OSError, ValueError, TypeError, AttributeError):
        return "", frozenset()
    return str(report.get("job", "")), files


def remove_omitted(out: Path, before: tuple[str, frozenset[str]], inputs: Iterable[Path]) -> None:
    """Remove pictures in cameras' folders that the report `before`, see `reported`, named and that of the same job now
    omits.

    Other kinds of files, `inputs` and folders with other files stay.
    """
    (job_before, files_before), (job, files) = before, reported(out)
    if job_before != job:
        return
    keep = identities([*inputs, *(out / name for name in files)])  # the same file may have several names
    for name in files_before - files:
        path, parents = out / name, PurePosixPath(name).parents[:-1]
        kind, links = _PICTURES.get(path.suffix.lower()), (path, *(out / parent for parent in parents))
        if not parents or kind is None or any(part.is_symlink() for part in links):
            continue
        with contextlib.suppress(OSError):
            if identity(path) not in keep and kind.is_at(path):
                path.unlink()
            for parent in parents:
                (out / parent).rmdir()  # ends here if it is not empty


def is_inside(name: str) -> bool:
    """Return whether a path in a record cannot leave its folder."""
    path = PurePosixPath(name)
    return not path.is_absolute() and ".." not in path.parts and "\\" not in name and ":" not in name
