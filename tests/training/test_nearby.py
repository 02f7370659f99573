# SPDX-License-Identifier: GPL-3.0-or-later
"""Luminance mixtures in training: inputs under every symmetry, equal to those of the decoder."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from patchnet.patchnet_addon.codes.encode import encode_octree
from patchnet.patchnet_addon.codes.footprint import PixelRay
from patchnet.patchnet_addon.codes.mixture_inputs import nearby_order
from patchnet.patchnet_addon.codes.outer_cells import mask_geometry
from patchnet.patchnet_addon.codes.predict import predict
from patchnet.patchnet_addon.network.kinds import COVERING, MIXED, MIXTURE, VIEW
from patchnet.patchnet_addon.network.weights import Weights, load_weights, save_weights
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.runtime.kernels import kernel
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.tests.engine.octree_samples import around_voxels
from patchnet.tests.references.lookups import node_at
from patchnet.tests.training.procedural import spheres_and_slats
from patchnet.tests.training.test_batches import DEPTH, matrix_of, moved_octree
from patchnet.training.data.augmentation import Augmentation
from patchnet.training.data.corpus import corpus_of
from patchnet.training.data.dataset import Dataset
from patchnet.training.data.forest import concatenate
from patchnet.training.data.nearby import Nearby, gather_nearby
from patchnet.training.data.samples import SampleSettings, draw_samples
from patchnet.training.data.tensor_batch import tensor_batch
from patchnet.training.network.patchnet import PatchNet
from patchnet.training.run.run_files import read_log
from patchnet.training.run.trainer import RunOptions, train
from patchnet.training.settings import TrainSettings


@pytest.fixture(scope="module")
def octree() -> Octree:
    return spheres_and_slats(DEPTH, seed=4)


@pytest.fixture(scope="module")
def dataset(octree: Octree) -> Dataset:
    settings = SampleSettings(views=4, min_level=3, held_out=0.05, seed=2)
    return Dataset("scene", octree, drain(draw_samples(octree, 400, settings)), {})


@kernel
def gather(nodes, luminance, where, rays, tables, found):
    gather_nearby(nodes, luminance, where, rays, tables, found)


def nearby(octree: Octree, voxel: np.ndarray, rays: tuple[np.ndarray, ...], linear: np.ndarray) -> Nearby:
    """Cells near voxels (V, 4) of an octree, as rays see them."""
    forest, tables = concatenate([octree]), (mask_geometry(), nearby_order())
    where = np.zeros(len(voxel), np.int64), around_voxels(octree, voxel), linear
    found = Nearby(*(np.empty((*rays[3].shape, size), np.float32) for size in (VIEW, COVERING, MIXED)))
    exact = PixelRay(*(np.ascontiguousarray(array, np.float32) for array in rays))
    gather(forest.nodes, forest.light, where, exact, tables, found)
    return found


@pytest.mark.parametrize("symmetry", [7, 18, 41])
def test_nearby_turns_with_the_scene(octree: Octree, dataset: Dataset, symmetry: int) -> None:
    voxel = dataset.samples.voxel[:40].astype(np.int64)
    gain, offset = (0.5, 0.25) if symmetry % 2 else (1.0, 0.0)
    linear = np.tile(np.array([[gain, offset]], np.float32), (len(voxel), 1))
    plain = moved_octree(octree, 0, 1.0, 0.0)  # means of inner voxels as those of the turned scene
    random = np.random.default_rng(symmetry)
    entry, direction = random.random((40, 3, 3)), random.normal(size=(40, 3, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    up = np.cross(direction, random.normal(size=(40, 3, 3)))
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    ratio = random.uniform(0.5, 1, (40, 3))
    found = nearby(plain, voxel, (entry, direction, up, ratio), linear)
    side, matrix = 1 << voxel[:, :1], matrix_of(symmetry)
    cells = (voxel[:, 1:] + 0.5 - side / 2) @ matrix.T + side / 2 - 0.5
    moved = np.concatenate([voxel[:, :1], np.rint(cells).astype(np.int64)], axis=1)
    scene = moved_octree(octree, symmetry, gain, offset)
    rays = (entry - 0.5) @ matrix.T + 0.5, direction @ matrix.T, up @ matrix.T, ratio
    same = np.tile(np.array([[1, 0]], np.float32), (40, 1))
    wanted = nearby(scene, moved, rays, same)
    np.testing.assert_allclose(found.view, wanted.view, atol=1e-6)
    np.testing.assert_allclose(found.covered, wanted.covered, atol=1e-5)
    there = np.concatenate([wanted.covered > 1e-4, np.ones((40, 3, 1), bool)], axis=-1)
    assert 0.02 < there.mean() < 0.5
    apart = np.abs(found.luminances - wanted.luminances)[there]
    assert apart.max() < 0.03 and apart.mean() < 0.003  # cells around are kept in steps, before gain and offset


def test_what_is_trained_is_what_predicts(octree: Octree, dataset: Dataset) -> None:
    """Training's network, the compiled decoder and torch's give the same for the same voxels and rays."""
    weights = Weights.random(seed=5, bias=0.1, kind=MIXTURE)
    corpus, _ = corpus_of([dataset], nearby=True)
    rows = np.arange(60)
    batch = corpus.batch(rows, Augmentation.none(len(rows)))
    with torch.no_grad():
        trained = PatchNet(weights)(tensor_batch(batch)).numpy().reshape(-1, 2)
    level, cells = corpus.voxel[rows, 0].astype(int), corpus.voxel[rows, 1:].astype(int)
    node = np.array([node_at(octree, here, cell[None])[0] for here, cell in zip(level, cells, strict=True)])
    views = batch.ratio.shape[1]
    hits = SimpleNamespace(
        node=node.repeat(views),
        luminance=octree.luminance_float(node).repeat(views),
        **{name: getattr(batch, name).reshape(-1, 3) for name in ("direction", "up")},
        entry_voxel=batch.entry.reshape(-1, 3),
        ratio=batch.ratio.ravel(),
    )
    coded = drain(encode_octree(octree, weights))
    prediction = predict(coded, hits)
    assert prediction.look_ahead.all()
    np.testing.assert_allclose(prediction.coverage, trained[:, 0].clip(0, 1), atol=2e-3)  # codes are half floats
    np.testing.assert_allclose(prediction.luminance, trained[:, 1], atol=2e-3)


def test_mixture_learns_shape_alone(dataset: Dataset, tmp_path: Path) -> None:
    """A short run lowers both errors, leaves the encoder blind to luminance, and its file says what it is."""
    settings = TrainSettings(
        passes=60 * 256, batch=256, precision="fp32", learning_rate=2e-3, network="mixture", loss="squared"
    )
    options = RunOptions(tmp_path / "run", log_steps=20)
    weights = drain(train([dataset], settings, options))
    assert not weights.encoder[0][0][:, 1::5].any() and weights.kind is MIXTURE
    save_weights(weights, tmp_path / "mixture.safetensors")
    assert load_weights(tmp_path / "mixture.safetensors").hash == weights.hash
    first, *_, last = read_log(tmp_path / "run" / "log.jsonl")[0]
    assert last["coverage"] < 0.8 * first["coverage"] and last["luminance"] < first["luminance"]
