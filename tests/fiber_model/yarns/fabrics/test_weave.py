"""Weaves: the draft decides who lies on top, and yarns keep their distance."""

import numpy as np
import pytest

from tests.fiber_model.yarns.distances import clearance
from weft.fiber_model.yarns.catmull_rom import CatmullRom
from weft.fiber_model.yarns.fabrics import weave as weave_module
from weft.fiber_model.yarns.fabrics.drafts import NAMED_DRAFTS
from weft.fiber_model.yarns.fabrics.weave import weave_parts, weave_yarns
from weft.fiber_model.yarns.yarns import concatenate, rows_within_types
from weft.files.errors import InputError


def weave(draft, warp=24.0, weft=11.5, *, warp_radius=0.2, weft_radius=0.2, size=(4.0, 8.0), **options):
    return weave_yarns(
        size,
        draft=draft,
        warp_per_cm=warp,
        weft_per_cm=weft,
        warp_radius_mm=warp_radius,
        weft_radius_mm=weft_radius,
        **options,
    )


@pytest.mark.parametrize("draft", list(NAMED_DRAFTS))
def test_heights_at_crossings_follow_the_draft(draft):
    yarns = weave(draft, 12, 12, type_names=("warp", "weft"))
    warps, wefts = ([yarns.yarn(y) for y in np.flatnonzero(yarns.yarn_type == system)] for system in (0, 1))
    pattern = NAMED_DRAFTS[draft][::-1]
    assert len(warps) == round(4.0 * 1.2)
    assert len(wefts) == round(8.0 * 1.2)
    for column, warp in enumerate(warps):
        for row, weft in enumerate(wefts):
            warp_z = np.interp(weft[0, 1], warp[:, 1], warp[:, 2])
            weft_z = np.interp(warp[0, 0], weft[:, 0], weft[:, 2])
            on_top = pattern[row % len(pattern), column % len(pattern)]
            assert (warp_z - weft_z) * (1 if on_top else -1) == pytest.approx(0.4, rel=1e-9)


@pytest.mark.parametrize(
    ("draft", "options"),
    [
        ("plain", {"warp": 14.0, "weft": 14.0}),
        *((name, {"size": (6.7, 9.0)}) for name in NAMED_DRAFTS),
        ([[1, 1, 0], [0, 1, 1], [1, 0, 1]], {}),
        ("plain", {"warp": 10.0, "weft": 13.0, "warp_radius": 0.3, "weft_radius": 0.15}),
        ("plain", {"warp": 5.0, "weft": 5.0}),
        ("plain", {"warp": 12.0, "weft": 12.0, "warp_crimp": 0.7}),
    ],
)
def test_yarns_do_not_intersect(draft, options):
    assert clearance(weave(draft, **options)) > 0.99


def test_cloth_has_its_size_and_ends_halfway_between_crossings():
    yarns = weave("plain", 10, 10, size=(5.0, 8.0))
    low, high = yarns.bounds
    assert (low + 0.2)[:2] == pytest.approx([-2.5, -4.0])
    assert (high - 0.2)[:2] == pytest.approx([2.5, 4.0])
    ends = np.concatenate([yarns.points[yarns.offsets[:-1]], yarns.points[yarns.offsets[1:] - 1]])
    assert ends[:, 2] == pytest.approx(np.zeros(len(ends)), abs=1e-12)


def test_one_or_two_yarn_types():
    assert set(weave("plain").yarn_type) == {0}
    two = weave("plain", type_names=("warp", "weft"))
    assert two.type_names == ("warp", "weft")
    along_y = np.array([np.ptp(two.yarn(y)[:, 1]) > np.ptp(two.yarn(y)[:, 0]) for y in range(two.yarn_count)])
    assert np.array_equal(two.yarn_type == 0, along_y)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"warp": 30.0},
            "yarns.warp_per_cm: 30 yarns per cm leave 0.333 mm for each, less than its diameter of 0.4 mm. "
            "At this radius at most 25 fit.",
        ),
        (
            {"warp": 24.0, "weft": 24.0},
            "yarns.weft_per_cm: 24 warp and 24 weft yarns per cm of radii 0.2 and 0.2 mm cannot cross "
            "without intersecting; beside this warp at most 12.6 weft yarns per cm fit",
        ),
        (
            {"warp_crimp": 0.1},
            "yarns.warp_crimp: a warp share of 0.1 makes yarns intersect; at these counts it must lie in "
            "[0.854, 1]",
        ),
        (
            {"size": (1e6, 1e6)},
            "yarns.size_mm: this weave would have 88,320,000,000,000 control points; at most 100,000,000 fit",
        ),
    ],
)
def test_impossible_cloth_is_refused(options, message):
    with pytest.raises(InputError) as caught:
        weave("plain", **options)
    assert str(caught.value) == message


def test_stated_limit_can_be_woven():
    assert clearance(weave("plain", 24, 12.6)) > 0.99


PLAIN = {
    "draft": "herringbone_2_2",
    "warp_per_cm": 12.0,
    "weft_per_cm": 9.0,
    "warp_radius_mm": 0.2,
    "weft_radius_mm": 0.25,
}


@pytest.mark.parametrize("names", [("yarn",), ("warp", "weft")])
def test_parts_are_the_whole_weave(monkeypatch, names):
    """Bit by bit and in the same order, with the rows that yarns have in the whole."""
    monkeypatch.setattr(weave_module, "GROUP_POINTS", 1500)
    parts = list(weave_parts((20.0, 15.0), type_names=names, **PLAIN))
    whole = weave_yarns((20.0, 15.0), type_names=names, **PLAIN)
    joined = concatenate(parts)
    assert len(parts) > 6
    for name in ("points", "offsets", "radius", "yarn_type"):
        assert np.array_equal(getattr(joined, name), getattr(whole, name))
    assert np.array_equal(joined.row, rows_within_types(whole.yarn_type))


def test_parts_within_a_rectangle_are_yarns_of_the_whole():
    wanted = np.array([[-3.0, 1.0], [2.0, 4.0]])
    some = concatenate(list(weave_parts((20.0, 15.0), type_names=("warp", "weft"), within=wanted, **PLAIN)))
    whole = weave_yarns((20.0, 15.0), type_names=("warp", "weft"), **PLAIN)
    rows = rows_within_types(whole.yarn_type)
    assert [int((some.yarn_type == kind).sum()) for kind in (0, 1)] == [6, 3]
    for yarn in range(some.yarn_count):
        same = np.flatnonzero((whole.yarn_type == some.yarn_type[yarn]) & (rows == some.row[yarn]))
        assert np.array_equal(some.yarn(yarn), whole.yarn(int(same[0])))


@pytest.mark.parametrize(("count", "part"), [(4, 0.045), (6, 0.02), (8, 0.011), (16, 0.003)])
def test_fewer_points_keep_the_curve(count, part):
    """As a part of the yarn's radius, in the densest square plain weave of these yarns."""
    from scipy.spatial import cKDTree

    dense = {"draft": "plain", "warp_per_cm": 14.0, "weft_per_cm": 14.0}
    dense |= {"warp_radius_mm": 0.206, "weft_radius_mm": 0.206}

    def places(points, each):
        curves = CatmullRom.through(weave_yarns((5.0, 5.0), points_per_crossing=points, **dense))
        segment = np.repeat(np.arange(len(curves.coefficients)), each)
        return curves.position(segment, np.tile(np.arange(each) / each, len(curves.coefficients)))

    distance = cKDTree(places(64, 16)).query(places(count, 8))[0]
    assert 0.3 * part < distance.max() / 0.206 < part
