"""Compiled functions kept between runs, so that only the first fit of a kind waits for the compiler."""

from __future__ import annotations

import os
from pathlib import Path


def cache_folder() -> Path:
    """weft/jax in the user's cache folder (XDG Base Directory Specification)."""
    base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if Path(base).is_absolute() else Path.home() / ".cache") / "weft" / "jax"


def keep_compiled_functions() -> None:
    """From now on in this process, unless the user's JAX settings name a folder already."""
    import jax

    if getattr(jax.config, "jax_compilation_cache_dir", None) is not None:
        return
    folder = cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return  # a fit works without; it only starts later
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
