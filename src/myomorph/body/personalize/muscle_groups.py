"""Muscles that share a parameter: by what they do, by their EMG, on both sides."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from myomorph.body.personalize.recordings import Windows
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.model import Model
from myomorph.core.model.sides import split_side


def muscle_groups(
    model: Model, windows: Sequence[Windows], rows: Sequence[str]
) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Group muscles by what they do most.

    It is the coordinate and sense of the largest mean moment arm, both sides together.

    Parameters
    ----------
    model : with the muscles
    windows : recordings
    rows : names of the coordinates that are compared

    Returns
    -------
    names, as "knee_angle +", and (muscles,) the group of each muscle
    """
    mean = np.mean(np.concatenate([window.arms[window.counted] for window in windows]), axis=0)
    labels = []
    for m, name in enumerate(model.muscle_names):
        row = int(np.argmax(np.abs(mean[:, m])))
        if not abs(mean[row, m]) > 0.0:
            labels.append(split_side(name)[0])
            continue
        sign = "+" if mean[row, m] > 0.0 else "-"
        labels.append(f"{split_side(rows[row])[0]} {sign}")
    names = tuple(dict.fromkeys(labels))
    return names, np.array([names.index(label) for label in labels], np.int64)


def shared_emg(
    names: Sequence[str], windows: Sequence[Windows]
) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """Let muscles whose EMG is the same all along share a gain.

    Recordings at rest know none.

    Parameters
    ----------
    names : of the muscles
    windows : recordings

    Returns
    -------
    names of the muscles that share each gain, and (muscles,) its number, -1 without EMG
    """
    count = len(names)
    gain = np.full(len(names), -1, np.int64)
    targets = [window.emg.reshape(-1, count) for window in windows if np.isfinite(window.step)]
    columns = enumerate(np.concatenate([np.zeros((0, count)), *targets]).T)
    known = (
        (np.nan_to_num(column, nan=-1.0).tobytes(), m)
        for m, column in columns
        if np.isfinite(column).any()
    )
    members = list(grouped(known).values())
    for number, muscles in enumerate(members):
        gain[muscles] = number
    return tuple(" ".join(names[m] for m in muscles) for muscles in members), gain


def side_pairs(names: Sequence[str]) -> list[tuple[int, int]]:
    """Find the numbers of muscles of the same name on both sides.

    Parameters
    ----------
    names : of the muscles

    Returns
    -------
    two numbers for each pair
    """
    by_name: dict[str, list[int]] = {}
    for m, name in enumerate(names):
        base, side = split_side(name)
        if side:
            by_name.setdefault(base, []).append(m)
    pairs = []
    for members in by_name.values():
        if len(members) == 2:
            first, second = members
            pairs.append((first, second))
    return pairs
