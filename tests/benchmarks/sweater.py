"""In a process of its own: a sweater's fibers made ready for the first voxel; time and memory as JSON."""

from __future__ import annotations

import json
import resource
import sys
import time
import tomllib
from pathlib import Path


def peak_mb() -> float:
    """Largest resident memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000


def main(preset_file: str, side_mm: float) -> None:
    import warp as wp

    from weft.fiber_model.config import FibersConfig
    from weft.fiber_model.fibers import run
    from weft.fiber_model.yarns.fabrics.knit import knit_yarns

    wp.config.quiet = True
    config = FibersConfig(**tomllib.loads(Path(preset_file).read_text(encoding="utf-8")))
    few = knit_yarns((16.0, 16.0), stitch_width_mm=8.0)
    run(config, few).stretch_bounds()  # compiles the kernels where that has not been done on this machine
    yarns = knit_yarns((side_mm, side_mm), stitch_width_mm=8.0)
    before, begin, cpu = peak_mb(), time.perf_counter(), time.process_time()
    fibers = run(config, yarns)
    ran = time.perf_counter() - begin
    fibers.tables()
    fibers.stretch_bounds()
    print(
        json.dumps(
            {
                "meters": fibers.report.yarn_length_mm / 1000,
                "nodes": fibers.report.node_count,
                "hairs": fibers.report.hair_count,
                "run_s": ran,
                "seconds": time.perf_counter() - begin,
                "cpu_seconds": time.process_time() - cpu,
                "loaded_mb": before,
                "peak_mb": peak_mb(),
            }
        )
    )


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
