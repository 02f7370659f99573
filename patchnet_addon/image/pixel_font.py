# SPDX-License-Identifier: GPL-3.0-or-later
"""Font of capital letters, digits and a few signs in 3 x 5 pixels, so that legends need no font file."""

import numpy as np

GLYPH_HEIGHT = 5
GLYPH_WIDTH = 3
ADVANCE = GLYPH_WIDTH + 1

# Five rows from the top, one octal digit a row, its bits the three columns from the left.
_GLYPHS = {
    "0": "75557", "1": "26227", "2": "71747", "3": "71717", "4": "55711", "5": "74717", "6": "74757", "7": "71122",
    "8": "75757", "9": "75717", "A": "25755", "B": "65656", "C": "34443", "D": "65556", "E": "74647", "F": "74644",
    "G": "34553", "H": "55755", "I": "72227", "J": "11152", "K": "55655", "L": "44447", "M": "57755", "N": "65555",
    "O": "25552", "P": "65644", "Q": "25563", "R": "65655", "S": "34216", "T": "72222", "U": "55557", "V": "55552",
    "W": "55775", "X": "55255", "Y": "55222", "Z": "71247", ".": "00002", ",": "00024", ":": "02020", "-": "00700",
    "+": "02720", "%": "51245", "|": "22222", "(": "12221", ")": "42224", "/": "11244", "=": "07070", ">": "42124",
    "<": "12421", "_": "00007", "'": "22000", " ": "00000",
}  # fmt: skip


def text_width(text: str) -> int:
    """Width of `text` in pixels at scale 1."""
    return max(len(text) * ADVANCE - 1, 0)


def text_mask(text: str, scale: int = 1) -> np.ndarray:
    """(5 scale, width scale) bool, row 0 at the bottom: pixels of the letters; unknown characters are boxes."""
    mask = np.zeros((GLYPH_HEIGHT, text_width(text)), bool)
    for index, character in enumerate(text.upper()):
        for row, digit in enumerate(_GLYPHS.get(character, "75557")):
            bits = [bool(int(digit, 8) & bit) for bit in (4, 2, 1)]
            mask[GLYPH_HEIGHT - 1 - row, index * ADVANCE : index * ADVANCE + GLYPH_WIDTH] = bits
    return np.kron(mask, np.ones((scale, scale), bool))


def draw_text(picture: np.ndarray, text: str, x: int, y: int, scale: int = 1, color: float = 0.9) -> None:
    """Write `text` into `picture` (H, W, 3) with its lower left corner at column x, row y; clipped at the borders."""
    mask = text_mask(text, scale)
    height, width = picture.shape[:2]
    left, bottom = max(x, 0), max(y, 0)
    right, top = min(x + mask.shape[1], width), min(y + mask.shape[0], height)
    if left < right and bottom < top:
        picture[bottom:top, left:right][mask[bottom - y : top - y, left - x : right - x]] = color
