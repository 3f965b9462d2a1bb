# The public names of `mm.session`: people and trials of a session, and how they are known.
from ...core.model.known import Known as Known
from .body_measures import BodyMeasures as BodyMeasures
from .body_measures import Measured as Measured
from .read import read_session as read_session
from .session import Person as Person
from .session import RecordedClock as RecordedClock
from .session import Session as Session
from .session import SessionTrial as SessionTrial
