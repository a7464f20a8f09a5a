"""The command line: what an argument list does, and errors to one line and an exit code.

The commands themselves live in commands/, a file per group. Heavy packages are imported by the command that
needs them, never at the top of a file.
"""

from __future__ import annotations

import errno
import gc
import math
import os
import signal
import sys
from collections.abc import Callable, Sequence
from typing import Any

from weft.files.errors import DeviceMemoryError, DiskSpaceError, InputError

from .commands.plain import plain_stage
from .stop_requests import Terminated, raise_for

DONE, WRONG_INPUT, NO_SPACE, INTERRUPTED, TERMINATED = 0, 2, DiskSpaceError.exit_code, 130, 143

WATCHED = (["run"], ["render"])
"""Commands whose device may hang (watchdog.py)."""


RARELY = 10_000
"""How many new objects call Python's collector. At its own 700 it takes 5 % of a start."""


class WrongCommandLine(Exception):
    """What cyclopts says of a command line that it does not understand."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a command and exit: 0 done, 2 input, 3 merge refused, 4 device, 5 disk, 130/143 interrupted."""
    gc.set_threshold(RARELY)
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given[:1] in WATCHED and hasattr(os, "fork"):
        from .watchdog import watched

        sys.exit(watched(given, _at_work))
    sys.exit(_at_work(given))


def _at_work(arguments: Sequence[str]) -> int:
    # else pydantic looks through all that is installed for plugins, and would run them
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    if arguments[:1] == ["render"]:
        from weft.renderer.gpu.driver_ahead import load_driver_ahead

        load_driver_ahead()
    return exit_code(arguments)


def exit_code(arguments: Sequence[str]) -> int:
    """The user's mistakes become one line on standard error; ours stay tracebacks."""
    previous = signal.signal(signal.SIGTERM, raise_for)
    try:
        return _command(arguments)() or DONE
    except InputError as error:
        from .messages import shown_paths

        return _complain(shown_paths(error), error.exit_code)
    except WrongCommandLine as error:
        return _complain(f"weft: {error} 'weft --help' lists the commands.", WRONG_INPUT)
    except KeyboardInterrupt as stop:
        return _complain(str(stop) or "weft: interrupted", INTERRUPTED)
    except Terminated as stop:
        return _complain(str(stop) or "weft: terminated", TERMINATED)
    except MemoryError as error:
        return _complain(_lack_of_memory(error), DeviceMemoryError.exit_code)
    except BrokenPipeError:
        sys.stderr.close()
        return DONE
    except OSError as error:
        if error.errno != errno.ENOSPC:
            raise
        return _complain(f"{error.filename or 'weft'}: no space left on the disk", NO_SPACE)
    finally:
        signal.signal(signal.SIGTERM, previous)


def _command(arguments: Sequence[str]) -> Callable[[], Any]:
    plain = plain_stage(arguments)
    if plain is not None:
        return plain
    from cyclopts import CycloptsError

    from .commands import lobes, looking, machine, shares, stages, view  # noqa: F401  each adds its commands
    from .commands.app import app

    try:
        command, bound, _ = app.parse_args(list(arguments), exit_on_error=False, print_error=False)
    except CycloptsError as error:
        raise WrongCommandLine(str(error)) from error
    return lambda: command(*bound.args, **bound.kwargs)


def _lack_of_memory(error: MemoryError) -> str:
    """Of the machine: what numpy wished for, and what there is."""
    from weft.files.machine_memory import available_memory_bytes

    shape, dtype = getattr(error, "shape", None), getattr(error, "dtype", None)
    needed = "more memory than this machine has"
    if shape is not None and dtype is not None:
        needed = f"{math.prod(shape) * dtype.itemsize} bytes more of memory"
    return (
        f"weft: this needs {needed}; {available_memory_bytes()} bytes are available. "
        "Raise voxelize.voxel_size_mm, set render.brick_pool_mb, or ask for fewer pixels."
    )


def _complain(message: str, code: int) -> int:
    print(message, file=sys.stderr)
    return code


if __name__ == "__main__":
    main()
