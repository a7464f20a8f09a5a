"""How fast light is traced through fibers: paths per second of one thread, smooth and rough, by shape."""

from __future__ import annotations

import time

import pytest

from tests.fiber_model.optics.optics_cases import SHAPES, fiber
from weft.fiber_model.optics.cross_sections import build_outline
from weft.fiber_model.optics.light_transport import FiberTracer

pytestmark = pytest.mark.benchmark

PATHS = 100_000


@pytest.mark.parametrize("cross_section", SHAPES)
def test_paths_per_second(cross_section: str) -> None:
    outline = build_outline(SHAPES[cross_section])
    figures = []
    for roughness in (0.0, 0.2):
        tracer = FiberTracer(fiber(cross_section, roughness=roughness), outline)
        seconds = min(_seconds(tracer) for _ in range(4))
        figures.append(f"roughness {roughness}: {PATHS / seconds / 1e6:.2f} M/s")
    print(f"\n{cross_section}, {len(outline)} arcs: {'; '.join(figures)}")


def _seconds(tracer: FiberTracer) -> float:
    """Processor time of this thread for light at 30 degrees."""
    begin = time.thread_time()
    tracer.trace(0.5, 0, 0, PATHS)
    return time.thread_time() - begin
