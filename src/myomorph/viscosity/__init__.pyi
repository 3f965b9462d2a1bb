# The public names of `mm.viscosity`: recordings of swinging limbs, what they show, and studies of them.
from .identification.base_load import BaseLoad as BaseLoad
from .identification.identify import Condition as Condition
from .identification.identify import MuscleViscosity as MuscleViscosity
from .identification.identify import SpecimenViscosity as SpecimenViscosity
from .identification.identify import ViscosityOptions as ViscosityOptions
from .identification.identify import identify_specimen as identify_specimen
from .study.calibration import PlateFiles as PlateFiles
from .study.calibration import ScanFiles as ScanFiles
from .study.plan import SpecimenFiles as SpecimenFiles
from .study.plan import SwingFiles as SwingFiles
from .study.plan import ViscosityPlan as ViscosityPlan
from .study.plan import read_viscosity_plan as read_viscosity_plan
from .study.run import run_viscosity as run_viscosity
from .study.specimen import read_swings as read_swings
from .study.specimen_step import read_estimates as read_estimates
from .swings.recording import SwingRecording as SwingRecording
