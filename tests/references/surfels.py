# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain references of surfels, light cells, their filter, and their look-up by fragments: loops over dictionaries."""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from patchnet.patchnet_addon.cells.contract import fitting_level_of
from patchnet.patchnet_addon.cells.morton import morton_encode
from patchnet.patchnet_addon.light import cell_filter as cells_module
from patchnet.patchnet_addon.light import seen_cells as seen_module
from patchnet.patchnet_addon.light.cell_filter import STEPS
from patchnet.patchnet_addon.light.light_cells import ANY_FACE, ANY_SHEET, MIN_OPACITY, SurfelSums, SurfelSurface
from patchnet.patchnet_addon.light.seen_cells import SeenCells
from patchnet.patchnet_addon.light.sheets import Sheets
from patchnet.patchnet_addon.light.surfels import COARSE, MOST_SHEETS
from patchnet.patchnet_addon.octree.grid import Grid
from patchnet.patchnet_addon.octree.octree import Octree
from patchnet.patchnet_addon.octree.voxelize import ClippedSurface
from patchnet.patchnet_addon.runtime.bounds import MOST_STILLS
from patchnet.patchnet_addon.surface.mesh import ShadingFn
from patchnet.patchnet_addon.surface.triangles import triangle_areas_and_normals
from patchnet.patchnet_addon.tracing.camera import Camera, camera_in_unit_cube
from patchnet.tests.references.clip import parts_of
from patchnet.tests.references.first_hits import first_hits_reference, picture_points, pixel_rays

Place = tuple[int, int, int]  # cell, face, sheet
_ALL = (1 << 64) - 1


class Drawn(NamedTuple):
    """Winner of a cell: its id, leaf, triangle and side; what the cell stands for, and the pixels that show it."""

    id: int
    leaf: int
    triangle: int
    side: int
    share: float
    pixels: float
    rank: float


class Cell(NamedTuple):
    """Light (C,), noise and radiance of a light cell, and the pixels that show it."""

    light: np.ndarray
    noise: float
    radiance: float
    pixels: float


class Spot(NamedTuple):
    """Place of a cell's surfel in the octree's cube (3,), its normal (3,), and whether the cell is filtered."""

    unit: np.ndarray
    normal: np.ndarray
    is_filtered: bool
    is_seen: bool = True


def mixed_reference(h: int, value: int) -> int:
    """Finalizer of SplitMix64, in integers."""
    h = (h * 0x9E3779B97F4A7C15 & _ALL) ^ value & _ALL
    h = (h ^ h >> 30) * 0xBF58476D1CE4E5B9 & _ALL
    h = (h ^ h >> 27) * 0x94D049BB133111EB & _ALL
    return h ^ h >> 31


def key_of(place: Place) -> int:
    """Key of a light cell with its face and sheet."""
    cell, face, sheet = place
    return mixed_reference(mixed_reference(cell, face), sheet)


def face_reference(direction: np.ndarray) -> int:
    """Face of the cube that a direction faces most; of equal axes the first."""
    axis = int(np.argmax(np.abs(direction)))
    return 2 * axis + int(direction[axis] < 0.0)


def _above(key: int, level: int, up: int) -> int:
    return (key >> 3 * up) << 5 | level - up


def _light_level(key: int, level: int, seen: Mapping[int, tuple[int, float]], is_color: bool) -> tuple[int, float]:
    """Levels from a leaf up to its light cell, and pixels that show it: 0 if no camera sees the leaf."""
    coarse = min(COARSE, level)
    for up in range(level + 1):
        if _above(key, level, up) in seen:
            wanted, pixels = seen[_above(key, level, up)]
            if is_color:
                return min(up, coarse), pixels
            finer = max(level - wanted - coarse, 0)  # than the cell that shows the pixels
            return min(max(level - wanted, min(1, level)), coarse), pixels / 4**finer
    return coarse, 0.0


