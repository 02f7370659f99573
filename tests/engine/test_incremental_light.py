# SPDX-License-Identifier: GPL-3.0-or-later
"""Incremental bakes: pieces, shadows and bounces that a change can reach, and texels that are taken over."""

from pathlib import Path

import numpy as np
import pytest

from patchnet.patchnet_addon.lightmap.chart_lookup import texel_owners
from patchnet.patchnet_addon.lightmap.charts import Charts, layout_charts
from patchnet.patchnet_addon.lightmap.incremental.bounce import change_bound, groups_of
from patchnet.patchnet_addon.lightmap.incremental.follow import Change, Levels, albedo_of, follow
from patchnet.patchnet_addon.lightmap.incremental.hidden import hidden_share, joined_boxes
from patchnet.patchnet_addon.lightmap.incremental.pieces import Pieces, pieces_of
from patchnet.patchnet_addon.lightmap.incremental.record import BakeRecord, load_record, save_record
from patchnet.patchnet_addon.lightmap.incremental.shadows import Lamp, may_shadow
from patchnet.patchnet_addon.lightmap.incremental.texels import charts_of, copied, same_charts, with_partners
from patchnet.patchnet_addon.runtime.progress import drain
from patchnet.patchnet_addon.surface.mesh import Material, Texture, TriangleMesh

GRAY = (Material("gray", (0.5, 0.5, 0.5)),)


def triangles(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(count, 3, 3)) * np.exp(rng.normal(size=(count, 1, 1)))
    return corners + rng.normal(size=(count, 1, 3)) * 4


def plane(side: float, cells: int, z: float = 0.0) -> np.ndarray:
    """Triangles (2 cells^2, 3, 3) of a square from -side / 2 to side / 2."""
    edges = np.linspace(-side / 2, side / 2, cells + 1)
    x, y = (axis.ravel() for axis in np.meshgrid(edges[:-1], edges[:-1], indexing="ij"))
    step = side / cells
    low = np.stack([x, y, np.full(len(x), z)], -1)
    a, b, c = low + [step, 0, 0], low + [step, step, 0], low + [0, step, 0]
    return np.concatenate([np.stack([low, a, b], 1), np.stack([low, b, c], 1)])


def room(side: float, cells: int) -> np.ndarray:
    """Triangles of the six faces of a cube around the origin, which face inwards."""
    floor = plane(side, cells, -side / 2)
    ceiling = (floor * [1, 1, -1])[:, ::-1]
    return np.concatenate([np.roll(face, axis, axis=-1) for axis in range(3) for face in (floor, ceiling)])


def layout(corners: np.ndarray, texel: float = 0.2, page_side: int = 64, samples: int = 8) -> Charts:
    mesh = TriangleMesh.from_arrays(corners)
    return drain(layout_charts(mesh, texel, page_side=page_side, samples=samples))


@pytest.mark.parametrize("count", [1, 7, 300])
def test_pieces_cover_all_triangles(count: int) -> None:
    mesh = TriangleMesh.from_arrays(triangles(count))
    pieces = drain(pieces_of(mesh))
    corners = mesh.parts[0].corners_world
    areas = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    np.testing.assert_allclose(np.bincount(pieces.triangle, pieces.area, count), areas, rtol=1e-9)
    weights = np.random.default_rng(1).dirichlet((1, 1, 1), size=40)
    for triangle in range(min(count, 30)):
        mine = pieces.triangle == triangle
        points = weights @ corners[triangle]
        distance = np.linalg.norm(points[:, None] - pieces.centre[mine][None], axis=-1)
        assert (distance <= pieces.radius[mine] * (1 + 1e-9)).any(axis=1).all()


@pytest.mark.parametrize("far", [False, True])
def test_no_shadow_is_missed(far: bool) -> None:
    """Against segments between random points of both balls, each asked step by step."""
    rng = np.random.default_rng(2)
    count = 400
    centre, radius = rng.uniform(-2, 2, (count, 3)), rng.uniform(0.01, 0.2, count)
    pieces = Pieces(np.arange(count), centre, radius, np.tile([0.0, 0.0, 1.0], (count, 1)), np.ones(count))
    boxes = np.array([[[-0.3, -0.2, 0.1], [0.2, 0.3, 0.6]], [[1.0, 1.0, -1.0], [1.1, 1.4, 1.0]]])
    towards = np.array([0.6, 0.0, 0.8])
    lamp = Lamp(tuple(towards), 0.05, True) if far else Lamp((0.5, 0.4, 3.0), 0.3)
    found = may_shadow(pieces, lamp, boxes)
    met = np.zeros(count, bool)
    for _ in range(60):
        start = centre + radius[:, None] * _in_ball(rng, count)
        if far:
            end = start + 8 * (towards + lamp.radius * _in_ball(rng, count))
        else:
            end = np.array(lamp.place) + lamp.radius * _in_ball(rng, count)
        steps = np.linspace(0, 1, 200)[:, None, None]
        points = start + steps * (end - start)
        for box in boxes:
            met |= ((points >= box[0]) & (points <= box[1])).all(axis=-1).any(axis=0)
    assert not (met & ~found).any()
    assert met.mean() > 0.02 and found.mean() < 3 * met.mean() + 0.1, "and not far too many are taken for shadowed"


