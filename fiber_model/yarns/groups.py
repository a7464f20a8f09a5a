"""Consecutive yarns of a set, a few at a time: temporaries then take the memory of one group."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from .yarns import YarnSet

GROUP_POINTS = 1 << 17
"""Control points of a group, unless one yarn has more: temporaries of some 30 MB."""


def yarn_groups(sizes: np.ndarray, most: int = GROUP_POINTS) -> Iterator[range]:
    """Consecutive yarns whose `sizes`, shape [yarn_count], sum to about `most`; at least one yarn each."""
    begin, total = 0, 0
    for yarn, size in enumerate(sizes.tolist()):
        if total and total + size > most:
            yield range(begin, yarn)
            begin, total = yarn, 0
        total += size
    yield range(begin, len(sizes))


def yarns_of(yarns: YarnSet, group: range) -> YarnSet:
    """The yarns of a group, with all that later stages read of them but rows and (u, v)."""
    first, last = yarns.offsets[group.start], yarns.offsets[group.stop]
    own = slice(group.start, group.stop)
    return replace(
        yarns,
        points=yarns.points[first:last],
        offsets=yarns.offsets[group.start : group.stop + 1] - first,
        closed=yarns.closed[own],
        radius=yarns.radius[own],
        yarn_type=yarns.yarn_type[own],
        twist=None if yarns.twist is None else yarns.twist[first:last],
        surface_uv=None,
        row=None,
        report=None,
    )
