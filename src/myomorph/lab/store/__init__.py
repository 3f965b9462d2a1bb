"""Files of results: tables, NetCDF, settings, locks and progress, for every room that writes.

It knows how a result is kept, not how it is computed.
"""
