# The public names of `mm.uncertainty`: sources of error, drawn inputs, results of draws.
from ...core.model.quantity import Quantity as Quantity
from ...core.motion.unseen import AssumedMode as AssumedMode
from .bodies import Draw as Draw
from .bodies import drawn_subject as drawn_subject
from .drawn_inputs import drawn_angles as drawn_angles
from .drawn_inputs import drawn_emg as drawn_emg
from .drawn_inputs import drawn_markers as drawn_markers
from .drawn_inputs import drawn_wrenches as drawn_wrenches
from .intervals import uncertainty_of as uncertainty_of
from .normals import Normals as Normals
from .sources import ErrorSizes as ErrorSizes
from .sources import ItemSize as ItemSize
from .sources import Sources as Sources
from .sources import SourceSize as SourceSize
from .spread import Shares as Shares
from .spread import Spread as Spread
from .spread import Uncertainty as Uncertainty
