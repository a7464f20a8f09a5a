"""Cloth on meshes: offset, stretch, seams, orientation."""

import numpy as np
import pytest

from tests.fiber_model.yarns.garments.meshes import cylinder, mapped, plane
from weft.fiber_model.yarns.catmull_rom import yarn_lengths
from weft.fiber_model.yarns.fabrics import weave as weave_module
from weft.fiber_model.yarns.fabrics.knit import knit_yarns
from weft.fiber_model.yarns.fabrics.weave import weave_parts, weave_yarns
from weft.fiber_model.yarns.garments.charts import build_charts
from weft.fiber_model.yarns.garments.garment_shapes import scarf_mesh, sleeve_mesh
from weft.fiber_model.yarns.garments.on_mesh import FlatPattern, lay_on_mesh
from weft.fiber_model.yarns.yarns import YarnSet
from weft.files.errors import InputError

STITCH = 4.0
COURSE = 0.65 * STITCH
KNIT = FlatPattern(
    np.array([STITCH, COURSE]), lambda size: knit_yarns(size, stitch_width_mm=STITCH), least_piece_mm=STITCH
)
WEAVE = FlatPattern(
    np.array([2.0, 2.0]),
    lambda size: weave_yarns(
        size, draft="plain", warp_per_cm=10, weft_per_cm=10, warp_radius_mm=0.2, weft_radius_mm=0.2
    ),
)


def threads(direction, spacing=2.0):
    """Straight threads of one direction, 0 along x or 1 along y, that carry no height."""

    def make(size):
        along = np.arange(-0.5 * size[direction], 0.5 * size[direction] + 0.1, 0.5)
        places = np.arange(-0.5 * size[1 - direction] + 0.5 * spacing, 0.5 * size[1 - direction], spacing)
        curves = []
        for place in places:
            curve = np.zeros((len(along), 3))
            curve[:, direction], curve[:, 1 - direction] = along, place
            curves.append(curve)
        return YarnSet.checked(curves, radius=0.2)

    return FlatPattern(np.array([spacing, spacing]), make)


def lay(mesh, pattern, charts=None, **options):
    return lay_on_mesh(mesh, build_charts(mesh) if charts is None else charts, pattern, **options)


def test_on_a_plane_the_cloth_is_the_flat_cloth():
    yarns = lay(plane(), KNIT)
    flat = knit_yarns((200, 200), stitch_width_mm=STITCH)
    profile = np.unique(np.round(flat.points[:, 2], 6))
    on_profile = np.abs(yarns.points[:, 2:] - profile).min(axis=1)
    # the points at cuts lie between those of the pattern
    assert (on_profile < 1e-5).mean() > 0.97
    assert yarns.report.yarn_stretch == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("offset", [0.0, 1.5, -1.0])
def test_yarns_keep_their_distance_from_the_surface(offset):
    radius, around = 20.0, 48
    yarns = lay(cylinder(radius, around=around), KNIT, offset_mm=offset)
    height = np.hypot(yarns.points[:, 0], yarns.points[:, 2]) - radius - offset
    depth = np.abs(knit_yarns((40, 40), stitch_width_mm=STITCH).points[:, 2]).max()
    sagitta = radius * (1 - np.cos(np.pi / around))
    assert np.abs(height).max() < depth + 0.1 * sagitta
    assert height.max() > 0.9 * depth
    assert height.min() < -0.9 * depth


def test_rounding_removes_the_facets():
    """Threads without height on a coarse tube lie nearer to the circle than the chords do."""
    radius, around = 20.0, 24
    yarns = lay(cylinder(radius, around=around), threads(0))
    sagitta = radius * (1 - np.cos(np.pi / around))
    assert np.abs(np.hypot(yarns.points[:, 0], yarns.points[:, 2]) - radius).max() < 0.05 * sagitta


@pytest.mark.parametrize("pattern", [KNIT, threads(0)])
def test_courses_around_a_tube_close(pattern):
    """The girth is no whole number of stitches: the pattern is fitted to it, and each course is one loop."""
    yarns = lay(cylinder(20.3), pattern)
    around = np.ptp(yarns.points[:, 0]) > 40
    assert around
    loops = np.flatnonzero(yarns.closed)
    assert len(loops) >= 12
    for loop in loops:
        points = yarns.yarn(loop)
        angle = np.unwrap(np.arctan2(points[:, 0], points[:, 2]))
        assert abs(angle[-1] - angle[0]) == pytest.approx(2 * np.pi, abs=0.3)
    if pattern is not KNIT:
        assert yarns.closed.all()


