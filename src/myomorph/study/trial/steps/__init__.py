"""The steps of a trial, one a file; `study.trial.step.STEPS` lists them."""