def _in_ball(rng: np.random.Generator, count: int) -> np.ndarray:
    way = rng.normal(size=(count, 3))
    return way / np.linalg.norm(way, axis=1, keepdims=True) * rng.uniform(0, 1, (count, 1)) ** (1 / 3)


def test_in_a_closed_room_a_wall_gets_what_the_others_send() -> None:
    pieces = drain(pieces_of(TriangleMesh.from_arrays(room(2.0, 4))))
    groups = groups_of(pieces, np.full(len(pieces.area), 0.5))
    floor = groups.centre[:, 2] < -0.99
    bound = change_bound(groups, np.ones(len(floor)))
    # All walls shine with 1, albedo 1/2: 1 + 1/2 + 1/4 + ... = 2.
    assert bound.mean() == pytest.approx(2.0, rel=0.1) and bound.min() > 1.4
    one = change_bound(groups, floor.astype(float))
    opposite = groups.centre[:, 2] > 0.99
    # The floor sends a cube's opposite wall a fifth of what it gets, before any further bounce.
    assert one[opposite].mean() > 0.19 and one[floor].mean() < one[opposite].mean()
    assert change_bound(groups, np.zeros(len(floor))).max() == 0.0


def test_what_hides_a_box_falls_with_its_distance() -> None:
    pieces = drain(pieces_of(TriangleMesh.from_arrays(plane(20.0, 20), GRAY)))
    groups = groups_of(pieces, np.full(len(pieces.area), 0.5))
    box = np.array([[[-0.5, -0.5, 0.0], [0.5, 0.5, 1.0]]])
    share = hidden_share(groups, box, np.array([np.inf]))
    distance = np.linalg.norm(groups.centre[:, :2], axis=1)
    assert share[distance < 1].min() == pytest.approx(1.0), "beside it all may be hidden"
    assert share[distance > 9].max() < 0.004 and share.min() > 0.0
    wire = hidden_share(groups, box, np.array([0.01]))
    assert (wire <= share).all() and wire[distance > 3].max() < 0.2 * share[distance > 3].min() + 0.001


def test_no_group_sees_more_of_a_box_than_its_share() -> None:
    """Against directions that are spread as light falls: from points anywhere in groups, along any of their normals."""
    rng = np.random.default_rng(5)
    corners = triangles(1000, seed=5) * 0.2
    pieces = drain(pieces_of(TriangleMesh.from_arrays(corners, GRAY)))
    groups = groups_of(pieces, np.full(len(pieces.area), 0.5), 12)
    boxes = np.array([[[1.0, -0.2, 0.0], [1.4, 0.9, 0.7]], [[-1.5, -1.5, -1.0], [-1.4, -0.4, -0.3]]])
    share = hidden_share(groups, boxes, np.full(2, np.inf))
    chosen = rng.choice(len(pieces.area), 200, replace=False)
    turn, height = rng.uniform(0, 2 * np.pi, 20_000), np.sqrt(rng.uniform(0, 1, 20_000))
    for piece in chosen:
        start = pieces.centre[piece] + pieces.radius[piece] * rng.uniform(-0.5, 0.5, 3)
        seen = 0.0
        for side in (1.0, -1.0):
            normal = side * pieces.normal[piece]
            along = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
            along /= np.linalg.norm(along)
            flat = np.sqrt(1.0 - height**2)[:, None] * (
                np.cos(turn)[:, None] * along + np.sin(turn)[:, None] * np.cross(normal, along)
            )
            way = flat + height[:, None] * normal
            with np.errstate(divide="ignore"):
                ends = (boxes[:, None] - start).transpose(2, 0, 1, 3) / way[None, None]
            enter = ends.min(axis=0).max(axis=-1)
            leave = ends.max(axis=0).min(axis=-1)
            seen = max(seen, float(((enter <= leave) & (leave >= 0.0)).any(axis=0).mean()))
        assert seen <= share[groups.of[piece]] + 0.01, "but for the noise of 20,000 directions"
    far = share < 0.9
    assert far.sum() > 50


def test_boxes_that_show_no_more_together_are_one() -> None:
    first = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    boxes = np.stack([first, first + [0.3, 0.0, 0.0], first + [9.0, 0.0, 0.0]])
    joined, areas = joined_boxes(boxes, np.array([1.0, 2.0, 4.0]))
    np.testing.assert_allclose(joined, [[[0, 0, 0], [1.3, 1, 1]], boxes[2]])
    np.testing.assert_array_equal(areas, [3.0, 4.0])