def test_a_seam_leaves_no_kink():
    """Chords across the seam differ from the others by less than half, and turn no more than others do."""
    yarns = lay(cylinder(), KNIT)
    for loop in np.flatnonzero(yarns.closed):
        points = yarns.yarn(loop)
        chord = np.diff(np.concatenate([points, points[:2]]), axis=0)
        length = np.linalg.norm(chord, axis=1)
        turn = (chord[1:] * chord[:-1]).sum(axis=1) / (length[1:] * length[:-1])
        assert length.max() < 1.6 * np.median(length)
        assert turn.min() > 0.8
    assert yarns.closed.sum() >= 12


def test_without_joining_every_yarn_ends_at_the_seam():
    yarns = lay(cylinder(), KNIT, join_seams=False)
    assert not yarns.closed.any()
    assert yarns.report.joint_count == 0
    assert yarns.report.open_end_count == 2 * yarns.yarn_count


def test_warps_continue_across_a_seam_between_charts():
    """Two charts of one sheet, one shifted by whole periods: yarns run on from one to the other."""

    def uv(u, v):
        return np.stack([u + np.where(u.mean(axis=1, keepdims=True) > 20, 10.0, 0.0), v], axis=-1)

    mesh = plane(uv=uv)
    charts = build_charts(mesh)
    assert len(charts) == 2
    yarns = lay(mesh, threads(0), charts)
    assert yarns.yarn_count == 15
    assert yarn_lengths(yarns) == pytest.approx(np.full(15, 40.0), abs=1e-6)


def test_yarns_continue_into_a_chart_that_runs_the_other_way():
    """The second chart is turned by half a turn: its pieces are walked backward."""

    def uv(u, v):
        turned = u.mean(axis=1, keepdims=True) > 20
        return np.stack([np.where(turned, 60 - u, u), np.where(turned, 30 - v, v)], axis=-1)

    mesh = plane(uv=uv)
    yarns = lay(mesh, threads(0))
    assert yarns.yarn_count == 15
    assert yarn_lengths(yarns) == pytest.approx(np.full(15, 40.0), abs=1e-6)


@pytest.mark.parametrize("direction", [0, 1])
def test_arc_length_follows_the_metric(direction):
    """(u, v) compressed to a half along one side: threads along it come out twice as long, others do not."""
    scale = np.array([0.5, 1.0])
    mesh = plane(uv=lambda u, v: np.stack([u, v], axis=-1) * scale)
    yarns = lay(mesh, threads(direction))
    assert yarns.report.yarn_stretch == pytest.approx([2.0, 1.0][direction], abs=1e-9)
    assert yarns.report.stretch_min == pytest.approx(1.0, abs=1e-9)
    assert yarns.report.stretch_max == pytest.approx(2.0, abs=1e-9)
    assert yarns.report.stretch_mean == pytest.approx(np.sqrt(2.0), abs=1e-9)


def test_the_report_says_where_the_cloth_stretches():
    """A cone stretches most where it is widest."""

    def cone(u, v):
        angle = u / 20
        radius = 20 + 0.2 * v
        return np.stack([radius * np.sin(angle), v, radius * np.cos(angle)], axis=-1)

    mesh = mapped(cone, np.linspace(0, 40 * np.pi, 97), np.linspace(0, 40, 21))
    report = lay(mesh, threads(0, spacing=40 * np.pi / 60)).report
    assert report.stretch_max == pytest.approx(28 / 20, rel=0.01)
    assert report.stretch_max_at_mm[1] > 37
    assert report.stretch_min_at_mm[1] < 3


def test_uv_without_unit_takes_the_size_of_the_surface():
    unit_square = plane(uv=lambda u, v: np.stack([u, v], axis=-1) / 400, unit=None)
    with_unit = lay(plane(), threads(1))
    without = lay(unit_square, threads(1))
    assert without.report.stretch_mean == pytest.approx(1.0)
    assert without.report.yarn_length_mm == pytest.approx(with_unit.report.yarn_length_mm, rel=1e-9)


