"""How much memory this machine has left."""

from __future__ import annotations

from pathlib import Path

CGROUP = Path("/sys/fs/cgroup")


def available_memory_bytes() -> int:
    """What can be had without swapping: /proc/meminfo, and the limit of the control group if there is one."""
    amounts = [_proc_available(), _cgroup_available("memory.max", "memory.current")]
    amounts.append(_cgroup_available("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes"))
    known = [amount for amount in amounts if amount is not None]
    return min(known) if known else 2**62


def _proc_available() -> int | None:
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
    except OSError:
        return None
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable:")), None)


def _cgroup_available(limit_name: str, usage_name: str) -> int | None:
    try:
        limit, usage = (CGROUP / limit_name).read_text().strip(), (CGROUP / usage_name).read_text().strip()
    except OSError:
        return None
    return None if limit == "max" else max(int(limit) - int(usage), 0)
