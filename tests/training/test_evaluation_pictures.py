# SPDX-License-Identifier: GPL-3.0-or-later
"""Picture metrics against scikit-image and plain references (methods 5, 7.1)."""

import numpy as np
import pytest

from patchnet.patchnet_addon.image.tone import srgb_encode
from patchnet.patchnet_addon.sampling.refine import refined_mask, refined_picture
from patchnet.tests.engine.test_sampling import random_buffers
from patchnet.tests.training.frame_samples import scores_of
from patchnet.training.evaluation.curves import frame_orders
from patchnet.training.evaluation.picture_metrics import QUALITY_NAMES, picture_metrics, structure_of

WEIGHTS = np.array([0.0448, 0.2856, 0.3001, 0.2363, 0.1333])


def named(found: np.ndarray) -> list[dict[str, float]]:
    """Metrics by name of each picture."""
    return [dict(zip(QUALITY_NAMES, row, strict=True)) for row in found]


def two_pictures(height: int, width: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A smooth picture, and it with noise."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width] / 30
    reference = np.clip(0.5 + 0.4 * np.sin(3 * x) * np.cos(2 * y), 0, 1)
    return np.clip(reference + rng.normal(0, 0.1, reference.shape), 0, 1), reference


@pytest.mark.parametrize("shape", [(130, 130), (47, 80), (11, 12)])
def test_ssim_is_that_of_scikit_image(shape: tuple[int, int]) -> None:
    metrics = pytest.importorskip("skimage.metrics")
    picture, reference = two_pictures(*shape)
    value, similarity = metrics.structural_similarity(
        picture, reference, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1.0, full=True
    )
    mine = structure_of(np.array([reference, picture]), reference)
    np.testing.assert_allclose(mine.similarity[1], similarity, atol=1e-10)
    assert mine.ssim[1] == pytest.approx(value, abs=1e-12) and mine.ssim[0] == pytest.approx(1.0)


def plain_ms_ssim(picture: np.ndarray, reference: np.ndarray, scales: int) -> float:
    """MS-SSIM by windows of 11 x 11 pixels that lie within the picture, one after the other."""
    kernel = np.exp(-(np.arange(-5, 6) ** 2) / (2 * 1.5**2))
    kernel = np.outer(kernel, kernel) / kernel.sum() ** 2
    value, weights = 1.0, WEIGHTS[:scales] / WEIGHTS[:scales].sum()
    for scale in range(scales):
        products = []
        for row in range(picture.shape[0] - 10):
            for column in range(picture.shape[1] - 10):
                x, y = (each[row : row + 11, column : column + 11] for each in (picture, reference))
                mx, my = (kernel * x).sum(), (kernel * y).sum()
                vx, vy = (kernel * (x - mx) ** 2).sum(), (kernel * (y - my) ** 2).sum()
                cov = (kernel * (x - mx) * (y - my)).sum()
                product = (2 * cov + 9e-4) / (vx + vy + 9e-4)
                if scale == scales - 1:
                    product *= (2 * mx * my + 1e-4) / (mx**2 + my**2 + 1e-4)
                products.append(product)
        value *= np.mean(products) ** weights[scale]
        if picture.shape[0] % 2 == 0:
            shape = picture.shape[0] // 2, 2, picture.shape[1] // 2, 2
            picture, reference = (each.reshape(shape).mean(axis=(1, 3)) for each in (picture, reference))
    return value


@pytest.mark.parametrize("shape, scales", [((48, 64), 3), ((88, 96), 4), ((176, 176), 5), ((21, 40), 1)])
def test_ms_ssim_is_that_of_a_plain_loop(shape: tuple[int, int], scales: int) -> None:
    picture, reference = two_pictures(*shape)
    found = structure_of(np.array([reference, picture]), reference)
    assert found.ms_ssim[1] == pytest.approx(plain_ms_ssim(picture, reference, scales), rel=1e-9)


@pytest.mark.parametrize("name, encode", [("linear", np.asarray), ("srgb", srgb_encode)])
def test_metrics_are_those_of_the_composed_pictures(name: str, encode) -> None:
    buffers = random_buffers(2, 50, 44, hits=0.1)
    order = frame_orders(buffers, scores_of(buffers))["ss-variance"]
    reference = encode(buffers.reference.reshape(50, 44).astype(np.float64))
    masks = [refined_mask(buffers, order, budget) for budget in (0.0, 0.2, 0.6)]
    pictures = np.array([buffers.picture(refined_picture(buffers, mask)) for mask in masks])
    for measured, picture in zip(named(picture_metrics(buffers, pictures)), pictures, strict=True):
        expected = structure_of(encode(picture.astype(np.float64))[None], reference)
        similarity = expected.similarity[0]
        assert measured[f"ssim {name}"] == pytest.approx(similarity[5:-5, 5:-5].mean())
        assert measured[f"ssim_active {name}"] == pytest.approx(similarity.ravel()[buffers.active].mean())
        assert measured[f"ms_ssim {name}"] == pytest.approx(expected.ms_ssim[0])
