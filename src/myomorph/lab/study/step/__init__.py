"""What a step is, whatever its scope: declared once, run, reused and described in one way."""