def test_mirrored_charts_are_turned_over():
    """Mirrored (u, v) must not give a mirrored twill: its diagonal stays the same."""
    twill = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]])
    pattern = FlatPattern(
        np.array([3.0, 3.0]),
        lambda size: weave_yarns(
            size, draft=twill, warp_per_cm=10, weft_per_cm=10, warp_radius_mm=0.2, weft_radius_mm=0.2
        ),
    )
    straight = lay(plane(), pattern)
    mirrored = lay(plane(uv=lambda u, v: np.stack([-u, v], axis=-1)), pattern)
    assert twill_diagonal(straight) == twill_diagonal(mirrored) == -1


def twill_diagonal(yarns):
    """+1 where the lifted warp points of the cloth climb to the right, -1 where they climb to the left."""
    warps = [curve for curve in map(yarns.yarn, range(yarns.yarn_count)) if np.ptp(curve[:, 0]) < 0.1]
    warp = np.concatenate([curve[curve[:, 2] > 0.99 * curve[:, 2].max()] for curve in warps])
    votes = 0
    for point in warp[::20]:
        offset = warp[:, :2] - point[:2]
        for side in (1, -1):
            votes += side * int((np.abs(offset - [side * 1.0, 1.0]).max(axis=1) < 0.3).any())
    return int(np.sign(votes))


def test_the_face_lies_outside():
    """The V's of stockinette are on the outside of a tube: legs lie higher than the loops' heads and feet."""
    yarns = lay(cylinder(), KNIT)
    height = np.hypot(yarns.points[:, 0], yarns.points[:, 2]) - 20
    # legs run along the wale, heads and feet along the course: on the face the wale direction dominates
    direction = np.abs(np.gradient(yarns.yarn(int(np.argmax(yarns.closed))), axis=0))
    loop_height = height[yarns.offsets[int(np.argmax(yarns.closed))] :][: len(direction)]
    upright = direction[:, 1] > np.hypot(direction[:, 0], direction[:, 2])
    assert loop_height[upright].mean() > 0.3
    assert loop_height[~upright].mean() < loop_height[upright].mean() - 0.3


def test_grain_turns_charts_upright():
    """(u, v) turned by 90 degrees: threads along the cloth's y still rise."""
    mesh = plane(uv=lambda u, v: np.stack([v, -u], axis=-1))
    for grain, axis in (("uv", 0), ("up", 1)):
        yarns = lay(mesh, threads(1), build_charts(mesh, grain=grain))
        first, last = yarns.yarn(3)[[0, -1]]
        assert np.argmax(np.abs(last - first)) == axis
        if grain == "up":
            assert last[1] > first[1]


def test_cut_yarns_end_on_the_border():
    yarns = lay(plane(39.3, 29.1), WEAVE)
    ends = yarns.points[np.concatenate([yarns.offsets[:-1], yarns.offsets[1:] - 1])]
    gap = np.minimum.reduce([ends[:, 0], 39.3 - ends[:, 0], ends[:, 1], 29.1 - ends[:, 1]])
    assert np.abs(gap).max() < 1e-6


def test_loose_arcs_fall_off():
    """No piece of knit whose two ends lie within one stitch is left at a border that slits loops."""
    yarns = lay(plane(), KNIT)
    first, last = yarns.points[yarns.offsets[:-1]], yarns.points[yarns.offsets[1:] - 1]
    assert np.linalg.norm(last - first, axis=1).min() > 0.95 * STITCH


def test_yarns_carry_the_surface_coordinates():
    yarns = lay(plane(uv=lambda u, v: np.stack([u + 3, 2 * v], axis=-1), unit=2.0), threads(1))
    assert yarns.surface_uv == pytest.approx(yarns.points[:, :2] * [1, 2] + [3, 0], abs=1e-6)


def test_a_scarf_bends_and_does_not_stretch():
    report = lay(scarf_mesh(width_mm=60, length_mm=30, fold_depth_mm=5, step_mm=1), KNIT).report
    assert report.stretch_min > 0.995
    assert report.stretch_max < 1.0005


