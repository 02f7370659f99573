# SPDX-License-Identifier: GPL-3.0-or-later
"""Read files of released versions in tests/data, or say how to make them anew.

    python -m patchnet.tests.engine.test_compatibility tests/data/1.0.0

writes those of a new version. What they hold must not change once it is released.
"""

import sys
from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.codes.coded_octree import CodedOctree
from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.codes.file import load_codes, save_codes
from patchnet.patchnet_addon.codes.predict import predict
from patchnet.patchnet_addon.network.encoders import MLP
from patchnet.patchnet_addon.network.kinds import MIXTURE
from patchnet.patchnet_addon.network.weights import Weights, load_weights, save_weights
from patchnet.patchnet_addon.octree.file import load_octree, save_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.voxelize import LeafDetail
from patchnet.patchnet_addon.runtime.errors import CodesFileError
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.tracing.camera import Camera
from patchnet.patchnet_addon.tracing.render import first_hits, seen_color

from .mesh_samples import octree_of
from .test_color import color_shade, soup

DATA = Path(__file__).parents[1] / "data"
VERSIONS = sorted(folder.name for folder in DATA.iterdir())


def picture(coded: CodedOctree) -> dict[str, np.ndarray]:
    """What a camera sees of an octree with its codes."""
    camera = Camera.look_at((2.0, -2.5, 1.5), (0.0, 0.0, 0.0), size_px=(24, 18))
    hits = first_hits(coded.octree, camera)
    predicted = predict(coded, hits)
    return {
        "node": hits.node, "luminance": hits.luminance, "color": seen_color(coded.octree, hits.node, hits.direction),
        "coverage": predicted.coverage, "predicted": predicted.luminance,
    }  # fmt: skip


def write(folder: Path) -> None:
    """Write an octree with all that one may have, untrained weights, codes, and what is seen of them."""
    folder.mkdir(parents=True)
    mesh, grid = soup(np.arange(150), []), Grid((-1.5, -1.5, -1.5), 3.0, 5)
    octree = octree_of(mesh, color_shade, grid, exposure=4.0, detail=LeafDetail(boxes=True, sides=True))
    weights = Weights.random(0, bias=0.1, lookahead=1, kind=MIXTURE.of_width(12), encoder=MLP.of_width(64))
    coded = drain(encode_octree(octree, weights))
    save_octree(octree, folder / "octree.safetensors")
    save_weights(weights, folder / "weights.safetensors")
    save_codes(coded, folder / "codes.safetensors")
    np.savez_compressed(folder / "seen.npz", **picture(coded))


@pytest.mark.parametrize("version", VERSIONS)
def test_files_of_a_released_version_show_what_they_showed(version: str) -> None:
    folder = DATA / version
    octree, weights = load_octree(folder / "octree.safetensors"), load_weights(folder / "weights.safetensors")
    for name in ("leaf_box", "chroma", "side_nodes", "bright_nodes"):
        assert getattr(octree, name) is not None
    try:
        coded = load_codes(folder / "codes.safetensors", octree, weights)
    except CodesFileError as error:
        assert "precompute the codes again" in str(error)
        coded = drain(encode_octree(octree, weights))
    with np.load(folder / "seen.npz") as seen:
        for name, values in picture(coded).items():
            np.testing.assert_allclose(values, seen[name], atol=2e-3 if "co" in name or "pre" in name else 1e-6)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
