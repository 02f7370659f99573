# SPDX-License-Identifier: GPL-3.0-or-later
"""`patchnet info FILE`: print the contents of an octree, codes or weights file. Reads and checks the whole file."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from ..patchnet_addon.runtime.files import FileHeader
from ..patchnet_addon.runtime.log import event
from ..patchnet_addon.runtime.quantities import counted


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    parser.add_argument("file", type=Path, help="a .safetensors file of PatchNet")
    parser.add_argument(
        "--weights", type=Path, help="for an octree: weights whose look-ahead is counted (the shipped ones)"
    )
    parser.add_argument("--json", action="store_true", help="print the metadata as JSON")


def run(args: argparse.Namespace) -> int:
    """Print the file's contents; returns 0; raises FileFormatError for foreign or damaged files."""
    from ..patchnet_addon.runtime.files import read_arrays, read_header

    header = read_header(args.file)
    read_arrays(args.file, header.kind)  # compares every array with its checksum
    if args.json:
        print(json.dumps({"kind": header.kind, "metadata": header.metadata}, indent=2))
        return 0
    print(f"{args.file}: PatchNet {header.kind}, file version {header.schema_version}")
    for line in _summary(header, args.file, args.weights):
        print(f"  {line}")
    print("Arrays:")
    for name, (dtype, shape) in header.arrays.items():
        print(f"  {name:<20} {dtype} {'x'.join(str(extent) for extent in shape)}")
    print("Metadata:")
    for line in _lines(header.metadata):
        print(f"  {line}")
    event("result", f"{args.file}: PatchNet {header.kind}", file=args.file, kind=header.kind)
    return 0


def _summary(header: FileHeader, path: Path, weights: Path | None) -> list[str]:
    """Summary of a file's contents; look-ahead is that of `weights`, None for the shipped ones."""
    from ..patchnet_addon.network.weights import load_weights

    if header.kind == "octree":
        from ..patchnet_addon.export.fine_light import fine_light_text
        from ..patchnet_addon.octree.exposure import exposure_text
        from ..patchnet_addon.octree.file import load_octree

        octree = load_octree(path)
        share = octree.look_ahead(load_weights(weights).lookahead).sum() / octree.node_count
        return [
            f"depth {octree.depth}, {counted(octree.leaf_count, 'voxel')} of side {octree.grid.voxel_size_world:.4g}, "
            f"{counted(octree.node_count, 'node')}",
            exposure_text(octree).lower(),
            *filter(None, [fine_light_text(octree).lower()]),
            f"{octree.nbytes / 2**20:.1f} MiB of nodes, look-ahead at {share:.1%} of them",
            f"in color, {octree.chroma.nbytes / 2**20:.1f} MiB of it"
            if octree.chroma is not None
            else "luminance only, no color",
            "one luminance per voxel"
            if octree.side_nodes is None
            else f"light by direction in {len(octree.side_nodes) / octree.node_count:.1%} of the nodes",
        ]
    if header.kind == "weights":
        held = load_weights(path)
        return [
            f"network {held.kind.name}, encoder {held.encoder_kind.name}, look-ahead {held.lookahead}",
            f"hash {held.hash}",
            f"{'with' if held.plus else 'without'} an error estimator",
        ]
    if header.kind == "codes":
        arrays = header.arrays
        codes, nodes = arrays["codes"][1], arrays["corner_rows" if "corner_rows" in arrays else "node_corners"][1]
        return [f"{codes[0]:,} codes of {codes[1]} values for {nodes[0]:,} voxels with look-ahead"]
    return []


def _lines(values: dict[str, Any], indent: str = "") -> list[str]:
    """Nested metadata as indented lines; only the length of long lists."""
    lines: list[str] = []
    for name, value in values.items():
        if isinstance(value, dict):
            lines += [f"{indent}{name}:", *_lines(value, indent + "  ")]
        elif isinstance(value, list) and len(value) > 8:
            lines.append(f"{indent}{name}: {counted(len(value), 'value')}")
        else:
            lines.append(f"{indent}{name}: {value}")
    return lines
