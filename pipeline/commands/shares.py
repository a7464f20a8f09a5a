"""`weft merge`: shares of a picture that machines rendered apart."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from .app import app


@app.command
def merge(
    shares: list[Path],
    /,
    *,
    out: Annotated[Path, Parameter(name=("--out", "-o"))],
    partial: Annotated[bool, Parameter(negative=())] = False,
) -> None:
    """Join shares or checkpoints of one picture, in any order, to the bits that one run would have made.

    Parameters
    ----------
    shares
        Files that `weft render --blocks … --tiles …` wrote.
    out
        The .exr to write, and a .png beside it.
    partial
        Write the picture also where samples are missing.
    """
    from weft.pipeline.shares import merge_files

    print(merge_files(shares, out, partial=partial))
