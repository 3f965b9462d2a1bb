"""The steps of a subject, before its trials: calibration, identification, morphing."""
