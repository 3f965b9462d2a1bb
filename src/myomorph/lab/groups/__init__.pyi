# The public names of `mm.groups`: subjects, their strides, and how two groups differ over them.
from ..analysis.cycles import Band as Band
from ..analysis.cycles import Cycles as Cycles
from ..analysis.group_members import member as member
from ..analysis.groups import Animal as Animal
from ..analysis.groups import Comparison as Comparison
from ..analysis.groups import CurveDifference as CurveDifference
from ..analysis.groups import Group as Group
from ..analysis.groups import GroupOptions as GroupOptions
from ..analysis.groups import ScalarDifference as ScalarDifference
from ..analysis.groups import compare_groups as compare_groups
from ..analysis.groups import compare_paired as compare_paired
from ..analysis.travel import Travel as Travel
