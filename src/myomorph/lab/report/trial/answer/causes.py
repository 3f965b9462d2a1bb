"""The causes that messages are known to have, the first that fits first."""

from __future__ import annotations

from myomorph.lab.report.trial.answer.cause import CauseKind

CONTACTS = CauseKind(
    title="Contacts that cannot carry the motion",
    gravity="changes results",
    patterns=(
        r"sites that touch cannot carry the motion, (?P<size>\d+) N",
        r"sites that touch cannot carry the motion",
        r"no site may touch, but (?P<size>\d+) N",
        r"no site may touch, but",
        r"contacts cannot carry the motion: forces of (?P<size>[\d.]+) N",
        r"no contact site is near the floor",
    ),
    size="up to {size} N come from nowhere",
    effect="Torques, contact forces and muscles are wrong there.",
    remedy="Name the missing support (--contacts), or use the part on plates (--time).",
)
FEET_BESIDE = CauseKind(
    title="Feet beside the plates",
    gravity="changes results",
    patterns=(
        r"the load on '.*' is not determined in (?P<size>[\d.]+) % of the time",
        r"in (?P<size>[\d.]+) % of the frames a foot is on the ground and plates",
        r"sites? may touch",
        r"of the tensions not determined",
    ),
    size="in up to {size} % of the time",
    effect="Torques of the loaded leg, and its muscles, are estimates there.",
    remedy="Use the part in which each foot has its own plate (--time), or record it again.",
)

KINDS: tuple[CauseKind, ...] = (
    CONTACTS,
    FEET_BESIDE,
    CauseKind(
        title="Body and plates weigh differently",
        gravity="changes results",
        patterns=(
            r"the plates carry [\d.]+ kg .*\((?P<size>[+-]?\d+) %\)",
            r"the subject weighs",
            r"torques belong to the model's mass",
        ),
        size="{size} % between them",
        effect="Torques and muscle forces scale with the mass.",
        remedy="Give the mass of the subject (--mass), or check the calibration of the plates.",
    ),
    CauseKind(
        title="Plates that were put right, or seem wrong",
        gravity="may change results",
        patterns=(
            r"wrong foot",
            r"mirrored",
            r"against the motion",
            r"center of pressure",
            r"pulls? (the foot )?down",
            r"corners of .* were counted",
            r"sensor distances are zero",
            r"force plate",
        ),
        size="{count}",
        effect="Forces act at other places than recorded; torques follow them.",
        remedy="Compare with the laboratory's setup; --no-mend leaves all as recorded.",
    ),
    CauseKind(
        title="Plates that were not set to zero",
        gravity="may change results",
        patterns=(r"reads (?P<size>[\d.]+) N with nobody on it",),
        size="up to {size} N without load",
        effect="Forces are wrong by as much while the foot stands.",
        remedy="Set the plates to zero before each recording.",
    ),
    CauseKind(
        title="Markers that were hidden",
        gravity="may change results",
        patterns=(
            r"(?P<size>\d+) of \d+ frames show too few markers",
            r"in (?P<size>\d+) of \d+ frames no marker shows",
            r"left empty",
            r"values there are guesses",
            r"takes? .* from the default",
            r"gap",
        ),
        size="in up to {size} frames",
        effect="The pose is left empty, or a guess of the joints that no marker shows.",
        remedy="Fill the gaps in the recording's program, or leave those frames out (--time).",
    ),
    CauseKind(
        title="Markers that were put right, or seem wrong",
        gravity="may change results",
        patterns=(
            r"marker.*(swap|exchang|mislabel|jump|mirror)",
            r"(swap|exchang|mislabel).*marker",
            r"marker '.*'",
            r"markers? .* (misses|lies|lie)",
        ),
        size="{count}",
        effect="Angles near them change.",
        remedy="Look at the markers named; --no-mend leaves all as recorded.",
    ),
    CauseKind(
        title="Torques depend on the filter",
        gravity="may change results",
        patterns=(r"cutoff changes the largest joint torque by (?P<size>[+-]?[\d.]+) %",),
        size="the largest torque by {size} % with twice the cutoff",
        effect="Peaks of torques and powers hold within as much.",
        remedy="Choose the cutoff of your field (--cutoff), or fewer gaps in the markers.",
    ),
    CauseKind(
        title="EMG that takes no part, or contradicts the torques",
        gravity="may change results",
        patterns=(r"\bEMG\b",),
        size="{count}",
        effect="Muscles without EMG follow least effort.",
        remedy="Name the muscles of the channels (--emg-muscles), or look at their curves.",
    ),
    CauseKind(
        title="Muscles at their limits",
        gravity="may change results",
        patterns=(
            r"muscles? .*(saturat|too weak|overstretch|push)",
            r"passive force",
            r"reserves? of",
            r"paths? jumps?",
            r"no muscle (moves|drives)",
        ),
        size="{count}",
        effect="Tensions near them are not those of the person.",
        remedy="Check their strength and lengths, or calibrate the model.",
    ),
    CauseKind(
        title="The model and its files",
        gravity="good to know",
        patterns=(r"\.(osim|xml|mjcf|urdf)\b", r"\bmodel\b"),
        size="{count}",
        effect="As each says.",
        remedy="",
    ),
    CauseKind(
        title="How the recording was read",
        gravity="good to know",
        patterns=(
            r"points up in the laboratory",
            r"turned by",
            r"\bunits?\b",
            r"\.(c3d|trc|mot|sto|csv)\b",
            r"clock",
            r"\bHz\b",
        ),
        size="{count}",
        effect="As each says.",
        remedy="",
    ),
)
