"""Damaged copies of a measurement file: refused in one line or read as valid, in little time and memory."""

import time
import tracemalloc

import numpy as np

from tests.fiber_model.yarns.formats.mutants import mutant
from weft.files.errors import InputError

MUTANTS = 500
MOST_SECONDS = 5.0


def read_damaged(read, whole, path, *, most_bytes, count=MUTANTS, damage=mutant):
    """Read `count` mutants of `whole` through `read(path)`; how many were refused, and read."""
    rng = np.random.default_rng(29)
    lines: list[str] = []
    good, worst = 0, 0.0
    tracemalloc.start()
    try:
        for _ in range(count):
            path.write_bytes(damage(whole, rng))
            tracemalloc.reset_peak()
            before = tracemalloc.get_traced_memory()[0]
            begin = time.perf_counter()
            try:
                read(path)
                good += 1
            except InputError as error:
                lines.append(str(error))
            worst = max(worst, time.perf_counter() - begin)
            assert tracemalloc.get_traced_memory()[1] - before < most_bytes
    finally:
        tracemalloc.stop()
    assert worst < MOST_SECONDS
    assert all(line.startswith(f"{path}:") and "\n" not in line for line in lines)
    assert len(lines) > count // 10  # the mutants are no copies of the file
    return len(lines), good


def damaged_binary(header_bytes):
    """Damage for large files of numbers: in the header, a number not finite, a byte, or cut or lengthened."""

    def damage(whole, rng):
        kind = rng.integers(6)
        if kind == 0:
            return mutant(whole[:header_bytes], rng) + whole[header_bytes:] if header_bytes else whole[1:]
        if kind == 1:
            return whole[: rng.integers(len(whole))]
        if kind == 2:
            return whole + whole[: rng.integers(1, 100)]
        data = bytearray(whole)
        at = header_bytes + 8 * int(rng.integers((len(whole) - header_bytes) // 8))
        if kind == 3:
            data[at : at + 8] = np.array([np.nan, np.inf, -np.inf])[rng.integers(3)].tobytes()
        elif kind == 4:
            data[at : at + 8] = np.array([-1.0, 1e300, 0.0])[rng.integers(3)].tobytes()
        else:
            data[at + int(rng.integers(8))] ^= 1 << int(rng.integers(8))
        return bytes(data)

    return damage
