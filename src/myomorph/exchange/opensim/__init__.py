"""OpenSim's setup files, run: scaling, inverse kinematics and dynamics, and analyses.

The analyses are those of AnalyzeTool. Reading a setup is the work of `io.osim`; the computation is
that of the rooms below.
"""
