"""Stitch charts: marks, repeats, cables, and messages for charts that cannot be knit."""

import numpy as np
import pytest

from weft.fiber_model.yarns.config import ChartName
from weft.fiber_model.yarns.fabrics.stitch_chart import NAMED_CHARTS, Crossing, read_chart
from weft.files.errors import InputError


def test_top_row_is_knit_last():
    chart = read_chart(["k p3", "p4"])
    assert chart.knit.tolist() == [[False] * 4, [True, False, False, False]]


def test_cables_span_their_stitches():
    chart = read_chart(["p c4f k", "p K2 c2b k"])
    assert chart.crossings == (
        Crossing(course=0, first=3, half=1, left_leaning=False),
        Crossing(course=1, first=1, half=2, left_leaning=True),
    )
    assert chart.knit[1].tolist() == [False, True, True, True, True, True]


def test_named_charts_are_what_knitters_call_so():
    assert set(NAMED_CHARTS) == set(ChartName.__args__)
    knit = {name: read_chart(name).knit for name in NAMED_CHARTS}
    assert knit["stockinette"].all()
    assert not knit["reverse_stockinette"].any()
    assert knit["garter"].tolist() == [[True], [False]]
    assert knit["rib_1_1"].tolist() == [[True, False]]
    assert knit["rib_2_2"].tolist() == [[True, True, False, False]]
    seed = knit["seed"]
    assert (seed != np.roll(seed, 1, axis=0)).all()
    assert (seed != np.roll(seed, 1, axis=1)).all()


def test_small_charts_can_be_repeated():
    chart = read_chart(["p c2f"]).at_least(2)
    assert chart.knit.shape == (2, 3)
    assert [crossing.course for crossing in chart.crossings] == [0, 1]


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["k x"], "found 'x' in 'k x'; known are k, p, k3, p3, c2f to c8f, and c2b to c8b"),
        (["c3f"], "found 'c3f' in 'c3f'; known are k, p, k3, p3, c2f to c8f, and c2b to c8b"),
        (["k2", "k3"], "its rows span 2, 3 wales; all must span the same"),
        ([], "its rows span no wales; all must span the same"),
        ([" "], "it has 0 stitches; need 1 to 1,024"),
        (["k33"] * 32, "it has 1,056 stitches; need 1 to 1,024"),
    ],
)
def test_charts_that_cannot_be_knit_are_refused(rows, message):
    with pytest.raises(InputError) as caught:
        read_chart(rows)
    assert str(caught.value) == f"yarns.chart: the stitch chart cannot be knit: {message}"
