# SPDX-License-Identifier: GPL-3.0-or-later
"""Encoder process on torch in a Python of its own, for programs whose own Python has no torch.

    python torch_worker.py DEVICE

DEVICE is auto, cpu or cuda. Reads the number of the encoder's layers and the layers from stdin, then pairs of blocks
and rows, and answers each pair with codes. A first line on stdout says in
JSON what runs; what goes wrong is said on stderr. Only NumPy and torch are needed.
"""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

_PACKAGE = "patchnet_network"


def main(device: str) -> None:
    """Serve until stdin ends."""
    requests, answers = sys.stdin.buffer, sys.stdout.buffer
    read_array, write_array = (getattr(_part("array_stream"), name) for name in ("read_array", "write_array"))
    torch_encode = _part("torch_encode")
    import torch

    name = ("cuda" if torch.cuda.is_available() else "cpu") if device == "auto" else device
    layers = [(read_array(requests), read_array(requests)) for _ in range(int(read_array(requests)))]
    encoder = torch_encode.TorchEncoder(SimpleNamespace(encoder=layers), name)
    said = {"torch": torch.__version__, "device": name, "chunk": encoder.chunk}
    answers.write((json.dumps(said) + "\n").encode())
    answers.flush()
    while requests.peek(1):  # type: ignore[union-attr]
        write_array(answers, encoder(read_array(requests), read_array(requests)))
        answers.flush()


def _part(name: str) -> ModuleType:
    """Import a module beside this one, in a package of its own: what the whole package needs need not be there."""
    if _PACKAGE not in sys.modules:
        package = ModuleType(_PACKAGE)
        package.__path__ = [str(Path(__file__).parent)]
        sys.modules[_PACKAGE] = package
    return importlib.import_module(f"{_PACKAGE}.{name}")


if __name__ == "__main__":
    main(sys.argv[1])
