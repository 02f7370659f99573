# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures computed from a seed, in sRGB: bricks, plaster, wood, glazed tiles, linen, and leaves with alpha."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Colour = Sequence[float]
LEAVES = "Leaves "  # prefix of materials and images that cut leaves


def noise(rng: np.random.Generator, size: int, slope: float = 1.4, stretch: float = 1.0) -> np.ndarray:
    """Seamless noise (size, size) with mean 0 and deviation 1; its spectrum falls with frequency^slope."""
    fy, fx = np.meshgrid(np.fft.fftfreq(size), np.fft.rfftfreq(size), indexing="ij")
    frequency = np.hypot(fx * stretch, fy)
    frequency[0, 0] = np.inf
    field = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((size, size))) / frequency**slope)
    return field / field.std()


def bricks(rng: np.random.Generator, size: int = 1024, rows: int = 16, columns: int = 6) -> np.ndarray:
    """Running bond (size, size, 3) of `rows` courses with pale mortar; every brick has its own tone."""
    v, u = np.mgrid[0:size, 0:size] / size
    v, u = v + 0.0012 * noise(rng, size, 1.2), u + 0.0012 * noise(rng, size, 1.2)
    row = np.floor(v * rows).astype(int)
    shifted = u * columns + 0.5 * (row % 2)
    column = np.floor(shifted).astype(int)
    across = np.minimum(shifted % 1, 1 - shifted % 1) / columns
    along = np.minimum(v * rows % 1, 1 - v * rows % 1) / rows
    mortar = np.clip(1.3 - np.minimum(across, along) * size / 4.5, 0, 1)[..., None]
    tones = np.array([[0.66, 0.37, 0.27], [0.72, 0.45, 0.33], [0.58, 0.30, 0.23], [0.76, 0.53, 0.40]])
    choice = rng.integers(0, len(tones), (rows, columns))
    light = rng.normal(1.0, 0.07, (rows, columns))
    index = row % rows, column % columns
    brick = tones[choice[index]] * (light[index] + 0.05 * noise(rng, size, 0.7))[..., None]
    return brick * (1 - mortar) + np.array([0.80, 0.75, 0.67]) * (1 + 0.04 * noise(rng, size, 0.8)[..., None]) * mortar


def plaster(rng: np.random.Generator, base: Colour, size: int = 1024) -> np.ndarray:
    """Old limewash (size, size, 3): cloudy, with darker patches where it has worn."""
    clouds = noise(rng, size, 1.5)
    worn = np.clip(noise(rng, size, 1.3) - 1.1, 0, 1)[..., None]
    tone = np.asarray(base) * (1 + 0.035 * clouds + 0.015 * noise(rng, size, 0.5))[..., None]
    return tone * (1 - 0.5 * worn) + np.array([0.66, 0.54, 0.42]) * 0.5 * worn


def wood(rng: np.random.Generator, base: Colour, size: int = 512) -> np.ndarray:
    """Grain along u (size, size, 3)."""
    grain = noise(rng, size, 1.3, stretch=24.0)
    return np.asarray(base) * (1 + 0.16 * grain)[..., None]


def glazed_tiles(size: int = 512) -> np.ndarray:
    """Four blue and yellow star tiles (size, size, 3) on a white glaze."""
    v, u = np.mgrid[0:size, 0:size] / size * 2 % 1 - 0.5
    radius, angle = np.hypot(u, v), np.arctan2(v, u)
    star = radius < 0.27 + 0.13 * np.cos(4 * angle)
    corner = np.hypot(0.5 - np.abs(u), 0.5 - np.abs(v))
    picture = np.tile(np.array([0.90, 0.90, 0.86]), (size, size, 1))
    picture[star] = (0.12, 0.27, 0.58)
    picture[radius < 0.15 + 0.03 * np.cos(8 * angle)] = (0.93, 0.72, 0.22)
    picture[radius < 0.07] = (0.12, 0.27, 0.58)
    picture[(corner < 0.24) & (corner > 0.13)] = (0.16, 0.42, 0.55)
    picture[np.maximum(np.abs(u), np.abs(v)) > 0.485] = (0.70, 0.68, 0.62)
    return picture


