"""The model as flat arrays and the kernels over frames. Knows neither muscles nor markers."""

from pathlib import Path

from myomorph.rigid.cache import forget_other_versions, save_in_turns

save_in_turns()
forget_other_versions(Path(__file__).resolve().parents[1])
