"""FIGAROH's base parameters of a floating tree, from its own regressor and decomposition."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from floating import PINOCCHIO_ORDER, pinocchio_states
from trees import to_pinocchio


def figaroh_combination(model, motion):
    """Return the (n, 10 bodies) matrix M with phi_B = M phi that FIGAROH finds on a motion.

    Parameters are in our order.
    """
    from figaroh.tools.qrdecomposition import QRDecomposer
    from figaroh.tools.regressor import (
        RegressorBuilder,
        RegressorConfig,
        build_regressor_reduced,
        get_index_eliminate,
    )

    theirs, _ = to_pinocchio(model)
    robot = SimpleNamespace(model=theirs, data=theirs.createData())
    config = RegressorConfig(
        is_joint_torques=False,
        is_external_wrench=True,
        force_torque=["Fx", "Fy", "Fz", "Mx", "My", "Mz"],
    )
    q, v, a = map(np.array, zip(*pinocchio_states(model, motion), strict=True))
    W = RegressorBuilder(robot, config).build_basic_regressor(q, v, a)
    size = W.shape[1]
    names = {f"{body}_{k}": 0.0 for body in range(size // 10) for k in range(10)}
    silent, kept = get_index_eliminate(W, names)
    result = QRDecomposer(relative_tolerance=1e-9).decompose(
        build_regressor_reduced(W, silent), kept
    )
    order = np.concatenate([10 * b + PINOCCHIO_ORDER for b in range(size // 10)])
    combination = np.zeros((result.rank, size))
    combination[:, order[np.setdiff1d(np.arange(size), silent)]] = result.M
    return combination
