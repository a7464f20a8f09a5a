"""Damaged copies of a file: refused in one line or read as valid yarns, in little time and memory."""

import struct
import time
import tracemalloc

import numpy as np

from weft.fiber_model.yarns.yarns import YarnSet
from weft.files.errors import InputError

MUTANTS = 500
MOST_SECONDS = 5.0
MOST_BYTES = 64 << 20
TELLING = [
    struct.pack("<I", 0xFFFFFFFF),
    struct.pack("<I", 0x7FFFFFFF),
    struct.pack("<I", 0),
    struct.pack("<f", np.nan),
    struct.pack("<f", np.inf),
    struct.pack("<f", 1e30),
    b"1e99",
    b" nan",
    b"\n\n\n\n",
    b"-1 9",
]


def mutant(whole, rng):
    """`whole` with up to four bytes changed, a telling value put in, a part cut out, doubled or cut off."""
    data = bytearray(whole)
    for _ in range(rng.integers(0, 5)):
        data[rng.integers(len(data))] = rng.integers(256)
    kind = rng.random()
    at = int(rng.integers(len(data)))
    if kind < 0.4:
        at -= at % 4 if rng.random() < 0.5 else 0
        value = TELLING[rng.integers(len(TELLING))]
        data[at : at + len(value)] = value
    elif kind < 0.5:
        del data[at : at + int(rng.integers(1, 40))]
    elif kind < 0.6:
        data[at:at] = data[at : at + int(rng.integers(1, 40))]
    elif kind < 0.7:
        del data[at:]
    return bytes(data)


def read_mutants(read, whole, path, *, count=MUTANTS, kind=YarnSet):
    """Read `count` mutants of the file's bytes through `read(path)`; how many were refused, and read."""
    rng = np.random.default_rng(17)
    refused, good, lines, worst = 0, 0, 0, 0.0
    tracemalloc.start()
    try:
        for _ in range(count):
            path.write_bytes(mutant(whole, rng))
            begin = time.perf_counter()
            try:
                assert isinstance(read(path), kind)
                good += 1
            except InputError as error:
                lines = max(lines, str(error).count("\n") + 1)
                refused += 1
            worst = max(worst, time.perf_counter() - begin)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert lines == 1
    assert worst < MOST_SECONDS
    assert peak < MOST_BYTES
    assert refused > count // 10  # the mutants are no copies of the file
    return refused, good
