"""A plan carried out: jobs, workers of this machine and of a cluster, what is reused, the log and the dry run.

What a job computes is in `study.trial`, `study.subject` and `study.summary`.
"""