def test_a_scarf_over_a_rail_hangs_on_both_sides_and_hardly_stretches():
    mesh = scarf_mesh(
        width_mm=60, length_mm=240, fold_depth_mm=3, rail_radius_mm=8, front_share=0.6, step_mm=1
    )
    front, back = mesh.vertices[mesh.vertices[:, 2] > 0], mesh.vertices[mesh.vertices[:, 2] < 0]
    quarter = 4 * np.pi
    assert front[:, 1].min() == pytest.approx(-(0.6 * 240 - quarter), abs=0.05)
    assert back[:, 1].min() == pytest.approx(-(0.4 * 240 - quarter), abs=0.05)
    assert mesh.vertices[:, 1].max() == pytest.approx(8.0, abs=0.02)
    assert (mesh.vertex_normals()[mesh.vertices[:, 2] > 7.5, 2] > 0).all()
    report = lay(mesh, KNIT).report
    assert report.stretch_min > 0.9
    assert report.stretch_max < 1.1


def test_a_sleeve_keeps_its_length_and_reports_its_girth():
    mesh = sleeve_mesh(length_mm=60, cuff_girth_mm=80, top_girth_mm=100)
    yarns = lay(mesh, threads(1))
    assert yarn_lengths(yarns) == pytest.approx(np.full(yarns.yarn_count, 60.0), rel=2e-3)
    folded = sleeve_mesh(length_mm=60, cuff_girth_mm=80, top_girth_mm=100, fold_depth_mm=5, step_mm=1)
    assert lay(folded, threads(1)).report.yarn_stretch == pytest.approx(1.0, abs=0.01)
    assert yarns.report.stretch_min == pytest.approx(80 / 90, rel=0.01)
    assert yarns.report.stretch_max == pytest.approx(100 / 90, rel=0.01)


def test_charts_too_small_for_the_pattern_are_refused():
    mesh = plane(1.0, 1.0)
    with pytest.raises(InputError, match="no yarn of the pattern fits"):
        lay(mesh, KNIT)


OPEN_WEAVE = {
    "draft": "plain",
    "warp_per_cm": 10,
    "weft_per_cm": 10,
    "warp_radius_mm": 0.2,
    "weft_radius_mm": 0.2,
    "type_names": ("warp", "weft"),
}


def woven(in_parts):
    def parts(size, within):
        return weave_parts(size, within=within, **OPEN_WEAVE)

    return FlatPattern(
        np.array([2.0, 2.0]),
        lambda size: weave_yarns(size, **OPEN_WEAVE),
        make_parts=parts if in_parts else None,
    )


def test_cloth_made_in_parts_is_the_same(monkeypatch):
    monkeypatch.setattr(weave_module, "GROUP_POINTS", 5000)
    mesh = sleeve_mesh(length_mm=60.0, cuff_girth_mm=60.0, top_girth_mm=80.0, fold_depth_mm=4.0, step_mm=2.0)
    whole, parts = (lay(mesh, woven(in_parts), hem_mm=2.0) for in_parts in (False, True))
    for name in ("points", "offsets", "closed", "radius", "yarn_type", "surface_uv", "row"):
        assert np.array_equal(getattr(whole, name), getattr(parts, name))
    assert parts.report.joint_count == whole.report.joint_count > 0


def test_a_region_holds_the_same_cloth():
    """Points inside are those of the whole, bit by bit, in yarns of the same rows; little lies beyond."""
    mesh = plane(80.0, 80.0)
    region = np.array([[28.0, 28.0, -5.0], [52.0, 52.0, 5.0]])
    whole, part = lay(mesh, woven(True)), lay(mesh, woven(True), region_mm=region)

    def inside(yarns):
        kept = ((yarns.points >= region[0]) & (yarns.points <= region[1])).all(axis=1)
        yarn = np.repeat(np.arange(yarns.yarn_count), yarns.point_counts)[kept]
        return {
            (*point, yarns.yarn_type[y], yarns.row[y])
            for point, y in zip(yarns.points[kept], yarn, strict=True)
        }

    assert inside(part) == inside(whole)
    assert len(inside(part)) > 10_000
    assert part.point_count < 0.5 * whole.point_count


def test_a_region_without_cloth_is_refused():
    region = np.array([[900.0, 0.0, 0.0], [901.0, 1.0, 1.0]])
    with pytest.raises(InputError, match=r"region_mm: no cloth lies in it"):
        lay(plane(), woven(True), region_mm=region)


def test_laying_takes_little_more_than_its_yarns():
    """Bytes per control point at the worst moment; 260 where all of it is made at once."""
    import tracemalloc

    mesh = plane(150.0, 150.0)
    tracemalloc.start()
    yarns = lay(mesh, woven(True), hem_mm=2.0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert yarns.point_count > 500_000
    assert peak / yarns.point_count < 150