def surfels_reference(
    clipped: ClippedSurface, opacity: ShadingFn, sheets: Sheets, seen: SeenCells, eyes: np.ndarray, is_color: bool
) -> dict[Place, Drawn]:
    """Winners by cell, face and sheet, of all fragments one by one; is_color: those of base colours, of all sizes."""
    views = {int(cell): (int(level), float(pixels)) for cell, level, pixels in zip(*seen, strict=True)}
    entries: dict[Place, list[Drawn]] = defaultdict(list)
    for batch, fragments in parts_of(clipped):
        normals = triangle_areas_and_normals(batch.corners_world)[1]
        shown, level = opacity(batch, fragments).opacity, fragments.level
        for f in range(len(fragments)):
            weight = float(fragments.area_world[f]) * float(shown[f])
            if shown[f] < np.float32(1.0 / 255.0) or weight <= 0.0:
                continue
            key, t = int(fragments.keys[f]), int(fragments.triangle[f])
            number = batch.first_triangle + t
            one, two = (float(share) for share in fragments.barycentric[f])
            start, first, second = batch.corners_world[t]
            place = start + one * (first - start) + two * (second - start)
            up_of_seen, pixels = _light_level(key, level, views, is_color)
            for side, sign in enumerate((1.0, -1.0)):
                if sheets.lit[number] == -sign:
                    continue
                coarse = min(COARSE, level)
                above = [bool(normals[t] @ (eye[:3] - eye[3] * place) > 0.0) for eye in eyes]
                ways = {coarse: 0.0}  # and their pixels
                if pixels > 0.0 and (not len(eyes) or (side == 0) in above):
                    ways |= dict.fromkeys(range(up_of_seen, coarse) if is_color else (up_of_seen,), pixels)
                    if up_of_seen == coarse:
                        ways[coarse] = pixels
                hashed = mixed_reference(mixed_reference(mixed_reference(key, level), number), side)
                rank = float(np.float32(-math.log(((hashed >> 11) + 0.5) / 2.0**53) / weight))
                for up, shows in ways.items():
                    sheet = 2 * int(sheets.sheet[number]) + side
                    where = _above(key, level, up), face_reference(sign * normals[t]), sheet
                    mine = mixed_reference(key_of(where), hashed)
                    entries[where].append(Drawn(mine, key << 5 | level, number, side, weight, shows, rank))
    drawn = {}
    for where, all_of_it in entries.items():
        share, pixels = sum(one.share for one in all_of_it), max(one.pixels for one in all_of_it)
        drawn[where] = min(all_of_it, key=lambda one: (one.rank, one.id))._replace(share=share, pixels=pixels)
    return _of_few_sheets(drawn)


def _of_few_sheets(drawn: dict[Place, Drawn]) -> dict[Place, Drawn]:
    """Surfels of the sheets of each cell and face with the lowest ranks."""
    sheets: dict[tuple[int, int], list[Place]] = defaultdict(list)
    for where in sorted(drawn, key=lambda where: (drawn[where].rank, drawn[where].id)):
        sheets[where[:2]].append(where)
    few = {}
    for own in sheets.values():
        few |= {where: drawn[where] for where in own[:MOST_SHEETS]}
    return few


def seen_cells_reference(
    octree: Octree, cameras: list[Camera], lookahead: int, *, small: bool
) -> dict[int, tuple[int, float]]:
    """Level of light cells of each voxel that rays end in, and pixels of that around it. small: the pictures are."""
    found: dict[int, tuple[int, float]] = {}
    recent: list[set[int]] = []
    for number, camera in enumerate(cameras):
        if len(cameras) > MOST_STILLS:
            quarters = [(0.25, 0.25), (0.75, 0.75), (0.75, 0.25), (0.25, 0.75)]
            first = number % 4
            seen = _seen_reference(octree, camera, lookahead, quarters[first : first + 1], 1, 0)
            own = {_cell_around(voxel, level) for voxel, (level, _) in seen.items()}
            known = [any(_cell_around(voxel, level) in cells for cells in recent) for voxel, (level, _) in seen.items()]
            if seen and np.mean(known) < seen_module._KNOWN:
                seen = _seen_reference(octree, camera, lookahead, quarters, 1, 0)
                own = {_cell_around(voxel, level) for voxel, (level, _) in seen.items()}
            recent = [*recent, own][-seen_module._RECENT :]
        else:
            side = 4 if small else 2
            places = [((i + 0.5) / side, (j + 0.5) / side) for i in range(side) for j in range(side)]
            seen = _seen_reference(octree, camera, lookahead, places, 0, 1 if small else 0)
        for voxel, (level, pixels) in seen.items():
            before, sum_of = found.get(voxel, (level, 0.0))
            found[voxel] = max(before, level), sum_of + pixels
    around: dict[int, float] = defaultdict(float)
    cells = {voxel: _cell_around(voxel, level) for voxel, (level, _) in found.items()}
    for voxel, (_, pixels) in found.items():
        around[cells[voxel]] += pixels
    return {voxel: (level, around[cells[voxel]]) for voxel, (level, _) in found.items()}


