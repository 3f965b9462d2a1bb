"""MuJoCo without its warnings."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def silent_mujoco() -> Iterator[None]:
    """For compiling packaged models: MuJoCo prints its warnings and writes them into a file in the user's folder."""
    import mujoco

    mujoco.set_mju_user_warning(lambda text: None)
    level = logging.root.manager.disable
    logging.disable(logging.WARNING)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(level)
        mujoco.set_mju_user_warning(None)
