"""Recordings from one file format to another: C3D, TRC, tables of forces and EMG."""
