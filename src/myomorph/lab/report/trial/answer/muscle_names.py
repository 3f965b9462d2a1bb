"""Plain names of muscles, by how models of the OpenSim and MyoSim families begin them."""

from __future__ import annotations

from collections.abc import Mapping

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.sides import split_side

PLAIN: Mapping[str, str] = FrozenMap(
    {
        "add": "adductors",
        "bf": "hamstrings",
        "bic": "biceps",
        "bra": "brachialis",
        "delt": "deltoid",
        "edl": "toe extensors",
        "ehl": "toe extensors",
        "ercspn": "erector spinae",
        "extobl": "external oblique",
        "fdl": "toe flexors",
        "fhl": "toe flexors",
        "gas": "gastrocnemius",
        "glmax": "gluteus maximus",
        "glmed": "gluteus medius",
        "glmin": "gluteus minimus",
        "glut_max": "gluteus maximus",
        "glut_med": "gluteus medius",
        "glut_min": "gluteus minimus",
        "grac": "gracilis",
        "ham": "hamstrings",
        "il_": "iliocostalis",
        "iliacus": "iliopsoas",
        "infsp": "infraspinatus",
        "intobl": "internal oblique",
        "lat": "latissimus dorsi",
        "ltp": "longissimus",
        "lat_gas": "gastrocnemius",
        "med_gas": "gastrocnemius",
        "mf_": "multifidus",
        "pec": "pectoralis",
        "per": "peronei",
        "piri": "piriformis",
        "psoas": "iliopsoas",
        "rect_fem": "rectus femoris",
        "recfem": "rectus femoris",
        "sart": "sartorius",
        "semi": "hamstrings",
        "soleus": "soleus",
        "subsc": "subscapularis",
        "supsp": "supraspinatus",
        "tfl": "tensor fasciae latae",
        "tib_ant": "tibialis anterior",
        "tib_post": "tibialis posterior",
        "tibant": "tibialis anterior",
        "tibpost": "tibialis posterior",
        "tri": "triceps",
        "vas": "vasti",
    }
)


def plain_name(muscle: str) -> str:
    """Say what people call a muscle, or the group that it is of; "" where that is not known."""
    base = split_side(muscle.rsplit("__", 1)[-1])[0].lower()
    fitting = (start for start in PLAIN if base.startswith(start))
    longest = max(fitting, key=len, default="")
    return PLAIN.get(longest, "")
