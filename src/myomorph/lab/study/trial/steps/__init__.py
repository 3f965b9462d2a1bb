"""The steps of a trial, one a file; `study.step.step_table.STEPS` lists them."""
