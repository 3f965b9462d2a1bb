"""Folder of what can be made anew: machine code of kernels, composed models."""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]


def kernel_folder() -> Path:
    """Folder of the kernels of this version and copy of the package; it need not exist."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    root = Path(chosen) if chosen else _user_folder()
    copy = hashlib.sha256(os.fsencode(PACKAGE)).hexdigest()[:8]
    return root / f"myomorph-{package_version()}-{copy}"


def package_version() -> str:
    """Version of the package, which is imported: its face names all rooms, this one too."""
    return str(sys.modules[__name__.partition(".")[0]].__version__)


def _user_folder() -> Path:
    """Folder in which the operating system has programs keep what they can make anew."""
    home = Path.home()
    if sys.platform == "win32":
        local = os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local"
        return Path(local) / "myomorph" / "Cache"
    if sys.platform == "darwin":
        return home / "Library" / "Caches" / "myomorph"
    return Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache") / "myomorph"
