"""Quantities of runs, jumps, squats and rises; each is of a step, a jump, a repetition or a rise.

Their equations stand where they are computed: `running`, `jumping`, `squatting`, `rising`.
"""

from __future__ import annotations

from myomorph.core.model.quantity import Quantity

FILE = "movement.csv"
PER_PART = ("movement_part",)
WEIGHTS = "body weight"


def _number(name: str, unit: str, label: str, meaning: str) -> Quantity:
    """Declare a number of a part: no array of a result file, but a column of a table."""
    return Quantity(
        name=name,
        dims=PER_PART,
        unit=unit,
        meaning=meaning,
        label=label,
        stored=False,
        file=FILE,
    )


CONTACT_TIME = _number(
    "contact_time", "s", "Contact time", "from when the foot meets the ground until it leaves it"
)
FLIGHT_TIME = _number(
    "flight_time", "s", "Flight time", "from when the ground is left until it is met again"
)
DUTY_FACTOR = _number("duty_factor", "1", "Duty factor", "contact time over stride time")
CADENCE = _number("cadence", "steps/min", "Cadence", "one over the time from strike to strike")
STEP_LENGTH = _number("step_length", "m", "Step length", "from strike to strike along the travel")
PEAK_VERTICAL_FORCE = _number(
    "peak_vertical_force",
    WEIGHTS,
    "Peak vertical force",
    "largest vertical force as measured, without a low-pass filter",
)
LOADING_RATE = _number(
    "loading_rate",
    f"{WEIGHTS}/s",
    "Loading rate",
    "slope of the measured vertical force from 20 to 80 % of the way to the impact peak",
)
VERTICAL_STIFFNESS = _number(
    "vertical_stiffness",
    "kN/m",
    "Vertical stiffness",
    "peak vertical force over how far the center of mass goes down in contact",
)
LEG_STIFFNESS = _number(
    "leg_stiffness",
    "kN/m",
    "Leg stiffness",
    "peak vertical force over how far the leg is compressed",
)
RUNNING = (
    CONTACT_TIME,
    FLIGHT_TIME,
    DUTY_FACTOR,
    CADENCE,
    STEP_LENGTH,
    PEAK_VERTICAL_FORCE,
    LOADING_RATE,
    VERTICAL_STIFFNESS,
    LEG_STIFFNESS,
)

HEIGHT_BY_IMPULSE = _number(
    "jump_height_impulse",
    "m",
    "Height by impulse and momentum",
    "from the take-off velocity v, that of the net impulse: v²/2g",
)
HEIGHT_BY_FLIGHT = _number(
    "jump_height_flight", "m", "Height by flight time", "from the flight time t: g t²/8"
)
HEIGHT_DIFFERENCE = _number(
    "jump_height_difference",
    "m",
    "Flight time less impulse",
    "by how much the two heights differ: landing with bent legs adds to the flight",
)
NET_IMPULSE = _number(
    "net_impulse", "N s", "Net impulse", "of the force less body weight, from onset to take-off"
)
PEAK_POWER = _number(
    "peak_power",
    "W/kg",
    "Peak power",
    "largest product of force and velocity of the center of mass, per body mass",
)
FORCE_RATE = _number(
    "rate_of_force_development",
    "N/s",
    "Rate of force development",
    "mean slope of the force from its smallest to its largest value before take-off",
)
COUNTERMOVEMENT_DEPTH = _number(
    "countermovement_depth",
    "m",
    "Depth of the countermovement",
    "how far the center of mass goes down before take-off",
)
REACTIVE_STRENGTH = _number(
    "reactive_strength_index",
    "m/s",
    "Reactive strength index",
    "height by flight time over contact time, of drop jumps",
)
PUSH_SHARE = _number(
    "push_right_share",
    "%",
    "Push-off, right leg",
    "share of the right leg in the impulse of both while the body goes up",
)
LANDING_FORCE = _number(
    "landing_peak_force",
    WEIGHTS,
    "Peak force of landing",
    "largest vertical force until the body has stopped, as measured",
)
LANDING_SHARE = _number(
    "landing_right_share",
    "%",
    "Landing, right leg",
    "share of the right leg in the impulse of both until the body has stopped",
)
OF_DROP_JUMPS = (CONTACT_TIME, REACTIVE_STRENGTH)
"""What only a jump after a fall has."""
FROM_STANDING = (HEIGHT_BY_IMPULSE, HEIGHT_DIFFERENCE, NET_IMPULSE, FORCE_RATE)
"""What only a jump from standing has."""
JUMPING = (
    HEIGHT_BY_IMPULSE,
    HEIGHT_BY_FLIGHT,
    HEIGHT_DIFFERENCE,
    FLIGHT_TIME,
    CONTACT_TIME,
    REACTIVE_STRENGTH,
    NET_IMPULSE,
    PEAK_POWER,
    FORCE_RATE,
    COUNTERMOVEMENT_DEPTH,
    PUSH_SHARE,
    LANDING_FORCE,
    LANDING_SHARE,
)

