"""The program and the machine: `weft schema` and `weft doctor`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from .app import app


@app.command
def schema(output: Path | None = None) -> None:
    """Write the JSON Schema of job files, for completion and checks in an editor.

    Parameters
    ----------
    output
        The file to write. Default: standard output.
    """
    import json

    from weft.files.atomic import atomic_write
    from weft.pipeline.config import job_schema

    text = json.dumps(job_schema(), indent=2) + "\n"
    if output is None:
        sys.stdout.write(text)
        return
    with atomic_write(output) as temporary:
        temporary.write_text(text, encoding="utf-8")


@app.command
def doctor(*, json: Annotated[bool, Parameter(negative=())] = False) -> int:
    """Say what this machine offers, what is missing, and what to install.

    Parameters
    ----------
    json
        One JSON object in place of the table.
    """
    from weft.pipeline.doctor import examine

    return examine(as_json=json)
