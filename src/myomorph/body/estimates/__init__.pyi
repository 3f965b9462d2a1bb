# The public names of `mm.estimates`: values that estimates of a body are made of.
from ..calibrate.calibration import LengthEstimate as LengthEstimate
from ..calibrate.calibration import MarkerEstimate as MarkerEstimate
from ..calibrate.calibration import SideEstimate as SideEstimate
from ..calibrate.calibration import ZeroAngle as ZeroAngle
from ..identify.base import BaseFit as BaseFit
from ..identify.determined import Determined as Determined
from ..identify.least_squares import Recording as Recording
from ..identify.recordings import Usable as Usable
from ..identify.tissue_evidence import TissueEvidence as TissueEvidence
from ..identify.transfer import MassMatch as MassMatch
from ..identify.transfer import Transfer as Transfer
from ..identify.validation import Consistency as Consistency
from ..refine.refinement import Errors as Errors
from ..refine.refinement import Prediction as Prediction
from ..refine.refinement import RefinedTrial as RefinedTrial
from ..shape.center_fit import LengthMatch as LengthMatch
from ..shape.points import Links as Links
