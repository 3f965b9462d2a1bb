"""C3D files: the reader, plates, and the writer.

Plate forces leave here as forces of plates; which body they act on is decided elsewhere.
"""
