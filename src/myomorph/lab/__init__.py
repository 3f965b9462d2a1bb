"""The laboratory: recordings analyzed, studies run, results stored, reported and viewed."""