def test_a_shadow_is_followed_and_the_rest_stays() -> None:
    mesh = TriangleMesh.from_arrays(plane(20.0, 20), GRAY)
    box = np.array([[[-0.5, -0.5, 1.0], [0.5, 0.5, 1.5]]])
    slanted = Lamp((-0.8, 0.0, 0.6), 0.005, True)
    again, most = drain(follow(mesh, Change(box, np.array([3.5]), (slanted,)), 1.0, 0.02))
    middle = mesh.parts[0].corners_world.mean(axis=1)
    shadow = np.linalg.norm(middle[:, :2] - [1.7, 0.0], axis=1) < 0.5  # 1.25 up, 4/3 along x a metre
    away = np.linalg.norm(middle[:, :2], axis=1) > 8
    assert again[shadow].all() and not again[away].any() and (most[shadow] >= 1.0).all()
    assert (most[~again] <= 0.02).all() and most.min() >= 0.0
    lamp = Lamp((0.0, 0.0, 2.0), 0.1, False, 1.0)
    nobody = np.empty((0, 2, 3)), np.empty(0)
    lit, bound = drain(follow(mesh, Change(*nobody, (), (lamp,)), 1.0, 0.02))
    below = np.linalg.norm(middle[:, :2], axis=1) < 0.6
    assert lit[below].all() and not lit[away].any()
    exact = 0.5 * 1.0 / np.pi * 2.0 / (np.linalg.norm(middle - [0, 0, 2.0], axis=1)) ** 3
    assert (bound >= exact).all(), "never less than what the lamp gives where it is seen"


@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 1.0])
def test_texels_of_some_triangles_go_to_other_charts_and_back(share: float) -> None:
    charts = layout(triangles(400))
    rng = np.random.default_rng(3)
    chosen = with_partners(charts, rng.random(400) < share)
    part = charts_of(charts, chosen)
    texels = rng.random((charts.texel_count, 3)).astype(np.float32)
    same = np.where(chosen, np.arange(400), -1)
    assert same_charts(charts, part, same)[chosen].all() if share else not chosen.any()
    alone = np.zeros((part.texel_count, 3), np.float32)
    copied(alone, part, texels, charts, same)
    back = np.full_like(texels, -1.0)
    copied(back, charts, alone, part, same)
    owners = np.concatenate([texel_owners(charts, page) for page in range(charts.page_count)])
    mine = (owners >= 0) & chosen[owners]
    np.testing.assert_array_equal(back[mine], texels[mine])
    assert (back[~mine] == -1.0).all()
    assert part.texel_count <= charts.texel_count and (part.page[~chosen] == -1).all()


def test_charts_of_halves_of_a_rectangle_are_refused() -> None:
    charts = layout(plane(4.0, 2))
    second = np.zeros(8, bool)
    second[np.flatnonzero(charts.kind == 1)[:1]] = True
    with pytest.raises(ValueError, match="chosen together"):
        charts_of(charts, second)


def test_a_record_is_read_as_it_was_written(tmp_path: Path) -> None:
    charts = layout(triangles(12))
    texels = np.random.default_rng(4).random((charts.texel_count, 4)).astype(np.float32)
    drift = np.linspace(0, 1, 12, dtype=np.float32)
    turned, items = np.arange(12) % 5 == 0, {"all": "x", "items": []}
    record = BakeRecord(charts, texels, drift, turned, ["a", "b", "a"], np.array([4, 4, 4]), items)
    assert load_record("key", tmp_path) is None
    save_record("key", record, tmp_path)
    found = load_record("key", tmp_path)
    assert found is not None and found.scene == record.scene and list(found.placed) == ["a", "b", "a"]
    np.testing.assert_array_equal(found.texels, texels)
    np.testing.assert_array_equal(found.turned, turned)
    np.testing.assert_array_equal(found.charts.page_size, charts.page_size)
    assert same_charts(found.charts, charts, np.arange(12)).all()
    # One of the two that are alike is gone, another has come.
    before = found.triangles_before(["c", "a", "b"], np.array([3, 4, 4]))
    np.testing.assert_array_equal(before, [-1, -1, -1, 0, 1, 2, 3, 4, 5, 6, 7])
    file = next(tmp_path.rglob("*.safetensors"))
    file.write_bytes(file.read_bytes()[:-9])
    assert load_record("key", tmp_path) is None and not file.exists()


def test_levels_are_quantiles_by_area() -> None:
    luminance, area = np.array([5.0, 0.2, 0.1]), np.array([0.0005, 0.5, 0.4995])
    found = Levels.of(luminance, area)
    assert (found.white, found.brightest) == (0.2, 0.2)
    assert Levels.of(np.empty(0), np.empty(0)).white == 0.0
    pixels = np.zeros((4, 5, 3), np.float32)
    pixels[0] = 0.8
    assert albedo_of(Material("m", (1.0, 1.0, 1.0), Texture("t", pixels))) == pytest.approx(0.8)
    assert albedo_of(Material("m", (1.0, 1.0, 1.0))) == 0.95
