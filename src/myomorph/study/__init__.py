"""From files to steps to results: study files, recordings, provenance, demos. Holds no science."""
