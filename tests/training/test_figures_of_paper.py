# SPDX-License-Identifier: GPL-3.0-or-later
"""Figures 2 and 4 of the paper on small octrees."""

import json
from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.network.weights import Weights, load_weights, save_weights
from patchnet.patchnet_addon.octree.file import load_octree, save_octree
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.sampling.refine import refined_mask, refinement_order
from patchnet.patchnet_addon.surface.mesh import TriangleMesh
from patchnet.tests.engine.mesh_samples import even, octree_of, square
from patchnet.training.commands import main
from patchnet.training.evaluation.catalogue import octree_path
from patchnet.training.evaluation.codes import coded_octree
from patchnet.training.evaluation.figures_of_paper import look_ahead as tables
from patchnet.training.evaluation.figures_of_paper.look_ahead import distance_view, pooled_values
from patchnet.training.evaluation.figures_of_paper.split import PATTERNS, hardest_end, split_view
from patchnet.training.evaluation.panels import crops_of_difference

CLOTH, WOOD = 0.5, 0.1  # luminance
WEIGHTS = Path(__file__).resolve().parents[2] / "patchnet_addon/network/weights/patchnet.safetensors"
LOOKS = [f"patchnet-behind-exact {levels}" for levels in (1, 2, 3)]


def small_table():
    """A bright cloth of 40 cm a centimetre above dark wood, around the middle of San Miguel's table."""
    x, y, _ = tables.BOX_WORLD.mean(axis=0)
    squares = np.concatenate([square(0.0, -0.2, 0.2), square(-0.01, -0.2, 0.2)])
    mesh = TriangleMesh.from_arrays(squares + [x, y, tables.BOX_WORLD[1, 2]])
    bounds = mesh.bounds_world - [[0, 0, 0.066], [0, 0, 0]]  # cells of 2.5 cm hold both, and smaller ones do not
    return octree_of(mesh, even(np.repeat([CLOTH, WOOD], 2)), Grid.around(bounds, 8), exposure=1.0)


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    path = tmp_path_factory.mktemp("table") / "table.safetensors"
    save_octree(small_table(), path)
    return path


def overlap(first, second):
    """Whether two squares share a pixel."""
    pixels = np.zeros((64, 64))
    pixels[first] += 1
    pixels[second] += 1
    return pixels.max() == 2


def test_crops_are_where_the_difference_is_largest():
    error, other = np.zeros((40, 50)), np.zeros((40, 50))
    other[21:26, 31:36] = 1.0  # the first is better here by most
    other[3, 3] = 3.0
    error[22:26, 20:24] = 1.0  # and worse here
    first, second = crops_of_difference(error, other, 5)
    assert first == (slice(21, 26), slice(31, 36))
    assert (error[second] - other[second]).sum() == 16
    assert not overlap(first, second) and overlap(first, (slice(24, 29), slice(35, 40)))


def test_split_view(shells_path):
    coded = drain(coded_octree(shells_path, load_weights()))
    camera = drain(hardest_end(coded.octree, (60, 60), 2))
    view = drain(split_view(coded, camera))
    values = view.values()
    assert camera.name.startswith("Approach") and values["look_ahead_share"] > 0.9
    found = {name: each["found"] for name, each in values["strategies"].items()}
    assert list(found) == list(PATTERNS) and max(found, key=found.get) == "optimal"
    assert values["strategies"]["optimal"]["mse"] < values["mse"]
    ours, other = values["crops"]
    assert ours["mse"]["patchnet-behind"] <= ours["mse"]["ss-variance"]
    assert other["mse"]["ss-variance"] <= other["mse"]["patchnet-behind"]
    rows, columns = view.bounds
    assert view.buffers.picture(view.buffers.hit)[rows, columns].sum() == view.buffers.hit.sum()
    stripes = view.stripes()
    assert stripes.shape == (rows.stop - rows.start, columns.stop - columns.start, 3)
    quarter = stripes.shape[1] // 4
    preview = view.pictures["preview"][rows, columns][:, :quarter]
    assert np.array_equal(stripes[:, :quarter, 0] > 0, preview > 0)