def linen(rng: np.random.Generator, size: int = 1024) -> np.ndarray:
    """White table cloth (size, size, 3) with a double blue stripe near its hem."""
    v, u = np.mgrid[0:size, 0:size] / size
    hem = np.minimum(np.minimum(u, 1 - u) * 1.6, np.minimum(v, 1 - v))
    cloth = np.tile(np.array([0.95, 0.945, 0.92]), (size, size, 1)) * (1 + 0.008 * noise(rng, size, 0.3))[..., None]
    stripe = ((hem > 0.055) & (hem < 0.085)) | ((hem > 0.1) & (hem < 0.108))
    cloth[stripe] = (0.30, 0.43, 0.66)
    return cloth


def sprig(
    rng: np.random.Generator, leaves: Sequence[Colour], pairs: int, width: float, length: float, size: int = 256
) -> np.ndarray:
    """Twig along v with leaves on both sides, transparent around it (size, size, 4).

    `leaves` are the colours to choose from, `width` a leaf's half width by its length, `length` its size in pictures.
    """
    v, u = np.mgrid[0:size, 0:size] / size
    picture = np.empty((size, size, 4))
    picture[..., :3], picture[..., 3] = np.mean(leaves, axis=0), 0.0  # the mean colour avoids fringes at edges
    stem = (np.abs(u - 0.5) < 0.008) & (v < 0.8)
    picture[stem] = (0.36, 0.30, 0.18, 1.0)
    for number in range(2 * pairs + 1):
        last = number == 2 * pairs
        height = 0.78 if last else 0.06 + 0.72 * (number // 2) / pairs
        side = 0.0 if last else (number % 2 * 2 - 1) * rng.uniform(0.75, 1.15)
        reach = min(length * rng.uniform(0.85, 1.1), 0.98 - height if last else 1.0)
        _leaf(picture, u - 0.5, v - height, side, reach, width, np.asarray(leaves[rng.integers(len(leaves))]))
    return picture


def _leaf(
    picture: np.ndarray, u: np.ndarray, v: np.ndarray, angle: float, reach: float, width: float, colour: np.ndarray
) -> None:
    """Draw one pointed leaf from the origin of (u, v), `angle` radians from upright, over the picture."""
    along = (u * np.sin(angle) + v * np.cos(angle)) / reach
    across = (u * np.cos(angle) - v * np.sin(angle)) / reach
    outline = width * np.sin(np.pi * np.clip(along, 0, 1) ** 0.8)
    inside = (along > 0) & (along < 1) & (np.abs(across) < outline)
    vein = np.abs(across) < 0.018
    tone = colour * (0.86 + 0.22 * along[..., None] + 0.10 * (across > 0)[..., None]) * (1 + 0.25 * vein[..., None])
    picture[inside, :3], picture[inside, 3] = tone[inside], 1.0


def courtyard_pictures(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Textures of the courtyard by image name."""
    return {
        "Plaster": plaster(rng, (0.93, 0.87, 0.76)),
        "Bricks": bricks(rng),
        "Stone": plaster(rng, (0.79, 0.75, 0.68), 512),
        "Wood": wood(rng, (0.80, 0.80, 0.80)),
        "Glazed tiles": glazed_tiles(),
        "Linen": linen(rng),
    } | _leaf_pictures(rng)


def _leaf_pictures(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Textures whose alpha cuts leaves out of cards."""
    green = [(0.27, 0.45, 0.16), (0.34, 0.53, 0.20), (0.22, 0.38, 0.15)]
    pictures = {
        "citrus": sprig(rng, green, 4, 0.22, 0.42),
        "olive": sprig(rng, [(0.50, 0.56, 0.40), (0.42, 0.50, 0.34), (0.60, 0.64, 0.48)], 7, 0.11, 0.40),
        "fern": sprig(rng, [(0.36, 0.58, 0.22), (0.42, 0.63, 0.26)], 14, 0.10, 0.46),
        "bougainvillea": sprig(
            rng, [(0.84, 0.16, 0.50), (0.92, 0.28, 0.60), (0.74, 0.12, 0.46), (0.88, 0.22, 0.52)], 3, 0.40, 0.40
        ),
        "geranium": sprig(rng, [(0.86, 0.14, 0.13), (0.93, 0.24, 0.18), (0.78, 0.10, 0.14)], 5, 0.44, 0.30),
        "lavender": sprig(rng, [(0.50, 0.40, 0.74), (0.58, 0.47, 0.80), (0.45, 0.52, 0.38)], 9, 0.16, 0.20),
    }
    return {f"{LEAVES}{key}": pixels for key, pixels in pictures.items()}
