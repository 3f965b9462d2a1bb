# The public names of `mm.contact`: where bodies may touch, when they do, contact activations.
from .found_supports import find_supports as find_supports
from .site_motion import Floor as Floor
from .site_motion import rest_on_floor as rest_on_floor
from .sites import FootOptions as FootOptions
from .sites import body_sites as body_sites
from .sites import foot_sites as foot_sites
from .states import ActivationOptions as ActivationOptions
from .states import ContactStateOptions as ContactStateOptions
from .states import contact_activations as contact_activations
from .states import preferred_directions as preferred_directions
from .supports import Support as Support
from .supports import Supports as Supports
