# SPDX-License-Identifier: GPL-3.0-or-later
"""Stock of pieces by kind, drawn from at random without repetition as long as others are left."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .kinds import pieces_by_kind
from .library import Library, Piece
from .own_pieces import own_piece
from .policy import TRAIN, common_role


class Stock:
    """Stock of libraries' pieces; raises SettingError for libraries that are not to be mixed.

    role: of a scene of these libraries.
    """

    def __init__(self, libraries: Sequence[Library], rng: np.random.Generator) -> None:
        self.role = common_role(library.role for library in libraries)
        self._kinds = pieces_by_kind(piece for library in libraries for piece in library.pieces)
        self._rng = rng
        self._left: dict[str, list[Piece]] = {}

    def count(self, kind: str) -> int:
        """Count the libraries' pieces of a kind."""
        return len(self._kinds.get(kind, []))

    def draw(self, kind: str, fits: Callable[[Piece], bool] = lambda piece: True) -> Piece | None:
        """Draw a piece of a kind that fits, or build one where the libraries have none; None if that may not be."""
        if kind not in self._kinds:
            return None if self.role == TRAIN else own_piece(kind)
        left = [piece for piece in self._left.get(kind, []) if fits(piece)]
        if not left:
            left = [piece for piece in self._kinds[kind] if fits(piece)]
            if not left:
                return None
            self._left[kind] = list(self._kinds[kind])
        piece = left[int(self._rng.integers(len(left)))]
        self._left[kind].remove(piece)
        return piece
