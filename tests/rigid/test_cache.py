"""Kernels of another version are deleted once, those of this version stay."""

from __future__ import annotations

from myomorph import __version__
from myomorph.rigid.cache import STAMP, forget_other_versions


def test_kernels_of_another_version_are_forgotten(tmp_path):
    folder = tmp_path / "rigid" / "__pycache__"
    folder.mkdir(parents=True)
    for name in ("kinematics.body_poses-1.nbi", "kinematics.body_poses-1.1.nbc", "kinematics.cpython-311.pyc"):
        (folder / name).write_text("compiled")
    assert forget_other_versions(tmp_path) == 2
    assert [path.name for path in folder.iterdir()] == ["kinematics.cpython-311.pyc"]
    assert (tmp_path / "__pycache__" / STAMP).read_text() == __version__
    (folder / "kinematics.body_poses-2.nbi").write_text("compiled")
    assert forget_other_versions(tmp_path) == 0
    (tmp_path / "__pycache__" / STAMP).write_text("0.0.1")
    assert forget_other_versions(tmp_path) == 1
