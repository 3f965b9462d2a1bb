"""C3D files: two readers behind one door, one of them in a guarded process, plates, and the writer.

Plate forces leave here as forces of plates; which body they act on is decided elsewhere.
"""
