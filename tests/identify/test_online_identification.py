from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from myomorph.body.identify.base import BaseOptions, fit_base
from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.recordings import NO_FORCE, NO_MOTION
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches
from myomorph.lab.study.inputs.external_forces import read_loads
from myomorph.lab.study.inputs.reading import open_model, read_motion
from myomorph.live.online_identification import OnlineIdentification, OnlineOptions, total_wrench


@pytest.fixture(scope="module")
def walk(data: Callable[[str], Path]) -> tuple[Model, Motion, Wrenches]:
    folder = data("opensim-gait-subject01")
    model = open_model(folder / "ref_id/subject01.osim")
    motion = read_motion(folder / "ref_id/subject01_walk1_ik.mot", model)
    return model, motion, read_loads(folder / "ref_id/subject01_walk1_grf.xml", model, motion)


def play(
    walk: tuple[Model, Motion, Wrenches], options: OnlineOptions, frames: int = 120
) -> OnlineIdentification:
    """Frames and forces in the order of their times, as a laboratory would send them."""
    model, motion, wrenches = walk
    online = OnlineIdentification(
        model, motion.rate, 1.0 / np.diff(wrenches.time).mean(), options=options
    )
    total = total_wrench(wrenches.forces, wrenches.points, wrenches.torques)
    columns = [motion.names.index(name) for name in model.coordinate_names]
    sample = int(np.searchsorted(wrenches.time, motion.time[0] - 0.5))
    for i in range(frames):
        while sample < len(total) and wrenches.time[sample] <= motion.time[i] + 1e-9:
            online.push_force(wrenches.time[sample], total[sample])
            sample += 1
        online.push_motion(motion.time[i], motion.values[i, columns])
    online.finish()
    return online


def _filtered_forces(
    online: OnlineIdentification, wrenches: Wrenches, time: np.ndarray, body: str
) -> Wrenches:
    """Return the total wrench on a body at some times, filtered as the stream's.

    Parameters
    ----------
    online : with the filter of the forces
    wrenches : of all plates
    time : (frames,) [s]
    body : name

    Returns
    -------
    one wrench about the ground's origin
    """
    total = online.force_filter.values(
        total_wrench(wrenches.forces, wrenches.points, wrenches.torques)
    )
    half = online.force_filter.half
    clock = wrenches.time[half:-half]
    at = np.stack([np.interp(time, clock, column) for column in total.T], axis=1)
    return Wrenches(
        time=time,
        names=("all",),
        bodies=(body,),
        forces=at[:, None, 3:],
        points=np.zeros((len(at), 1, 3)),
        torques=at[:, None, :3],
    )


def test_frame_by_frame_is_the_batch(walk: tuple[Model, Motion, Wrenches]) -> None:
    """The stream ends where the batch does, with the same filter, frames and noise: to 1e-8."""
    model, motion, wrenches = walk
    online = play(walk, OnlineOptions(cutoff=6.0, missing=1e9))
    part = Motion(motion.time[:120], motion.names, motion.values[:120])
    filtered = online.filter.motion(part)
    forces = _filtered_forces(online, wrenches, filtered.time, model.body_names[0])
    use = np.isin(np.round(filtered.time, 6), np.round(online.used, 6))
    assert use.sum() == len(online.used) > 70
    options = BaseOptions(
        correlated=False,
        moment_noise=float(online.sigma[0]),
        force_noise=float(online.sigma[3]),
        motion_sd=0.0,
    )
    batch = fit_base(
        model,
        [Recording(filtered, forces, use)],
        online.base,
        options,
    )
    state = online.state()
    size = np.maximum(np.abs(batch.estimate), batch.size)
    np.testing.assert_allclose(state.fit.estimate / size, batch.estimate / size, atol=1e-8)
    np.testing.assert_allclose(state.fit.sd, batch.sd, rtol=1e-6)
    assert state.fit.frames == batch.frames


def test_what_is_missing_is_left_out_and_counted(walk: tuple[Model, Motion, Wrenches]) -> None:
    model, motion, wrenches = walk
    values = np.array(motion.values)
    forces = np.array(wrenches.forces)
    values[60] = np.nan
    hole = int(np.searchsorted(wrenches.time, motion.time[100]))
    forces[hole] = np.nan
    broken = Motion(motion.time, motion.names, values)
    holed = Wrenches(
        time=wrenches.time,
        names=wrenches.names,
        bodies=wrenches.bodies,
        forces=forces,
        points=wrenches.points,
        torques=wrenches.torques,
    )
    options = OnlineOptions(missing=1e9)
    whole = play(walk, options, 160)
    part = play((model, broken, holed), options, 160)
    window = 2 * part.filter.half + 1
    assert part.left_out[NO_MOTION] == window
    lost = part.left_out[NO_FORCE] - whole.left_out[NO_FORCE]
    assert lost == pytest.approx(2 * part.force_filter.delay * motion.rate, abs=2)
    assert len(whole.used) - len(part.used) == window + lost
    state = part.state()
    assert state.frames == 160
    assert set(state.left_out) <= {NO_MOTION, NO_FORCE}


def test_every_link_gets_better_while_the_body_moves(walk: tuple[Model, Motion, Wrenches]) -> None:
    """With a filter and no forgetting, nothing known is lost, and the pose is the newest."""
    model, motion, _ = walk
    early = play(walk, OnlineOptions(missing=1e9), 60).state()
    late = play(walk, OnlineOptions(missing=1e9), 150).state()
    assert (late.fit.levels >= early.fit.levels - 1e-9).all()
    assert late.levels.mean() > early.levels.mean()
    assert late.proposals[0].coordinate in model.coordinate_names
    column = motion.names.index("knee_angle_r")
    assert late.pose[model.coordinate_names.index("knee_angle_r")] == motion.values[149, column]


def test_the_total_of_wrenches() -> None:
    forces = np.array([[0.0, 10.0, 0.0], [0.0, 0.0, 0.0]])
    points = np.array([[2.0, 0.0, 0.0], [np.nan, np.nan, np.nan]])
    torques = np.array([[0.0, 0.5, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(
        total_wrench(forces, points, torques), [0.0, 0.5, 20.0, 0.0, 10.0, 0.0]
    )
    forces[1] = [0.0, 30.0, 0.0]
    assert np.isnan(total_wrench(forces, points, torques)[:3]).any()
    with pytest.raises(BadData, match="expected wrenches"):
        total_wrench(forces, points[:1], torques)