def _seen_reference(
    octree: Octree, camera: Camera, lookahead: int, places: list[tuple[float, float]], coarser: int, below: int
) -> dict[int, tuple[int, float]]:
    """Level of light cells of each voxel that rays through `places` of large pixels end in, and its own pixels."""
    found: dict[int, tuple[int, float]] = {}
    width, height = camera.width_px >> coarser, camera.height_px >> coarser
    looks = camera.with_size(width, height)
    unit = camera_in_unit_cube(looks, octree.grid)
    share = camera.width_px * camera.height_px / (width * height * len(places))
    for across, up in places:
        x, y = picture_points(looks, across, up)
        node, t = first_hits_reference(octree, looks, x, y, 0.5 ** (lookahead + coarser + seen_module._FINER))
        speed = pixel_rays(octree.grid, looks, x, y)[2]
        for ray in np.flatnonzero(node >= 0):
            level = int(octree.level_of(node[ray : ray + 1])[0])
            key = int(octree.keys(level)[node[ray] - octree.level_start[level]])
            pixel = unit.side_at_0 + unit.side_per_z * t[ray] * speed[ray]
            wanted = int(fitting_level_of(pixel)) + coarser + below
            before, pixels = found.get(key << 5 | level, (wanted, 0.0))
            found[key << 5 | level] = max(before, wanted), pixels + share
    return found


def _cell_around(voxel: int, wanted: int) -> int:
    """Light cell of a wanted level around a voxel, which is above it, unless the voxel is the root."""
    level = voxel & 31
    return _above(voxel >> 5, level, max(level - wanted, min(1, level)))


def light_cells_reference(
    surfels: np.ndarray, surface: SurfelSurface, sums: SurfelSums, grid: Grid, *, filtered: bool
) -> dict[Place, Cell]:
    """Light cells by cell, face and sheet, with the means over sheets and faces."""
    where_of = [tuple(int(one[name]) for name in ("cell", "face", "sheet")) for one in surfels]
    unit, light, half, bases, spots = grid.to_unit(surface.place), {}, {}, {}, {}
    for i, where in enumerate(where_of):
        spots[where] = Spot(unit[i], surface.normal[i], bool(surface.is_filtered[i]), bool(surfels["pixels"][i] > 0.0))
        *color, opacity, _ = sums.light[i] / sums.samples[i]
        if opacity > MIN_OPACITY:
            bases[where] = surface.base[i].astype(np.float64)
            light[where] = np.array(color) / opacity / bases[where]
            half[where] = sums.half[i] / opacity / float(surface.base[i, 0])
    assert len(spots) == len(surfels), "a cell, face and sheet has one surfel"
    if filtered:
        light, noise = filtered_reference(light, half, bases, spots)
    else:
        noise = noise_reference(half, [all_neighbours(spots, step) for step in STEPS[: cells_module.NOISE_STEPS]])
        noise = {where: math.hypot(noise[where], half[where]) / math.sqrt(2.0) for where in light}
    cells, shares = {}, {}
    for i, where in enumerate(where_of):
        if where in light:
            base, shares[where] = float(surface.base[i, 0]), float(surfels["share"][i])
            cells[where] = Cell(light[where], noise[where] * base, light[where][0] * base, float(surfels["pixels"][i]))
    return cells | _means(cells, shares)


