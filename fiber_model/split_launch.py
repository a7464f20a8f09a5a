"""A Warp launch on all cores: Warp runs a CPU kernel on the one thread that launches it.

Warp calls a compiled kernel through ctypes, which lets go of Python's lock meanwhile, so several threads can
each launch a part. A kernel for this takes `begin` as its first argument and works on item `begin +
wp.tid()`; it writes to places that depend on the item alone, so no split changes a bit. Kernels must not use
Warp's tiles, whose memory on the CPU is one for all threads.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

PARTS_PER_THREAD = 8
"""Parts of unequal work, taken one after the other, keep all threads busy to the end."""
LEAST_PART = 16
"""Items below which a part is not worth the 50 us that a launch takes."""


def cpu_threads() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def launch_split(
    kernel: Any, count: int, inputs: Sequence[Any], *, device: str = "cpu", threads: int | None = None
) -> None:
    """Run `kernel` on items 0 to `count`, on the CPU with `threads` threads (default: one per core)."""
    import warp as wp

    if count == 0:
        return
    threads = cpu_threads() if threads is None else threads
    if not wp.get_device(device).is_cpu or threads <= 1:
        wp.launch(kernel, count, inputs=[0, *inputs], device=device)
        return
    wp.load_module(kernel.module, device, block_dim=1)  # once, before the threads ask for it
    parts = min(PARTS_PER_THREAD * threads, -(-count // LEAST_PART))
    edges = [count * part // parts for part in range(parts + 1)]

    def launch(part: tuple[int, int]) -> None:
        begin, end = part
        wp.launch(kernel, end - begin, inputs=[begin, *inputs], device=device)

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(launch, pairwise(edges)))
