"""Causes of the messages that the core makes."""

from __future__ import annotations

from myomorph.core.model.messages import Cause

CONTACTS = Cause(
    key="contacts",
    title="Contacts that cannot carry the motion",
    severity="changes results",
    size="up to {size} N are unexplained",
    effect="Torques, contact forces and muscles are wrong there.",
    remedy="Name the missing support (--contacts), or use the part on plates (--time).",
    quantities=("generalized_force", "contact_force", "muscle_force", "activation"),
    order=2,
)
CONTACTS_OPEN = Cause(
    key="contacts_open",
    title="Contact forces that the data do not determine",
    severity="changes results",
    size="the data allow {size} N more or less",
    effect="Contact forces, torques and muscles there are one choice of many.",
    remedy="Measure some of the contacts, as with a plate under one foot.",
    quantities=("contact_force", "generalized_force", "muscle_force", "activation"),
    order=2,
)
CONTACT_TIMES = Cause(
    key="contact_times",
    title="Contacts that the recording does not state",
    severity="may change results",
    effect="When feet, hands and objects touch is found from motion or sound.",
    remedy="State the contacts in a table (--contacts).",
    quantities=("contact_force", "muscle_force"),
)
FEET_BESIDE = Cause(
    key="feet_beside",
    title="Feet beside the plates",
    severity="changes results",
    size="in up to {size} % of the time",
    effect="Torques of the loaded leg, and its muscles, are estimates there.",
    remedy="Use the part in which each foot has its own plate (--time), or record it again.",
    quantities=("generalized_force", "muscle_force", "activation", "joint_reaction"),
    order=2,
)
WEIGHT = Cause(
    key="weight",
    title="Body and plates weigh differently",
    severity="changes results",
    size="{size} % between them",
    effect="Torques and muscle forces scale with the mass.",
    remedy="Give the mass of the subject (--mass), or check the calibration of the plates.",
    quantities=("generalized_force", "muscle_force"),
)
PLATES = Cause(
    key="plates",
    title="Plates that were corrected, or seem wrong",
    severity="may change results",
    effect="Forces act at other places than recorded; torques follow them.",
    remedy="Compare with the laboratory's setup; --no-repair leaves all as recorded.",
    quantities=("generalized_force", "external_force_vector", "external_force_point"),
)
PLATE_ZERO = Cause(
    key="plate_zero",
    title="Plates that were not set to zero",
    severity="may change results",
    size="up to {size} N without load",
    effect="Forces are wrong by as much while the foot stands.",
    remedy="Set the plates to zero before each recording.",
    quantities=("external_force_vector", "generalized_force"),
    order=0,
)
FORCE_FILES = Cause(
    key="force_files",
    title="Forces whose columns or units a file does not state",
    severity="may change results",
    effect="They were assumed from their size and order; torques follow them.",
    remedy="State columns and units (--force-columns).",
    quantities=("external_force_vector", "external_force_point", "generalized_force"),
    order=0,
)
HIDDEN = Cause(
    key="hidden_markers",
    title="Markers that were hidden",
    severity="may change results",
    size="in up to {size} % of the frames",
    effect="The pose is left empty, or a guess of the joints that no marker shows.",
    remedy="Fill the gaps in the recording's program, or leave those frames out (--time).",
    quantities=("coordinate_value", "generalized_force"),
    order=2,
)
UNSEEN = Cause(
    key="unseen_segments",
    title="Segments that no marker shows",
    severity="may change results",
    effect="A trunk is assumed upright, other joints near their default pose.",
    remedy="Lock what is not measured, or add markers.",
    quantities=("coordinate_value", "generalized_force"),
    order=2,
)
MARKERS = Cause(
    key="markers",
    title="Markers that were corrected, or seem wrong",
    severity="may change results",
    size="up to {size} cm",
    effect="Angles near them change.",
    remedy="Look at the markers named; --no-repair leaves all as recorded.",
    quantities=("coordinate_value", "marker_error"),
)
LABELS = Cause(
    key="labels",
    title="Labels that the model does not have",
    severity="may change results",
    effect="Markers that match no marker of the model are not used.",
    remedy="Map the names (--labels).",
    quantities=("coordinate_value",),
)
POSES = Cause(
    key="poses",
    title="Poses that the model cannot take",
    severity="may change results",
    effect="Angles there are those of the nearest pose, and torques follow them.",
    remedy="Check the bounds, the markers there and the model's size.",
    quantities=("coordinate_value", "generalized_force"),
    order=2,
)
SIZES = Cause(
    key="sizes",
    title="Distances between markers that do not fit",
    severity="may change results",
    effect="Lengths of segments keep those of the model.",
    remedy="Check whether the markers named are those of the model.",
    quantities=("coordinate_value",),
)
LOOPS = Cause(
    key="loops",
    title="Closed loops that were open",
    severity="may change results",
    effect="Their coordinates were moved to close them.",
    remedy="Compute the motion with the same model.",
    quantities=("coordinate_value", "generalized_force"),
)
CLOCKS = Cause(
    key="clocks",
    title="Clocks that do not agree",
    severity="may change results",
    size="by {size} ms",
    effect="Torques and powers change where forces or speeds change fast.",
    remedy="Synchronize the recordings, or shift one of them (--force-shift).",
    quantities=("generalized_force",),
)
RATES = Cause(
    key="rates",
    title="Rates that do not fit gravity or each other",
    severity="changes results",
    size="{size} times the rate",
    effect="Speeds scale with the rate, accelerations and powers with its square.",
    remedy="Compare the rates in the heads of the files with the recording's.",
    quantities=("coordinate_value", "generalized_force"),
    order=0,
)
FILTER = Cause(
    key="filter",
    title="Torques depend on the filter",
    severity="may change results",
    size="the largest torque by {size} % with twice the cutoff",
    effect="Peaks of torques and powers hold within as much.",
    remedy="Choose the cutoff of your field (--cutoff), or fewer gaps in the markers.",
    quantities=("generalized_force",),
    order=2,
)
SENSORS = Cause(
    key="sensors",
    title="Inertial sensors that are missing, or seem wrong",
    severity="may change results",
    effect="Angles of their segments drift, or are guesses.",
    remedy="Look at the sensors named, or record the calibration pose again.",
    quantities=("coordinate_value",),
)
SOUND = Cause(
    key="sound",
    title="Sound that shows impacts in part",
    severity="may change results",
    effect="Impacts and their impulses are known less well.",
    remedy="Record louder or softer, and state when the sound begins.",
    quantities=("contact_force",),
)
EMG = Cause(
    key="emg",
    title="EMG that is not used, or seems wrong",
    severity="may change results",
    effect="Muscles without EMG follow least effort.",
    remedy="Name the muscles of the channels (--emg-muscles), or look at their curves.",
    quantities=("activation", "muscle_force"),
)
EMG_CONFLICTS = Cause(
    key="emg_conflicts",
    title="EMG that contradicts the torques",
    severity="may change results",
    effect="Muscles leave their EMG, or reserves bear what it leaves.",
    remedy="Look at emg_conflicts.csv: channel, gain, moment arm or torque may be wrong.",
    quantities=("activation", "muscle_force", "actuator_force"),
    order=2,
)
MUSCLES = Cause(
    key="muscles",
    title="Muscles at their limits",
    severity="may change results",
    effect="Tensions near them are not those of the person.",
    remedy="Check their strength and lengths, or calibrate the model.",
    quantities=("activation", "muscle_force", "joint_reaction"),
    order=2,
)
PASSIVE = Cause(
    key="passive_force",
    title="Passive force of stretched muscles",
    severity="may change results",
    effect="Muscles and joint loads hold more force than a living muscle would have.",
    remedy="Calibrate the model, take elastic tendons, or compare without passive force.",
    quantities=("muscle_force", "joint_reaction"),
    order=2,
)
JOINT_POINTS = Cause(
    key="joint_points",
    title="Contact points of joints",
    severity="may change results",
    effect="How the load of a joint divides between its points.",
    remedy="Give the bones of both sides, or the points in a file.",
    quantities=("joint_contact_force",),
)
BENT_KNEES = Cause(
    key="bent_knees",
    title="Loads of bent knees",
    severity="may change results",
    effect="The force depends on the arm of the patellar tendon, which differs by person.",
    remedy="Report the range that statics allow, or an interval (--draws).",
    quantities=("joint_contact_force", "joint_reaction"),
)
BONES = Cause(
    key="bones",
    title="Bones that do not fit each other",
    severity="may change results",
    effect="What is placed by them lies elsewhere.",
    remedy="Look at the bone, its side and its unit, and at the points that were picked.",
)
MODEL = Cause(
    key="model",
    title="The model and its files",
    severity="good to know",
    effect="As each says.",
)
READING = Cause(
    key="reading",
    title="How the recording was read",
    severity="good to know",
    effect="As each says.",
    order=0,
)
UNITS = Cause(
    key="units",
    title="Units that a file does not state",
    severity="may change results",
    effect="They were assumed from their size.",
    remedy="State them in the file, or check whether sizes are those of a body.",
    quantities=("coordinate_value", "external_force_vector"),
    order=0,
)
SETTINGS = Cause(
    key="settings",
    title="Requests beyond the recording",
    severity="good to know",
    effect="As each says.",
)
