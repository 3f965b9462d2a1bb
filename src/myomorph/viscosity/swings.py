"""One recording of a limb that swings freely from a base, as the linear equations of its parameters."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData

PARAMETERS = 10


@dataclass(frozen=True, eq=False)
class SwingRecording:
    """What one trial says of the limb, everything distal of the joint taken as one rigid link.

    With the link's inertial parameters phi (10,) in [D] order, about the joint's center and along the axes
    of its first body (the humerus),

        wrench = wrench_rows @ phi                       (the base is fixed: [S] step 1)
        torque = torque_rows @ phi                       (joint torque by inverse dynamics)
        torque = -d rates - lengthening^T d_M lengthening rates     (passive: [S] eq. 1-3, signs as in ours)

    Attributes
    ----------
    name : of the trial
    time : (frames,) [s]
    wrench_rows : (frames, 6, 10) moment about the joint's center and force, in ground axes
    wrench : (frames, 6) measured on the base, filtered as the motion [N m], [N]
    torque_rows : (frames, axes, 10) moment about the joint's center along the joint's free axes
    rates : (frames, axes) angular velocity of the limb against the base about those axes [rad/s]
    angles : (frames, axes) rotation vector (ball) or angle (hinge) from hanging at rest [rad]
    axes : names of the free axes: "x", "y", "z" of the limb's first body for a ball; one for a hinge
    muscles : names
    lengthening : (frames, strands, axes) d(length)/d(angle), J_M of [S] eq. 3 [m/rad]; a muscle's n strands share
        its viscosity evenly, so the rows of each are divided by the root of n
    strands : the number of the muscle that each row of `lengthening` belongs to; () for one row a muscle
    rotations : (frames, 3, 3) of the limb's first body in ground
    gravity : (3,) in ground [m/s^2]
    swing : (frames,) number of the swing, from release to release or from one turn to the next but one;
        -1 where the limb was touched or something is missing: such frames are not used
    """

    name: str
    time: Array
    wrench_rows: Array
    wrench: Array
    torque_rows: Array
    rates: Array
    angles: Array
    axes: tuple[str, ...]
    muscles: tuple[str, ...]
    lengthening: Array
    rotations: Array
    gravity: Array
    swing: np.ndarray
    strands: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        frames, axes = len(self.time), len(self.axes)
        shapes = {
            "wrench_rows": (frames, 6, PARAMETERS),
            "wrench": (frames, 6),
            "torque_rows": (frames, axes, PARAMETERS),
            "rates": (frames, axes),
            "angles": (frames, axes),
            "lengthening": (frames, len(self.strands or self.muscles), axes),
            "rotations": (frames, 3, 3),
            "swing": (frames,),
        }
        for name, wanted in shapes.items():
            if getattr(self, name).shape != wanted:
                raise BadData(f"swing '{self.name}': {name} has shape {getattr(self, name).shape}, expected {wanted}")
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    def __len__(self) -> int:
        return len(self.time)

    @property
    def used(self) -> np.ndarray:
        """(frames,) whether a frame takes part in identification."""
        return self.swing >= 0

    @property
    def strands_of(self) -> Array:
        """(strands, muscles) 1 where a row of `lengthening` belongs to a muscle."""
        count = len(self.muscles)
        table: Array = np.eye(count)[np.array(self.strands or range(count), np.int64)]
        return table
