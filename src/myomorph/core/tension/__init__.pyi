# The public names of `mm.tension`: terms of the tension problem, and parts of its results.
from ...body.personalize.estimates import MuscleEstimate as MuscleEstimate
from ...body.personalize.generic_map import GenericMap as GenericMap
from ...body.personalize.held_out import HeldOut as HeldOut
from .recruitment import RecruitmentOptions as RecruitmentOptions
from .tension import Certificate as Certificate
from .tension import Fibers as Fibers
from .terms.contacts import ContactOptions as ContactOptions
from .terms.contacts import ContactTask as ContactTask
from .terms.emg import EmgTarget as EmgTarget
from .terms.term import Columns as Columns
from .terms.term import Frames as Frames
from .terms.term import Penalties as Penalties
from .terms.term import Rows as Rows
from .terms.term import Smoothing as Smoothing
from .terms.term import Term as Term
from .terms.term import Unknowns as Unknowns
from .terms.term import Variables as Variables
