# SPDX-License-Identifier: GPL-3.0-or-later
"""GFLOP/s of the encoder's products alone, of each shape that it multiplies, with bias and ReLU where it has them.

All are counted as if nothing were zero: two operations for each element of the values and column of the matrix.
Ours leaves zeros out; so it is measured twice, on random values without a zero and on those that the encoder meets.
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from typing import Any

import numpy as np

from ...patchnet_addon.network.compiled_encode import similar_order
from ...patchnet_addon.network.encode import sum_octants_reference
from ...patchnet_addon.network.octants import octant_matrices
from ...patchnet_addon.network.product import Panels, multiply, multiply_reference
from ...patchnet_addon.network.weights import Weights
from .timing import take_turns


class Product:
    """Product of the encoder: values (N, depth), matrix (depth, columns), bias (columns,) or None."""

    def __init__(self, values: np.ndarray, matrix: np.ndarray, bias: np.ndarray | None, *, relu: bool) -> None:
        self.values, self.matrix, self.bias, self.relu = values, np.ascontiguousarray(matrix), bias, relu
        self.order = similar_order(values) if bias is None else None
        random = np.random.default_rng(0)
        self.dense = 1 - random.random(values.shape, np.float32)  # in (0, 1], no zeros

    def reference(self) -> np.ndarray:
        """Result by NumPy."""
        return multiply_reference(self.values, self.matrix, self.bias, relu=self.relu)

    def runs(self) -> dict[str, Callable[[], Any]]:
        """Functions to measure, by name: ours, ours_on_its_values, numpy, torch where it is there."""
        panels = Panels.pack(self.matrix, self.bias)
        result = np.empty((len(self.values), panels.width), np.float32)
        runs: dict[str, Callable[[], Any]] = {
            "ours": lambda: multiply(self.dense, panels, result, relu=self.relu),
            "ours_on_its_values": lambda: multiply(self.values, panels, result, relu=self.relu, order=self.order),
            "numpy": _numpy_run(self),
        }
        if (torch_run := _torch_run(self)) is not None:
            runs["torch"] = torch_run
        return runs


def encoder_products(chunk: tuple[np.ndarray, np.ndarray], weights: Weights) -> list[Product]:
    """Products of one chunk, blocks (U, 320) and rows (C, 8), in their order."""
    blocks, rows = chunk
    matrix, bias = weights.encoder[0]
    products = [Product(blocks, octant_matrices(matrix), None, relu=False)]
    values = sum_octants_reference(products[0].reference(), rows, bias)
    for index, (matrix, bias) in enumerate(weights.encoder[1:], 1):
        products.append(Product(values, matrix.T, bias, relu=index < len(weights.encoder) - 1))
        values = products[-1].reference()
    return products


def measure_products(
    chunk: tuple[np.ndarray, np.ndarray], weights: Weights, repeats: int, *, all_cores: bool
) -> list[dict[str, Any]]:
    """GFLOP/s of each product of a chunk, medians, as JSON values."""
    measured = []
    for product in encoder_products(chunk, weights):
        runs = product.runs()
        for run in runs.values():
            run()
        seconds = take_turns(runs, repeats, all_cores=all_cores)
        operations = 2 * product.values.size * product.matrix.shape[1]
        measured.append(
            {"rows": len(product.values), "depth": product.matrix.shape[0], "columns": product.matrix.shape[1]}
            | {"zeros": float(np.mean(product.values == 0))}
            | {name: operations / median(values) / 1e9 for name, values in seconds.items()}
        )
    return measured


def _numpy_run(product: Product) -> Callable[[], Any]:
    """Multiply into an array that is there, as the encoder does: fresh pages would cost as much as small products."""
    result = np.empty((len(product.values), product.matrix.shape[1]), np.float32)

    def run() -> None:
        np.matmul(product.dense, product.matrix, out=result)
        if product.bias is not None:
            np.add(result, product.bias, out=result)
        if product.relu:
            np.maximum(result, 0, out=result)

    return run


def _torch_run(product: Product) -> Callable[[], Any] | None:
    try:
        import torch
    except ImportError:
        return None
    values, matrix = torch.from_numpy(product.dense), torch.from_numpy(product.matrix)
    bias = None if product.bias is None else torch.from_numpy(product.bias)
    result = torch.empty(len(values), matrix.shape[1])

    @torch.inference_mode()
    def run() -> None:
        if bias is None:
            torch.mm(values, matrix, out=result)
        else:
            torch.addmm(bias, values, matrix, out=result)
        if product.relu:
            result.relu_()

    return run
