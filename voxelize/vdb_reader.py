"""The child process of vdb_child.py: what a .vdb file holds, as a line of JSON and arrays in a file.

It loads OpenVDB and little else (no numpy), since `weft render` waits for it.
"""

from __future__ import annotations

import json
import os
import resource
import sys

from .openvdb_library import extension


def main(path: str, arrays: int, memory: int, with_leaves: bool) -> int:
    """Exit code. `arrays` is the file's descriptor; limits are set before anything is read."""
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # the output is for the JSON alone, whatever a library prints
    output = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    try:
        grids = extension().read_grids(path, with_leaves=with_leaves, arrays_file=arrays)
        json.dump(grids, output)
        output.close()
    except Exception as error:
        print(" ".join(str(error).split()) or type(error).__name__, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    code = main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), bool(int(sys.argv[4])))
    sys.stderr.flush()
    os._exit(code)  # nothing is left to tidy up
