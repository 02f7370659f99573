# SPDX-License-Identifier: GPL-3.0-or-later
"""File kinds of research by content; see `patchnet_addon/runtime/file_kinds.py`."""

import json
import zipfile
from pathlib import Path

from ..patchnet_addon.runtime.file_kinds import FileKind, arrays_kind, begins, head


def _is_log(path: Path) -> bool:
    first = json.loads(head(path, 1 << 16).splitlines()[0]).keys()
    return "step" in first and not first.isdisjoint(("coverage", "validation", "loss"))


def _is_checkpoint(path: Path) -> bool:
    with zipfile.ZipFile(path) as archive:
        return any(name.endswith("/data.pkl") for name in archive.namelist())


def _is_svg(path: Path) -> bool:
    return b"<svg" in head(path, 4096) or b"<!DOCTYPE svg" in head(path, 4096)


WEIGHTS, SAMPLES = arrays_kind("weights"), arrays_kind("samples")
SVG = FileKind("an .svg picture", (".svg",), _is_svg)
GLB = FileKind("a .glb file", (".glb",), begins(b"glTF"))
SCENE_CREDITS = FileKind("credits of a scene", (".txt",), begins(b"# Credits of a scene composed by patchnet"))
CHECKPOINT = FileKind("a checkpoint of a training run", (".pt",), _is_checkpoint)
TRAINING_LOG = FileKind("a log of a training run", (".jsonl",), _is_log)
EVALUATION = FileKind("results of an evaluation", (".json",), begins(b'{\n "settings": {\n  "frames": '))
CYCLES_EVALUATION = FileKind(
    "results of an evaluation against Cycles", (".json",), begins(b'{\n "settings": {\n  "cameras": ')
)
EVALUATION_TABLES = FileKind("tables of an evaluation", (".md",), begins(b"# Tables of an evaluation"))
COSTS = FileKind("costs of an evaluation", (".json",), begins(b'{"key": '))
ERRORS = FileKind("errors of weights", (".json",), begins(b'{\n "errors": {'))
FIGURE_VALUES = FileKind("values of a figure of PatchNet", (".json",), begins(b'{\n "figure": '))