KNEE_DEPTH = _number(
    "peak_knee_flexion", "deg", "Depth, knee flexion", "largest mean flexion of the knees"
)
CENTER_DROP = _number(
    "center_of_mass_drop",
    "m",
    "Depth, center of mass",
    "how far the center of mass goes down",
)
DOWN_TIME = _number("down_time", "s", "Way down", "from standing to 95 % of the depth")
BOTTOM_TIME = _number("bottom_time", "s", "At the bottom", "below 95 % of the depth")
UP_TIME = _number("up_time", "s", "Way up", "from 95 % of the depth to standing")
RIGHT_SHARE = _number(
    "right_share", "%", "Load on the right leg", "share of the right foot in the force under both"
)
MOMENT_UNIT = "N m/kg"


def _moment(joint: str, side: str) -> Quantity:
    """Declare the peak of the moment that extends a joint."""
    words = f"{joint.replace('_', ' ')}, {side}" if side else joint.replace("_", " ")
    return _number(
        "_".join(part for part in ("peak", joint, "moment", side) if part),
        MOMENT_UNIT,
        f"{words[:1].upper()}{words[1:]}: peak moment",
        f"largest extension moment per body mass, {words}",
    )


KNEE_MOMENT_RIGHT = _moment("knee", "right")
KNEE_MOMENT_LEFT = _moment("knee", "left")
HIP_MOMENT_RIGHT = _moment("hip", "right")
HIP_MOMENT_LEFT = _moment("hip", "left")
LOW_BACK_MOMENT = _moment("low_back", "")
MOMENTS = (
    KNEE_MOMENT_RIGHT,
    KNEE_MOMENT_LEFT,
    HIP_MOMENT_RIGHT,
    HIP_MOMENT_LEFT,
    LOW_BACK_MOMENT,
)
"""What is not shown where torques do not hold."""
SQUATTING = (KNEE_DEPTH, CENTER_DROP, DOWN_TIME, BOTTOM_TIME, UP_TIME, *MOMENTS, RIGHT_SHARE)

RISE_TIME = _number("rise_time", "s", "Time", "from when the trunk begins to lean until standing")
MOMENTUM_TIME = _number(
    "momentum_time",
    "s",
    "Momentum phase",
    "from when the trunk begins to lean until the seat is left",
)
EXTENSION_TIME = _number(
    "extension_time", "s", "Extension phase", "from when the seat is left until standing"
)
TRUNK_LEAN = _number(
    "peak_trunk_lean", "deg", "Trunk flexion", "largest angle of the trunk with the vertical"
)
RISING = (
    RISE_TIME,
    MOMENTUM_TIME,
    EXTENSION_TIME,
    TRUNK_LEAN,
    PEAK_VERTICAL_FORCE,
    *MOMENTS,
    RIGHT_SHARE,
)

QUANTITIES = tuple(dict.fromkeys((*RUNNING, *JUMPING, *SQUATTING, *RISING)))
