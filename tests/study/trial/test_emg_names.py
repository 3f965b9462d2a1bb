"""EMG channels find their muscles by the spellings of laboratories."""

from __future__ import annotations

import pytest

from myomorph.core.model.errors import BadData
from myomorph.lab.analyze.generic_model import generic_model
from myomorph.lab.study.inputs.emg import EmgFiles
from myomorph.lab.study.inputs.emg_files import OTHER_SENSORS
from myomorph.lab.study.inputs.emg_names import muscles_of_channels, plain_channel
from myomorph.lab.study.inputs.keys import keys_of

pytest.importorskip("myo_sim")


@pytest.mark.parametrize(
    ("channel", "muscles"),
    [
        ("Voltage.L Rect", ("recfem_l",)),
        ("Voltage.R Hams", ("bflh_r", "semimem_r", "semiten_r")),
        ("LTA", ("tibant_l",)),
        ("R_vastus_medialis", ("vasmed_r",)),
        ("soleus_r_activation", ("soleus_r",)),
        ("gmax_l", ("glmax1_l", "glmax2_l", "glmax3_l")),
        ("soleus", ()),
        ("R GM", ()),
    ],
)
def test_a_channel_finds_its_muscles(channel: str, muscles: tuple[str, ...]) -> None:
    model, _ = generic_model({})
    assert muscles_of_channels([channel], model).get(channel, ()) == muscles


def test_a_side_that_is_given_serves_channels_without_one() -> None:
    model, _ = generic_model({})
    assert muscles_of_channels(["medgas"], model, "left") == {"medgas": ("gasmed_l",)}


def test_names_without_what_programs_add() -> None:
    assert plain_channel("Voltage.R Tib Ant") == ("Tib_Ant", "right")


@pytest.mark.parametrize(
    "name", ["Force.Fx1", "Mz2", "FP1_Fx", "AMTI1.Fx", "load cell", "Channel_01", "1"]
)
def test_channels_of_plates_and_sensors_are_no_emg(name: str) -> None:
    assert OTHER_SENSORS.search(name)


@pytest.mark.parametrize("name", ["LTA", "gracilis", "SOL", "Voltage.L Rect", "VASTM"])
def test_channels_of_muscles_are(name: str) -> None:
    assert not OTHER_SENSORS.search(name)


def test_muscles_of_channels_from_the_command_line() -> None:
    (key,) = [key for key in keys_of(EmgFiles) if key.name == "emg_muscles"]
    muscles = key.kind.parsed(key.name, ["EMG 1=soleus_r", "b=x,y"])
    assert dict(muscles) == {"EMG 1": ("soleus_r",), "b": ("x", "y")}
    for text in (["a"], ["a="], ["a=b", "a=c"]):
        with pytest.raises(BadData, match="CHANNEL=MUSCLE"):
            key.kind.parsed(key.name, text)
