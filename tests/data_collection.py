"""Where the recordings are: `MYOMORPH_DATA`, or the folder that lies beside the checkout."""

from __future__ import annotations

import os
from pathlib import Path


def data_folder() -> Path:
    """Return the folder of the data collection; it need not exist."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    return Path(os.environ.get("MYOMORPH_DATA", beside))
