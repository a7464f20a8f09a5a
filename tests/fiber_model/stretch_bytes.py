"""In a process of its own: the bits of named stretches. Run as a script by test_processes.py.

python stretch_bytes.py JOB.json OUT.npz: JOB names yarns (.npz), the fiber settings and the stretches.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import warp as wp

from weft.fiber_model.config import FibersConfig
from weft.fiber_model.fiber_curves import strand_points
from weft.fiber_model.fibers import run
from weft.fiber_model.yarns.yarn_file import load_yarns


def main(job_file: str, out: str) -> None:
    wp.config.quiet = True
    job = json.loads(Path(job_file).read_text(encoding="utf-8"))
    fibers = run(FibersConfig(**job["config"]), load_yarns(Path(job["yarns"])))
    stretches = np.array(job["stretches"], dtype=np.int64)
    made = strand_points(fibers, stretches, threads=job["threads"])
    np.savez(out, points=made.points.view(np.uint32), kind=made.kind, offsets=made.offsets)


if __name__ == "__main__":
    main(*sys.argv[1:])