def test_views_of_a_table(table):
    octree = load_octree(table)
    voxels = []
    for distance in tables.SHOWN:
        view = drain(distance_view(octree, tables.table_camera(distance, 90.0), tables.BOX_WORLD))
        values = pooled_values([view])
        voxels.append(values["voxel"])
        assert values["look_ahead_share"] == {"1": 1.0, "2": 1.0, "3": 1.0}
        assert np.array_equal(view.region, view.buffers.hit), "there is nothing but the table"
        found = {name: each["found"] for name, each in values["region"]["strategies"].items()}
        assert found["optimal"] == max(found.values()) <= 1
        order = refinement_order(view.buffers, view.scores[LOOKS[1]])
        mask = view.buffers.active & ~refined_mask(view.buffers, order, 0.3)
        left = view.error.ravel()[mask].astype(np.float64) ** 2
        expected = left.sum() / view.buffers.active.sum()
        assert values["picture"]["strategies"][LOOKS[1]]["mse"] == pytest.approx(expected, rel=1e-5)
    assert voxels[1:] == pytest.approx([2 * voxels[0], 4 * voxels[0]])


def test_far_errors_need_more_look_ahead(table):
    """Voxels that hold wood and cloth are too dark, and so are the cells one level down; those further down are not."""
    octree = load_octree(table)
    view = drain(distance_view(octree, tables.table_camera(2.0, 90.0), tables.BOX_WORLD))
    inner = view.region & (np.abs(view.buffers.reference - CLOTH) < 0.01)
    error = view.error.ravel()[inner]
    assert np.median(error) > 0.1, "dark wood shines through the cloth"
    missed = [np.abs(view.scores[look][inner] - error).mean() for look in LOOKS]
    assert missed[0] > 0.05 and max(missed[1:]) < 0.3 * missed[0]


@pytest.fixture
def scenes(table, tmp_path, monkeypatch):
    """A folder of scenes, and one of octrees with that of the table in it."""
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / tables.SCENE.file).write_bytes(b"not read: its octree is there")
    monkeypatch.setenv("PATCHNET_SCENES", str(tmp_path / "scenes"))
    path = octree_path(tables.SCENE, tmp_path / "octrees")
    path.parent.mkdir()
    path.write_bytes(table.read_bytes())
    return tmp_path


def test_networks_of_every_look_ahead(scenes, capsys):
    """A row of pictures and numbers beside those of the exact patches; one network for each look-ahead."""
    pytest.importorskip("matplotlib")
    words = ["lab", "figures", "--only", "look-ahead", "--octrees", str(scenes / "octrees")]
    words += ["--out", str(scenes / "out")]
    for levels in (1, 3):
        save_weights(Weights.random(levels, lookahead=levels), scenes / f"{levels}.safetensors")
    given = [f"look-ahead-{levels}={scenes / f'{levels}.safetensors'}" for levels in (1, 3)]
    assert main([*words, "--networks", *given]) == 0
    written = {path.name for path in (scenes / "out").iterdir()}
    assert written == {f"look-ahead.{ending}" for ending in ("png", "svg", "json")}
    values = json.loads((scenes / "out" / "look-ahead.json").read_text(encoding="utf-8"))
    assert len(values["distances"]) == len(tables.DISTANCES) and len(values["shown"]) == len(tables.SHOWN)
    assert values["weights"].keys() == {"look-ahead-1", "look-ahead-3"}
    assert {"patchnet-behind 1", "patchnet-behind 3", *LOOKS} <= values["shown"][0]["region"]["strategies"].keys()
    assert main([*words, "--networks", given[0], given[0]]) == 2
    assert "Two networks are called 'look-ahead-1'" in capsys.readouterr().err


def test_what_is_missing_is_named(scenes, capsys):
    words = ["lab", "figures", "--octrees", str(scenes / "octrees"), "--out", str(scenes / "out")]
    assert main([*words, "--only", "split"]) == 2
    assert "ldraw_space_shuttle.glb" in capsys.readouterr().err
    assert main([*words, "--weights", str(scenes / "none.safetensors")]) == 2
    assert "none.safetensors" in capsys.readouterr().err
    assert main([*words, "--networks", f"one={WEIGHTS}", f"other={WEIGHTS}"]) == 2
    assert "Two weights files look 2 levels ahead" in capsys.readouterr().err
