# The public names of `mm.viscosity`: studies of swinging limbs, and their results.
from .study.plan import SpecimenFiles as SpecimenFiles
from .study.plan import ViscosityPlan as ViscosityPlan
from .study.plan import read_viscosity_plan as read_viscosity_plan
from .study.run import run_viscosity as run_viscosity
from .study.specimen_step import read_estimates as read_estimates
