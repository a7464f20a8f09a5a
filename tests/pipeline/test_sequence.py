"""A range of frames is one run of the job for each, into a folder of its own."""

import numpy as np

from tests.fiber_model.yarns.formats.test_read_file import WALK
from weft.fiber_model.yarns.formats.bcc import write_bcc
from weft.fiber_model.yarns.yarn_file import load_yarns
from weft.fiber_model.yarns.yarns import YarnSet
from weft.pipeline.config import load
from weft.pipeline.progress import reporter
from weft.pipeline.run import run_chain
from weft.pipeline.stages import CHAIN

JOB = """[yarns]
kind = "file"
file = "frame_%04d.bcc"
frame = 1
scale_to_mm = 1.0
radius_mm = 0.5
"""


def test_each_frame_of_a_range_has_its_own_results(tmp_path):
    (tmp_path / "job.toml").write_text(JOB)
    for frame in (1, 2, 3):
        write_bcc(YarnSet.checked([WALK * frame], radius=1.0), tmp_path / f"frame_{frame:04d}.bcc")
    for frame in (1, 2, 3):
        folder = tmp_path / "frames" / str(frame)
        job = load(tmp_path / "job.toml", [f"yarns.frame={frame}"], folder)
        run_chain(job, CHAIN, ["yarns"], report=reporter("plain"))
        points = load_yarns(folder / "yarns.npz").points
        assert np.array_equal(points, (WALK * frame).astype(np.float32))
