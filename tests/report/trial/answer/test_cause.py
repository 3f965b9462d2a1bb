"""Messages by their cause: none is lost, none stands alone that has fellows."""

from __future__ import annotations

from myomorph.lab.report.trial.answer.cause import GRAVITIES, OTHER, grouped
from myomorph.lab.report.trial.answer.causes import CONTACTS, FEET_BESIDE, KINDS

MESSAGES = (
    "1.07 to 1.11 s, worst at 1.09 s: sites that touch cannot carry the motion, 731 N sideways are"
    " needed beside them: 622 N at 'root' from nowhere would do",
    "2.77 to 2.78 s, worst at 2.78 s: no site may touch, but 198 N upward are needed: contact of"
    " 'foot_r' (0 mm above its support) would do",
    "the load on 'calcn_l' is not determined in 40 % of the time (from 1.09 to 1.17 s, from 2.51 to"
    " 3.02 s): it stands where no plate carries it: torques of its joints are wrong there",
    "the plates carry 59.9 kg where all standing feet are on them, the model weighs 72.6 kg (+21"
    " %): scale the model to the subject's mass, or check the calibration of the plates",
    "walking2.c3d: plate_1 reads 13.7 N with nobody on it: was it set to zero?",
    "double the automatic cutoff changes the largest joint torque by +157 %: see --cutoff",
    "in 83 of 812 frames no marker shows 'ankle_angle_r', first from 1.07 to 1.38 s: values there"
    " are guesses near the default",
    "212 of 1249 frames show too few markers to determine where the body is (as few as 1 of 40,"
    " first at 0.82 s): left empty",
    "EMG of Voltage.L Quad takes no part: the name contains no muscle of the model; name them",
    "EMG and torques contradict each other: recfem_r 0.10 where EMG says 0.52 at 1.82 s; see"
    " emg_conflicts.csv",
)
"""Of real recordings, as steps wrote them."""


def test_no_message_is_lost_and_each_has_a_known_cause() -> None:
    causes = grouped(MESSAGES, KINDS)
    assert sorted(text for cause in causes for text in cause.messages) == sorted(MESSAGES)
    assert OTHER not in [cause.kind for cause in causes]


def test_what_nobody_knows_is_shown_too() -> None:
    causes = grouped(("a thing that nobody wrote before",), KINDS)
    assert [cause.kind for cause in causes] == [OTHER]


def test_the_gravest_come_first() -> None:
    order = [GRAVITIES.index(cause.kind.gravity) for cause in grouped(MESSAGES, KINDS)]
    assert order == sorted(order)


def test_sizes_and_times_are_those_of_all_messages() -> None:
    causes = {cause.kind: cause for cause in grouped(MESSAGES, KINDS)}
    contacts = causes[CONTACTS]
    assert contacts.largest == 731.0
    assert contacts.where == "from 1.07 to 1.11 s, from 2.77 to 2.78 s"
    assert causes[FEET_BESIDE].size == "in up to 40 % of the time"


def test_stretches_that_touch_are_one() -> None:
    texts = tuple(
        f"{start:.2f} to {start + 0.05:.2f} s: no site may touch, but 45 N upward are needed"
        for start in (1.0, 1.1, 1.2, 3.0)
    )
    (cause,) = grouped(texts, KINDS)
    assert cause.where == "from 1.00 to 1.25 s, from 3.00 to 3.05 s"
