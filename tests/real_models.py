"""Models of the data collection that laws are checked on."""

from __future__ import annotations

MODELS = (
    "bones-landmarks-leg/make-a-leg_final.osim",
    "c3d-functional-joints/models/Wu_Shoulder_Model_via_points.osim",
    "c3d-functional-joints/models/wholebody.osim",
    "ceinms-emg-walk/model/gait2392.osim",
    "fullbody-many-muscles/cyclistFullBodyMuscle.osim",
    "hamner-run-subject04/unscaled_generic.osim",
    "lenhart-knee-contact-walk/lenhart2015.osim",
    "opencap-subject4-multitask/models/manually_scaled.osim",
    "opensim-gait-subject01/ref_id/subject01.osim",
    "opensim-gait-subject01/ref_so_10dof18musc/subject01_adjusted_spring.osim",
    "opensim-reference-small/arm26_bounds.osim",
    "opensim-reference-small/DoublePendulum3D.osim",
    "passive-joint-moments/Rajagopal_modifiedAbductors.osim",
    "rajagopal-walk-emg/raw/Rajagopal2016.osim",
    "rajagopal-walk-emg/subject_walk_scaled.osim",
    "shoulder-bonepin/subject1_abdbonepin.osim",
    "shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim",
)
