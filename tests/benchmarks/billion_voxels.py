"""A billion voxels of active bricks, end to end: a knit square to a .vdb file; memory and seconds as JSON.

    python tests/benchmarks/billion_voxels.py FOLDER [SIDE_MM]

FOLDER needs 12 GB for a while. The square of 282 mm is made of 40 km of cotton2 fiber in voxels of 0.05 mm.
"""

from __future__ import annotations

import json
import resource
import sys
import time
import tomllib
from pathlib import Path


def main(folder: Path, side_mm: float) -> None:
    from weft.fiber_model.config import FibersConfig
    from weft.fiber_model.fibers import run
    from weft.fiber_model.yarns.fabrics.knit import knit_yarns
    from weft.voxelize.config import VoxelizeConfig
    from weft.voxelize.stream import voxelize_to_files

    preset = Path(__file__).parents[2] / "configs" / "presets" / "fibers" / "cotton2.toml"
    began = time.perf_counter()
    fibers = run(
        FibersConfig(**tomllib.loads(preset.read_text(encoding="utf-8"))),
        knit_yarns((side_mm, side_mm), stitch_width_mm=2.0),
    )
    path = folder / "billion.vdb"
    made = voxelize_to_files(VoxelizeConfig(voxel_size_mm=0.05, memory_mb=4000), fibers, [path])
    own, report = resource.getrusage(resource.RUSAGE_SELF), made.report
    print(
        json.dumps(
            {
                "voxels_of_bricks": made.brick_count * 512,
                "voxels_with_fiber": report.voxel_count,
                "fiber_km": report.generated_length_mm / 1e6,
                "segments": int((fibers.stretch_point_counts() - fibers.stretch_strand_counts()).sum()),
                "length_off": report.relative_difference,
                "vdb_bytes": path.stat().st_size,
                "peak_mib": own.ru_maxrss / 1024,
                "seconds": time.perf_counter() - began,
                "cpu_seconds": own.ru_utime + own.ru_stime,
                "content_sha256": made.content_sha256,
            },
            indent=1,
        )
    )
    path.unlink()


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else 282.0)
