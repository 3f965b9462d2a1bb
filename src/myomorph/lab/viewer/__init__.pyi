# The public names of `mm.viewer`: movies, and poses of bones and paths of muscles to draw oneself.
from ...core.muscles.muscle_paths import MusclePaths as MusclePaths
from ...core.muscles.muscle_paths import muscle_paths as muscle_paths
from ...core.rigid.bone_poses import BonePoses as BonePoses
from ...core.rigid.bone_poses import bone_poses as bone_poses
from ..study.trial.movie_of_results import write_movie as write_movie
from .movie import MovieClock as MovieClock
from .movie import MovieOptions as MovieOptions
