# SPDX-License-Identifier: GPL-3.0-or-later
"""Call every kernel of codes and pictures once, on an octree of a few thousand nodes: a Python runs this as a script.

    python call_kernels.py PACKAGE FOLDER SEARCH_PATH...

PACKAGE: the extension's name among modules, which compiled kernels carry in them; FOLDER: where it lies; SEARCH_PATH:
entries of sys.path of the calling process. Kernels that a job needs last are called first, because the job compiles the
others meanwhile.
"""

import importlib
import sys
from pathlib import Path
from types import ModuleType

DEPTH = 4
SIZE = (24, 16)


def import_package(name: str, folder: str, search_path: list[str]) -> ModuleType:
    """Import the extension under its name, though its repository is not among any preferences."""
    sys.path += [entry for entry in search_path if entry not in sys.path]
    *parents, _ = name.split(".")
    for count in range(1, len(parents) + 1):
        parent = ModuleType(".".join(parents[:count]))
        parent.__path__ = []
        sys.modules[parent.__name__] = parent
    if parents:
        parent.__path__ = [str(Path(folder).parent)]
    return importlib.import_module(name)


def main(package: str, folder: str, *search_path: str) -> None:
    """Call the kernels."""
    import_package(package, folder, list(search_path))
    engine = f"{package}.patchnet_addon"

    def part(name: str) -> ModuleType:
        return importlib.import_module(f"{engine}.{name}")

    import numpy as np

    drain = part("runtime.progress").drain
    start = np.cumsum([0, *(8**level for level in range(DEPTH + 1))])
    nodes, inner = int(start[-1]), int(start[-2])
    octree = part("octree.octree").Octree(  # without a gap
        grid=part("octree.grid").Grid((0.0, 0.0, 0.0), 1.0, DEPTH),
        level_start=start,
        child_mask=np.where(np.arange(nodes) < inner, 255, 0).astype(np.uint8),
        first_child=np.where(np.arange(nodes) < inner, 8 * np.arange(nodes) + 1, 0).astype(np.uint32),
        area_world=np.ones(nodes, np.float32),
        luminance=np.ones(nodes, np.uint16),
        normal=np.ones((nodes, 3), np.int8),
    )
    middle = np.full(3, 0.5)
    camera = part("tracing.camera").Camera.look_at(np.array([-2.0, 0.5, 0.5]), middle, size_px=SIZE)
    weights = part("network.weights").load_weights()
    hits = part("tracing.render").fine_hits(octree, camera)[0]
    coded_nodes, count = part("codes.corner_rows").coded_nodes(octree, weights.lookahead)
    rows, codes = np.zeros((count, 3), np.uint32), np.zeros((2, 10), np.float16)
    around = np.zeros((len(codes), 8), np.uint32) if weights.kind.mixes else None
    coded = part("codes.coded_octree").CodedOctree(octree, weights, codes, rows, coded_nodes, around)
    part("codes.predict").predict(coded, hits)
    drain(part("tracing.supersample").supersample(octree, camera, 2))
    registry = part("sampling.registry")
    default = registry.STRATEGIES[registry.DEFAULT]
    default.scores(drain(part("sampling.trace").trace_view(octree, camera, [default], coded=coded, reference=False)))
    drain(part("codes.encode").encode_octree(octree, weights))


if __name__ == "__main__":
    main(*sys.argv[1:])
