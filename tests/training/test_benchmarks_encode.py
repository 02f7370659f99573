# SPDX-License-Identifier: GPL-3.0-or-later
"""The benchmark of the encoder: what it prints, and that its products are those of the encoder."""

import importlib.util
import json
import sys

import numpy as np
import pytest

from patchnet.commands import main
from patchnet.patchnet_addon.network.encode import NumpyEncoder
from patchnet.patchnet_addon.network.encoders import MLP
from patchnet.patchnet_addon.network.kinds import CODE_SIZE
from patchnet.patchnet_addon.network.weights import Weights, save_weights
from patchnet.patchnet_addon.octree.file import save_octree
from patchnet.tests.engine.octree_samples import random_octree
from patchnet.training.benchmarks.encoding import record_chunks
from patchnet.training.benchmarks.products import encoder_products
from patchnet.training.settings import SHIPPED_WIDTH

SMALL = ["bench", "encode", "--nodes", "3000", "--corners", "100", "--repeats", "2"]


def said_json(capsys):
    values = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert {"name", "ours", "peer", "unit", "ratio"} <= values.keys()
    return values


def check(values, width=SHIPPED_WIDTH):
    assert (values["name"], values["unit"], values["octree"]) == ("encode", "corners per second", "shells")
    assert values["nodes"] >= 3000 and values["corners"] > 100 and 0 < values["occupied_cells"] < 1
    names = {"compiled", "numpy"} | ({"torch", "torch_plain"} if importlib.util.find_spec("torch") else set())
    assert values["corners_per_s"].keys() == values["share_of_peak"].keys() == names
    assert values["runs"].keys() == names | {"peak", "octree"}
    assert (values["torch"] is not None) == ("torch" in names)
    operations = values["operations_per_corner"]
    assert (
        0 < operations["not_zero"] < operations["needed"] < operations["plain"]
        == 2 * (2560 * width + 2 * width**2 + width * CODE_SIZE)
    )  # fmt: skip
    assert values["peak_gflops"] > 0 and values["octree_corners_per_s"] > 0
    assert values["index_bytes_per_voxel"] <= 16 and 0 < values["scratch_bytes"] < 64e6
    assert values["ratio"] == pytest.approx(values["ours"] / values["peer"])
    assert values["largest_difference"] <= 1e-4 + 1e-5 * values["largest_code"]
    assert [(row["depth"], row["columns"]) for row in values["products"]] == [
        (320, 8 * width), (width, width), (width, width), (width, CODE_SIZE)
    ]  # fmt: skip
    for row in values["products"]:
        assert all(row[name] > 0 for name in {"ours", "ours_on_its_values"} | names - {"compiled", "torch_plain"})
        assert 0 < row["zeros"] < 1


def test_all_cores(capsys):
    assert main([*SMALL, "--cores", "all", "--json"]) == 0
    values = said_json(capsys)
    check(values)
    assert values["clock"] == "wall" and len(values["runs"]["numpy"]) == 2
    assert main([*SMALL, "--threads", "1", "--json"]) == 0
    assert said_json(capsys)["threads"] == 1
    assert main([*SMALL, "--cores", "all"]) == 0
    shown = capsys.readouterr().out
    assert "Corners per second: ours" in shown and shown.count("\n| ") == 6


@pytest.mark.skipif(sys.platform == "win32", reason="no wait4")
def test_one_core_is_measured_where_every_library_has_one_thread(capsys, tmp_path):
    save_weights(Weights.random(2, encoder=MLP.of_width(64)), tmp_path / "narrow.safetensors")
    assert main([*SMALL, "--json", "--weights", str(tmp_path / "narrow.safetensors")]) == 0
    values = said_json(capsys)
    check(values, width=64)
    assert values["clock"] == "processor"


def test_an_octree_file_without_look_ahead_and_no_corners(tmp_path, capsys):
    path = tmp_path / "shallow.safetensors"
    save_octree(random_octree(depth=1, count=5), path)
    assert main(["bench", "encode", str(path), "--cores", "all"]) == 2
    assert "no corners to encode" in capsys.readouterr().err
    assert main(["bench", "encode", "--corners", "0"]) == 2
    assert "--corners 0 is outside 1 to" in capsys.readouterr().err


def test_products_are_those_of_the_encoder():
    """Within float32 rounding of another order of additions in the first layer."""
    weights = Weights.random(seed=4, bias=0.1)
    octree = random_octree(seed=8, depth=5, count=500)
    (chunk,) = record_chunks(octree, weights, 100)
    work = chunk.blocks, chunk.rows
    codes = encoder_products(work, weights)[-1].reference()
    np.testing.assert_allclose(codes, NumpyEncoder(weights)(*work), atol=1e-4)