def _means(cells: dict[Place, Cell], shares: dict[Place, float]) -> dict[Place, Cell]:
    """Means over the sheets of each cell and face, and over all of a cell, by area."""
    members: dict[Place, list[Place]] = defaultdict(list)
    for cell, face, sheet in cells:
        members[cell, face, ANY_SHEET].append((cell, face, sheet))
        members[cell, ANY_FACE, ANY_SHEET].append((cell, face, sheet))
    means = {}
    for where, own in members.items():
        weight = np.array([shares[one] for one in own]) / sum(shares[one] for one in own)
        light, noise, radiance, pixels = zip(*(cells[one] for one in own), strict=True)
        means[where] = Cell(weight @ np.array(light), float(weight @ noise), float(weight @ radiance), max(pixels))
    return means


def filtered_reference(
    light: Mapping[Place, np.ndarray],
    half: Mapping[Place, float],
    bases: Mapping[Place, np.ndarray],
    spots: Mapping[Place, Spot],
) -> tuple[dict[Place, np.ndarray], dict[Place, float]]:
    """Light and noise of cells with light after all passes, among those of all surfels.

    Passes average radiance and base colours. The guide that tells which neighbours are alike is the mean around each
    cell in the first pass, then the light.
    """
    channels = len(next(iter(light.values()), ()))
    values = {
        where: np.array([*(light[where] * bases[where]), half[where] * bases[where][0], *bases[where]])
        for where in light
    }
    near = [all_neighbours(spots, step) for step in STEPS]
    noise = noise_reference(half, near[: cells_module.NOISE_STEPS])
    guide = {where: blurred_reference(where, light, noise, near[0]) for where in light}
    for number, around in enumerate(near):
        weights: dict[Place, list[tuple[Place, float]]] = {where: [] for where in light}
        for where in light:
            for other, weight in around[where].items():
                if other in light:
                    (one, noise_one), (two, noise_two) = guide[where], guide[other]
                    sigma = cells_module._SIGMAS * math.hypot(noise_one, noise_two)
                    sigma += cells_module._LEAST_NOISE * max(abs(one), abs(two)) + 1e-30
                    weights[where].append((other, weight * math.exp(-(((two - one) / sigma) ** 2))))
        total = {
            where: 1.0 + sum(weight * _part(where, other) for other, weight in of) for where, of in weights.items()
        }
        smooth = {}
        for where, own in values.items():
            smooth[where], rest = np.zeros_like(own), 1.0
            for other, weight in weights[where]:
                share = weight * _part(where, other) / max(total[where], total[other])
                smooth[where], rest = smooth[where] + share * values[other], rest - share
            smooth[where] = smooth[where] + rest * own
        values = smooth
        light = {where: value[:channels] / value[channels + 1 :] for where, value in values.items()}
        left = {where: float(value[channels] / value[channels + 1]) for where, value in values.items()}
        noise = noise_reference(left, near[number : number + cells_module.NOISE_STEPS])
        own = {where: max(noise[where], float(cells_module._OWN) * abs(left[where])) for where in light}
        guide = {where: (float(light[where][0]), own[where]) for where in light}
    return dict(light), noise


def _part(where: Place, other: Place) -> float:
    """Part of a cell's area that is not more than another's."""
    return float(min(4.0 ** ((where[0] & 31) - (other[0] & 31)), 1.0))


Near = Mapping[Place, Mapping[Place, float]]  # weights of the neighbours of each cell


def all_neighbours(spots: Mapping[Place, Spot], step: int) -> dict[Place, dict[Place, float]]:
    """Neighbours of all cells at a distance, those that a cell has and those that have it."""
    own = {where: neighbours_reference(where, step, spots) for where in spots}
    found = {where: dict(near) for where, near in own.items()}
    for where, near in own.items():
        for other, weight in near.items():
            if where not in own[other]:
                found[other][where] = weight
    return found


