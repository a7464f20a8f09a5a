"""What a misspelled name may have meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def did_you_mean(found: str, known: Iterable[str], *, list_known: int = 12) -> str:
    """`; did you mean 'x'?`, or the names there are where none is close and they are few."""
    known = sorted(known)
    close = difflib.get_close_matches(found, known, n=1, cutoff=0.6)
    if close:
        return f"; did you mean '{close[0]}'?"
    return f"; there is: {', '.join(known)}" if 0 < len(known) <= list_known else ""
