"""A plan carried out: jobs, a cluster's workers, what is reused, the log and the dry run.

What a job computes is in `study.trial`, `study.subject` and `study.summary`.
"""
