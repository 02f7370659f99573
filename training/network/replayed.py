# SPDX-License-Identifier: GPL-3.0-or-later
"""Work of a GPU that is recorded once, as a CUDA graph, and replayed.

A training step launches some 250 small kernels. To launch each from Python takes several times as long as to run them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

import torch

Result = TypeVar("Result")


class Replayed(Generic[Result]):
    """Function without arguments that is called again and again, on a GPU from a recording.

    It reads and writes tensors that stay where they are, neither waits for the GPU nor copies between it and the host,
    and what it returns is overwritten by the next call. The first call prepares what torch's libraries make at first
    use, the second one records. On the CPU it is called each time.
    """

    def __init__(self, function: Callable[[], Result], device: torch.device) -> None:
        self._function, self._device = function, device
        self._graph: torch.cuda.CUDAGraph | None = None
        self._results: list[Result] = []
        self._called = False

    def __call__(self) -> Result:
        """Call, or replay; returns when the work is launched."""
        if self._device.type != "cuda":
            return self._function()
        with torch.cuda.device(self._device):
            if not self._called:
                self._called = True
                return self._beside()
            if self._graph is None:
                graph = torch.cuda.CUDAGraph()
                # Other threads, which read files or gather, may do with the GPU what they like meanwhile.
                with torch.cuda.graph(graph, capture_error_mode="thread_local"):
                    self._results.append(self._function())
                self._graph = graph
            self._graph.replay()
        return self._results[0]

    def _beside(self) -> Result:
        """Call on another stream, as what is recorded is."""
        stream, current = torch.cuda.Stream(), torch.cuda.current_stream()
        stream.wait_stream(current)
        with torch.cuda.stream(stream):
            result = self._function()
        current.wait_stream(stream)
        torch.cuda.synchronize()  # tensors of one stream are used on the other from now on
        return result
