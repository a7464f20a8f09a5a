"""What can go wrong on the user's side, as one clear line and an exit code."""

from __future__ import annotations

from pathlib import Path


class InputError(Exception):
    """The user's input is wrong: where, what was found, and what to do. Exit code 2.

    `place` is a line number, a byte offset ("byte 64") or a config key; it follows the path in the message.
    """

    exit_code = 2

    def __init__(
        self, what: str, *, path: str | Path | None = None, place: str | int = "", hint: str = ""
    ) -> None:
        self.what = what
        self.path = None if path is None else Path(path)
        self.place = place
        self.hint = hint
        where = ":".join(str(part) for part in (path, place) if part not in (None, ""))
        message = f"{where}: {what}" if where else what
        if hint:
            message += f"{'' if message.endswith(('.', '?', '!')) else '.'} {hint}"
        super().__init__(message)


class MergeError(InputError):
    """Samples that do not belong together, or not all of them, or damaged ones. Exit code 3."""

    exit_code = 3


class DeviceMemoryError(InputError):
    """The job needs more memory than the device has. Exit code 4 where a device said so."""

    exit_code = 4


class DiskSpaceError(InputError):
    """No space left for the result; what was there before is untouched. Exit code 5."""

    exit_code = 5
