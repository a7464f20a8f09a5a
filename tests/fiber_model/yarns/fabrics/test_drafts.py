"""Weave drafts: named ones are what weavers mean by the name; others are matrices of bits or text."""

import numpy as np
import pytest

from weft.fiber_model.yarns.config import WeaveConfig
from weft.fiber_model.yarns.fabrics.drafts import NAMED_DRAFTS, draft_matrix, refuse_loose_yarns, satin, twill
from weft.files.errors import InputError


def rows(name):
    return ["".join(".x"[bit] for bit in row) for row in NAMED_DRAFTS[name].astype(int)]


def longest_float(line):
    """Most crossings in a row on one face, in an endless repeat of the draft."""
    doubled = "".join(".x"[bit] for bit in np.tile(line, 2).astype(int))
    return max(len(run) for face in ".x" for run in doubled.split(face))


def test_named_drafts_look_as_weavers_draw_them():
    assert rows("plain") == [".x", "x."]
    # rising to the right: one column further is one row higher
    assert rows("twill_2_2") == ["x..x", "..xx", ".xx.", "xx.."]
    assert rows("basket_2_2") == ["..xx", "..xx", "xx..", "xx.."]


@pytest.mark.parametrize("name", ["twill_2_1", "twill_3_1", "twill_2_2"])
def test_twill_lines_rise_to_the_right(name):
    draft = NAMED_DRAFTS[name]
    assert np.array_equal(np.roll(draft, (-1, 1), axis=(0, 1)), draft)
    over, under = int(name[-3]), int(name[-1])
    assert (draft.sum(axis=0) == over).all()
    assert (draft.sum(axis=1) == over).all()
    assert len(draft) == over + under


@pytest.mark.parametrize("name", ["broken_twill_3_1", "broken_twill_2_2", "herringbone_2_2"])
def test_broken_lines_keep_their_floats(name):
    """Neither breaks nor turns make a warp or weft float farther than in the plain twill."""
    draft = NAMED_DRAFTS[name]
    most = max(int(name[-3]), int(name[-1]))
    assert max(longest_float(line) for line in [*draft, *draft.T]) == most
    assert not np.array_equal(np.roll(draft, (-1, 1), axis=(0, 1)), draft)


def test_herringbone_rises_then_falls_and_breaks_clean():
    draft = NAMED_DRAFTS["herringbone_2_2"]
    left, right = draft[:, :8], draft[:, 8:]
    assert np.array_equal(np.roll(left, (-1, 1), axis=(0, 1)), left)
    assert np.array_equal(np.roll(right, (1, 1), axis=(0, 1)), right)
    assert np.array_equal(draft[:, 7], ~draft[:, 8])
    assert np.array_equal(draft[:, 15], ~draft[:, 0])


@pytest.mark.parametrize("ends", [5, 8])
def test_satin_binders_are_spread(ends):
    draft = NAMED_DRAFTS[f"satin_{ends}"]
    assert (draft.sum(axis=0) == ends - 1).all()
    assert (draft.sum(axis=1) == ends - 1).all()
    binders = np.argwhere(~draft)
    assert not any((abs(a - b) == [1, 1]).all() for a in binders for b in binders)


def test_text_is_a_matrix():
    assert np.array_equal(draft_matrix(["x..x", "..xx", ".xx.", "XX.."]), NAMED_DRAFTS["twill_2_2"])
    config = WeaveConfig(kind="weave", size_mm=(9, 9), draft=["xx.", ".xx", "x.x"])
    assert draft_matrix(config.draft).tolist() == [[1, 1, 0], [0, 1, 1], [1, 0, 1]]


def test_drafts_must_be_rectangles_of_bits():
    for bad in ([[1, 0], [1]], [[1, 2]], [[]], ["x.", "x"], ["xo"], [""]):
        with pytest.raises(InputError):
            draft_matrix(bad)
    assert np.array_equal(draft_matrix([[0, 1], [1, 0]]), twill(1, 1))
    assert satin(5, 2).sum() == 20


@pytest.mark.parametrize(
    ("draft", "message"),
    [
        (["x.x", ".xx"], "yarns.draft: the warp of column 3 never changes faces, so that nothing holds it"),
        (["x.", ".x", "xx"], "yarns.draft: the weft of row 3 never changes faces, so that nothing holds it"),
    ],
)
def test_loose_yarns_are_refused(draft, message):
    with pytest.raises(InputError) as caught:
        refuse_loose_yarns(draft_matrix(draft))
    assert str(caught.value) == message
    for named in NAMED_DRAFTS.values():
        refuse_loose_yarns(named)
