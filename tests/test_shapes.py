"""Axes that have one name have one length: signatures say it, calls are checked."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.rigid.dynamics import joint_wrenches
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from trees import random_tree

jaxtyping = pytest.importorskip("jaxtyping", reason="needs the extra 'test'")
pytest.importorskip("beartype", reason="needs the extra 'test'")


@pytest.fixture
def tree():
    return compile_tree(random_tree(4))


def test_right_shapes_pass(tree):
    c = np.zeros((2, len(tree.model.coordinates)))
    assert forward_kinematics(tree, c).origins.shape[0] == 2


def test_a_frame_alone_is_no_motion(tree):
    with pytest.raises(jaxtyping.TypeCheckError, match="frames coordinates"):
        forward_kinematics(tree, tree.defaults)


def test_arguments_share_their_axes(tree):
    c = np.zeros((2, len(tree.model.coordinates)))
    loads = np.zeros((3, len(tree.arrays.parent), 6))
    with pytest.raises(jaxtyping.TypeCheckError, match="frames bodies 6"):
        joint_wrenches(tree, c, c, c, loads)


def test_methods_are_checked_too(tree):
    poses = forward_kinematics(tree, tree.defaults[None])
    with pytest.raises(jaxtyping.TypeCheckError, match="points 3"):
        poses.points(np.zeros(2, np.int64), np.zeros((2, 2)))


def test_kernels_stay_as_they_are(tree):
    from myomorph.core.rigid import coordinates

    assert hasattr(coordinates.couple_frames, "py_func")
