"""Options that few need: study files are their place, and no help lists them.

Commands take them all the same. The documentation's page of commands lists them.
"""

from __future__ import annotations

SENSORS = (
    "imu-pose-time",
    "imu-mounting",
    "imu-noise",
    "imu-marker-noise",
    "imu-pose-error",
    "imu-heading-error",
    "imu-heading-drift",
    "imu-magnetometer",
)
KINEMATICS = (
    *SENSORS,
    "tolerance",
    "iterations",
    "posture-weight",
    "passes-min-visible",
    "passes-max-gap",
    "passes-min-duration",
)
FORCES = ("force-shift", "force-columns", "force-rate", "force-origins")
EMG = (
    "emg-mvc",
    "emg-gains-file",
    "emg-weight",
    "emg-slack",
    "emg-delay",
    "emg-gains",
    "emg-offsets",
    "emg-shape",
    "emg-unmeasured",
    "emg-unmeasured-weight",
    "emg-cutoff",
    "emg-order",
    "emg-notch",
    "emg-notch-width",
)
MUSCLES = (
    "weights",
    "min-activation",
    "viscous",
    "curves",
    "joint-tissue",
    "activation-dynamics",
    "second-start",
    "joint-load-joints",
    "co-contraction",
    "co-contraction-coordinates",
    "knee-contact",
    "formulation",
    "compliance",
    "contact-passive",
    "smoothness",
    "window",
    "sweeps",
)
ERRORS = (
    "skin-thigh",
    "skin-shank",
    "skin-foot",
    "skin-trunk",
    "skin-arm",
    "skin-time",
    "angle",
    "sensor-noise",
    "sensor-mounting",
    "plate-rotation",
    "plate-gain",
    "contact-time",
    "contact-point",
    "mass-center",
    "inertia",
    "joint-axis",
    "leg-alignment",
    "filter-cutoff",
    "patella",
    "patella-distance",
    "wrap-radius",
    "joint-contact-point",
    "criterion",
)

ANALYZE = (
    *KINEMATICS,
    *FORCES,
    *EMG,
    *MUSCLES,
    "arms",
    "turn",
    "imu-pose",
    "imu-bodies",
    "imu-heading",
    "only-weighted",
    "root-bounds",
    "net",
    "independent-coordinates",
    "actuators",
    "residual",
    "joint-load",
    "emg-mode",
)
TENSION = (*FORCES, *EMG, *MUSCLES)
UNCERTAINTY = (*ERRORS, "emg-mvc", "emg-gains-file", "draw-seed", "widened")
IDENTIFY = (*FORCES, "weight-phi", "weight-rho", "point-floor")