def noise_reference(half: Mapping[Place, float], near: Sequence[Near]) -> dict[Place, float]:
    """Root of the mean square of each cell with light and those around it, at one distance after the other."""
    squared = {where: value**2 for where, value in half.items()}
    for at_step in near:
        wide = {}
        for where in squared:
            around = [squared[other] for other in at_step[where] if other in squared]
            wide[where] = float(np.mean([squared[where], *around]))
        squared = wide
    return {where: math.sqrt(value) for where, value in squared.items()}


def blurred_reference(
    where: Place, light: Mapping[Place, np.ndarray], noise: Mapping[Place, float], near: Near
) -> tuple[float, float]:
    """Mean luminance of a cell and the eight around it, and the noise of that."""
    ways = [(other, weight) for other, weight in near[where].items() if other in light]
    weights = np.array([1.0, *(weight for _, weight in ways)])
    around = [where, *(other for other, _ in ways)]
    mean = weights @ np.array([light[other][0] for other in around]) / weights.sum()
    return float(mean), float(np.linalg.norm(weights * [noise[other] for other in around]) / weights.sum())


def neighbours_reference(where: Place, step: int, spots: Mapping[Place, Spot]) -> dict[Place, float]:
    """Cells around the eight points at a distance in the plane of a cell, or beside them along its face's axis, and
    their weights; where there is none, that of the next coarser level, if cameras see both.
    """
    spot, found = spots[where], dict[Place, float]()
    level = where[0] & 31
    if not spot.is_filtered:
        return {}
    axis = int(np.argmax(np.abs(spot.normal)))
    one = np.zeros(3)
    one[axis], one[(axis + 1) % 3] = -spot.normal[(axis + 1) % 3], spot.normal[axis]
    one /= np.linalg.norm(one)
    two = np.cross(spot.normal, one)
    for up, across in itertools.product((-1, 0, 1), repeat=2):
        if across == up == 0:
            continue
        point = spot.unit + (step * across * one + step * up * two) / (1 << level)
        other = _cell_at(point, level, where, spots)
        if other is None and spot.is_seen and level > 0:
            other = _cell_at(point, level - 1, where, spots)
            if other is not None and not spots[other].is_seen:
                other = None
        if other is None or other == where:
            continue
        weight = _in_one_plane(spot, spots[other]) * math.exp(-cells_module._DISTANCE * (across**2 + up**2))
        if weight > cells_module._LEAST_WEIGHT and other not in found:
            found[other] = weight
    return found


def _cell_at(point: np.ndarray, level: int, where: Place, spots: Mapping[Place, Spot]) -> Place | None:
    """Filtered cell of a level around a point, or beside it along the axis of the face, of the face and sheet."""
    _, face, sheet = where
    for beside in (0, 1, -1):
        at = np.floor(point * (1 << level)).astype(int) + beside * (np.arange(3) == face // 2)
        if (at < 0).any() or (at >= 1 << level).any():
            continue
        other = int(morton_encode(at)) << 5 | level, face, sheet
        if other in spots and spots[other].is_filtered:
            return other
    return None


def _in_one_plane(one: Spot, other: Spot) -> float:
    """Weight of the places and normals of two cells."""
    apart, cosine = other.unit - one.unit, float(one.normal @ other.normal)
    height = float(apart @ one.normal) ** 2 / max(float(apart @ apart), 1e-300)
    return max(cosine, 0.0) ** 8 * math.exp(-9.0 * height)


def lookup_reference(cells: Mapping[Place, Cell], key: int, level: int, face: int, sheet: int) -> Cell | None:
    """Light cell above a leaf: the finest one of its sheet and face, then of its face, then the coarsest of all."""
    low, top = min(seen_module.ABOVE_LEAVES, level), min(COARSE, level)
    above = [_above(key, level, up) for up in range(low, top + 1)]
    ways = [(cell, face, sheet) for cell in above] + [(cell, face, ANY_SHEET) for cell in above]
    return next((cells[way] for way in (*ways, (above[-1], ANY_FACE, ANY_SHEET)) if way in cells), None)
